"""Resolve ``[plant]`` and ``[belief]`` into a ``ModelSpec``: inheritance, parameter sets, bounds, noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from harness.common import registry
from harness.common.errors import ModelError
from harness.config.bounds import broken_relations, out_of_bounds
from harness.config.parameter_set import ParameterSet, load_set, refuse_unknown_units, variance_unit
from harness.config.problems import Problems, validated
from harness.config.schema import ModelTable
from harness.config.specs import ModelSpec, assembled
from harness.config.unknown_parameters import KEYS, parameter_states
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.assembly.parameter_states import ParameterState
from harness.models.assembly.placement import is_degradation, load_effect, place_of, split
from harness.models.contracts import DRIVE_INPUTS
from harness.models.roles import SENSORS, TYRES, VEHICLES

Kind = Literal["process", "measurement"]
_KINDS = ("process", "measurement", "input")
_SIMPLE = (
    "vehicle",
    "parameters",
    "tyre",
    "effects",
    "sensors",
    "integrator",
    "step",
    "substeps",
    "timeout",
    "unknown_inputs",
    *KEYS,
)


@dataclass(frozen=True)
class Stated:
    """Entries of a model's table, own and inherited ones together, each with the key it was written at.

    ``parameter_set`` is the one that it names, ``None`` if that cannot be had.
    """

    side: str
    entries: dict[str, Any]
    keys: dict[str, str]
    parameter_set: ParameterSet | None = None

    def __getitem__(self, name: str) -> Any:
        return self.entries.get(name)

    def key(self, name: str) -> str:
        """Return the key path where an entry was written (or would be)."""
        return self.keys.get(name, f"{self.side}.{name}")

    def group(self, prefix: str) -> dict[str, Any]:
        """Return the entries ``prefix.<name>`` by name."""
        return {k.removeprefix(f"{prefix}."): v for k, v in self.entries.items() if k.startswith(f"{prefix}.")}

    def own(self, name: str) -> bool:
        """Whether the entry was written in this table and not inherited."""
        return self.key(name).startswith(f"{self.side}.")

    def with_set(self, name: str) -> bool:
        """Whether the entry came with the parameter set."""
        return self.key(name).startswith(f"{self.key('parameters')} ")


def stated(side: str, table: ModelTable, folder: Path, problems: Problems, parent: Stated | None = None) -> Stated:
    """Flatten a table, add what it inherits and the tyre and effects that come with its parameter set.

    Everything not stated is as in the parent, key by key, without degradations of its sensors. A table that names a
    vehicle or a parameter set of its own starts from that set: single values and variances of the parent are not
    carried over into it, nor effects that came with the parent's set.

    Args:
        side: ``plant`` or ``belief``.
        table: The table.
        folder: Folder of the study, against which a parameter file is found.
        problems: Where problems are noted.
        parent: What it inherits from.
    """
    entries: dict[str, Any] = {k: v for k in _SIMPLE if (v := getattr(table, k)) is not None}
    entries |= {f"values.{k}": v for k, v in table.values.items()}
    for kind in _KINDS:
        entries |= {f"noise.{kind}.{k}": v for k, v in getattr(table.noise, kind).items()}
        if (scale := getattr(table.noise, f"{kind}_scale")) is not None:
            entries[f"noise.{kind}_scale"] = scale
    keys = {name: f"{side}.{name}" for name in entries}
    if parent is not None:
        fresh = "vehicle" in entries or "parameters" in entries
        for name, value in parent.entries.items():
            of_set = name.startswith(("values.", "noise.")) or (name == "effects" and parent.with_set(name))
            if name not in entries and not (fresh and of_set):
                inherited = [e for e in value if not is_degradation(e)] if name == "effects" else value
                entries[name], keys[name] = inherited, parent.key(name)
    plain = Stated(side, entries, keys)
    parameter_set = _parameter_set(plain, folder, problems)
    return plain if parameter_set is None else _with_set(plain, parameter_set, problems)


def resolve_single(table: Mapping[str, Any], where: str, side: Literal["plant", "belief"] = "plant") -> ModelSpec:
    """Return a model that is stated outside a study, such as on the command line.

    Args:
        table: Keys and values as in ``[plant]`` or ``[belief]``.
        where: Named in errors in place of the file.
        side: What the model is for; an estimator's belief may have unknown inputs and needs measurement noise.

    Raises:
        UserError: If anything in it is wrong.
    """
    problems = Problems(where)
    parsed = validated(dict(table), ModelTable, problems)
    problems.stop()
    assert parsed is not None
    spec = resolve_model(stated(side, parsed, Path(), problems), problems)
    problems.stop()
    assert spec is not None
    return spec


def resolve_model(table: Stated, problems: Problems) -> ModelSpec | None:
    """Return the resolved model, or ``None`` if a problem with it was noted.

    Args:
        table: What the study says about it.
        problems: Where problems are noted.
    """
    before, parameter_set = len(problems), table.parameter_set
    model = _assemble(table, problems)
    step = number(table, "step", "s", problems, 0.01)
    if step is not None and step <= 0:
        problems.add(table.key("step"), f"the sample time must be positive, e.g. '10 ms', got {table['step']!r}")
        step = None
    if model is None or parameter_set is None or step is None or len(problems) > before:
        return None
    values = _values(table, model, parameter_set, problems)
    noise: dict[Kind, dict[str, float]] = {
        "process": _noise(table, "process", model, parameter_set, step, problems),
        "measurement": _noise(table, "measurement", model, parameter_set, step, problems),
    }
    noisy_inputs = input_noise(table, model, problems)
    uncertain = _parameter_states(table, model, values, parameter_set, problems)
    if len(problems) > before:
        return None
    noise["process"] |= {s.state: s.walk_variance * step for s in uncertain}
    return ModelSpec(
        vehicle=table["vehicle"],
        parameters=table["parameters"] or "",
        tyre=table["tyre"],
        effects=tuple(table["effects"] or ()),
        sensors=table["sensors"],
        integrator=table["integrator"] or "euler",
        step=step,
        substeps=table["substeps"] or 1,
        values=values,
        process_noise=noise["process"],
        measurement_noise=noise["measurement"],
        unknown_inputs=tuple(table["unknown_inputs"] or ()),
        input_noise=noisy_inputs,
        parameter_states=uncertain,
    )


def _parameter_states(
    table: Stated, model: StateSpaceModel, values: Mapping[str, float], parameter_set: ParameterSet, problems: Problems
) -> tuple[ParameterState, ...]:
    stated = {name: (table.key(name), table[name]) for name in KEYS if table[name]}
    if stated and table.side == "plant":
        for key, _ in stated.values():
            problems.add(key, "only the belief is unsure of parameters; move the key to [belief]")
        return ()
    if not stated or len(values) < len(model.parameters):
        return ()
    return parameter_states(stated, model, table["vehicle"], values, parameter_set.std, problems)


def _assemble(table: Stated, problems: Problems) -> StateSpaceModel | None:
    """Check the names one by one, so that each error has its key, then wire the model."""
    before = len(problems)
    for name in ("vehicle", "sensors"):
        if table[name] is None:
            choices = ", ".join((VEHICLES if name == "vehicle" else SENSORS).names())
            problems.add(table.key(name), f"this key is required; choose one of: {choices}")
    for name, role in (("vehicle", VEHICLES), ("tyre", TYRES), ("sensors", SENSORS)):
        if table[name] is not None:
            with problems.catch(table.key(name)):
                role.load(table[name])
    effects = tuple(table["effects"] or ())
    for i, effect in enumerate(effects):
        if effect in effects[:i]:
            problems.add(f"{table.key('effects')}[{i}]", f"effect '{effect}' is named twice; remove one")
        with problems.catch(f"{table.key('effects')}[{i}]"):
            refuse_unknown_units(load_effect(effect))
            if table.side == "belief" and is_degradation(effect):
                raise ModelError(f"'{effect}' degrades the sensors of a plant, no estimator believes in it; remove it")
    if len(problems) > before:
        return None
    plain: StateSpaceModel | None = None
    with problems.catch(table.side):
        plain = assembled(table["vehicle"], table["tyre"], effects, table["sensors"], ())
    if plain is None:
        return None
    unknown = tuple(table["unknown_inputs"] or ())
    if unknown and table.side == "plant":
        problems.add("plant.unknown_inputs", "only the belief has unknown inputs; move the key to [belief]")
    for i, name in enumerate(unknown):
        key = f"{table.key('unknown_inputs')}[{i}]"
        if name not in plain.inputs:
            problems.add(key, f"'{name}' is no input{registry.closest(name, plain.inputs)}")
        elif name in plain.rates.values():
            problems.add(key, f"'{name}' must be known, because its time derivative is an input too; remove it")
        elif name in unknown[:i]:
            problems.add(key, f"'{name}' is named twice; remove one")
    return None if len(problems) > before else plain.augment(unknown)


def number(table: Stated, name: str, unit: str, problems: Problems, default: float | None = None) -> float | None:
    """Return an entry in SI units, its default if absent, ``None`` if it is wrong."""
    from harness.common.units import to_si

    if table[name] is None:
        return default
    with problems.catch(table.key(name)):
        return to_si(table[name], unit, problems.at(table.key(name)))
    return None


def _parameter_set(table: Stated, folder: Path, problems: Problems) -> ParameterSet | None:
    name, key = table["parameters"] or "", table.key("parameters")
    parameter_set: ParameterSet | None = None
    with problems.catch(key):
        parameter_set = load_set(name, folder, problems.at(key))
    if parameter_set is not None and name and table["vehicle"] not in (None, parameter_set.vehicle):
        problems.add(
            key,
            f"parameter set '{name}' is for vehicle '{parameter_set.vehicle}', but {table.key('vehicle')} is "
            f"'{table['vehicle']}'; choose a set of that vehicle",
        )
        return None
    return parameter_set


def _with_set(table: Stated, parameter_set: ParameterSet, problems: Problems) -> Stated:
    """Add a parameter set with what comes with it; tyre and effects that are stated in addition to its name stand.

    Sensors stand wherever they are stated: they belong to the vehicle's equipment and not to its values.
    """
    stated_here = {n: n in table.entries and (table.own(n) or not table.own("parameters")) for n in ("tyre", "effects")}
    stated_here["sensors"] = "sensors" in table.entries
    if parameter_set.tyre is not None and stated_here["tyre"] and table["tyre"] != parameter_set.tyre:
        problems.add(
            table.key("parameters"),
            f"the values of '{table['parameters']}' belong to tyre '{parameter_set.tyre}', but {table.key('tyre')} is "
            f"'{table['tyre']}'; choose that tyre or another set",
        )
    entries, keys = dict(table.entries), dict(table.keys)
    sensors = table["sensors"] if stated_here["sensors"] else parameter_set.sensors
    coming = {
        "tyre": parameter_set.tyre,
        "effects": _measured(parameter_set.effects, sensors),
        "sensors": parameter_set.sensors,
    }
    for name, value in coming.items():
        if value and not stated_here[name]:
            entries[name], keys[name] = value, f"{table.key('parameters')} ({parameter_set.source}): {name}"
    for name, unsure in parameter_set.unsure.items():
        if table.side == "belief" and name not in entries:
            entries[name], keys[name] = unsure, f"{table.key('parameters')} ({parameter_set.source}): {name}"
    return Stated(table.side, entries, keys, parameter_set)


def _measured(effects: tuple[str, ...], sensors: str | None) -> tuple[str, ...]:
    """Return the effects of a set without those of sensors that this model does not have."""
    if sensors is None:
        return effects
    try:
        outputs = SENSORS.load(sensors).OUTPUTS
    except ModelError:  # which is said where sensors are looked up
        return effects
    return tuple(e for e in effects if place_of(load_effect(e)) != "output" or split(e)[1] in (None, *outputs))


def _values(table: Stated, model: StateSpaceModel, parameter_set: ParameterSet, problems: Problems) -> dict[str, float]:
    """Return every parameter of the model: stated, else from the set, else neutral (effects)."""
    from harness.common.units import to_si

    given = table.group("values")
    refuse_unknown(table, "values", given, model.parameter_names, "parameter", problems)
    values: dict[str, float] = {}
    missing: list[str] = []
    for p in model.parameters:
        name = f"values.{p.name}"
        key = table.key(name)
        value: float | None = None
        if p.name in given:
            with problems.catch(key):
                value = to_si(given[p.name], p.unit, problems.at(key))
        elif p.name in parameter_set.values:
            value = parameter_set.values[p.name]
            key = f"{table.key('parameters')} ({parameter_set.source})"
        elif p.neutral is not None:
            value = p.neutral
        else:
            missing.append(p.name)
        if value is None:
            continue
        if (wrong := out_of_bounds(p, value)) is not None:
            problems.add(key, wrong)
        else:
            values[p.name] = value
    if missing:
        where = f"parameter set '{table['parameters']}'" if table["parameters"] else "no parameter set named, and it"
        problems.add(
            table.key("parameters"),
            f"{where} gives no value for {', '.join(missing)}; add them {_at_home(table, 'values')}"
            f"[{table.side}.values]",
        )
    if len(values) == len(model.parameters):
        _check_relations(table, values, parameter_set, problems)
    return values


def _at_home(table: Stated, group: str) -> str:
    """Return the place of a value in the parameter file in words, if the model has one."""
    file = table["parameters"] or ""
    return f"to [{group}] of {file}, or as " if file.endswith(".toml") else "as "


def _check_relations(
    table: Stated, values: Mapping[str, float], parameter_set: ParameterSet, problems: Problems
) -> None:
    try:
        wrong = broken_relations(table["vehicle"], values)
    except ModelError as error:
        problems.add(table.key("vehicle"), str(error))
        return
    for name, message in wrong:
        written = f"values.{name}" in table.entries
        key = table.key(f"values.{name}") if written else f"{table.key('parameters')} ({parameter_set.source})"
        problems.add(key, message if written else f"{name}: {message}")


def refuse_unknown(
    table: Stated, group: str, given: Iterable[str], names: tuple[str, ...], word: str, problems: Problems
) -> None:
    """Refuse names the model does not have; inherited ones are dropped silently."""
    for name in given:
        if name not in names and table.own(f"{group}.{name}"):
            problems.add(
                table.key(f"{group}.{name}"),
                f"the {table.side} has no {word} '{name}'{registry.closest(name, names)}",
            )


def _noise(
    table: Stated, kind: Kind, model: StateSpaceModel, parameter_set: ParameterSet, step: float, problems: Problems
) -> dict[str, float]:
    """Return the variances by state (per step) or output (per sample).

    Variances of a set belong to its step and grow in proportion to the study's; those a study states hold for
    the study's own step. A discrete model has one step, so its variances stay.
    """
    from harness.common.units import to_si

    process = kind == "process"
    names = model.states if process else tuple(model.outputs)
    base = parameter_set.process if process else parameter_set.measurement
    stretch = step / parameter_set.noise_step if process and not model.discrete else 1.0
    given = table.group(f"noise.{kind}")
    refuse_unknown(table, f"noise.{kind}", given, names, "state" if process else "output", problems)
    factor = noise_scale(table, kind, problems)
    if factor is None:
        return {}
    own_states = set(VEHICLES.load(table["vehicle"]).STATES)
    result: dict[str, float] = {}
    for name in names:
        key = table.key(f"noise.{kind}.{name}")
        variance: float | None = None
        if name in given:
            with problems.catch(key):
                variance = to_si(given[name], variance_unit(name), problems.at(key))
            if variance is None:
                continue
        elif name in base:
            variance = base[name] * stretch
        elif process and name not in own_states and name not in (table["unknown_inputs"] or ()):
            variance = model.noise.get(name, 0.0) * step  # an effect's state moves by its own equation
        else:
            problems.add(
                key,
                f"no {kind}-noise variance is known for '{name}'; add one {_at_home(table, f'{kind}_noise')}this key",
            )
            continue
        if variance < 0:
            problems.add(key, f"a variance cannot be negative, got {variance:g}")
            continue
        result[name] = variance * factor
    if table.side == "belief":
        _refuse_zero(table, kind, result, problems)
    return result


def noise_scale(table: Stated, kind: str, problems: Problems) -> float | None:
    """Return the factor on all variances of a kind, ``None`` if it is wrong."""
    factor = number(table, f"noise.{kind}_scale", "", problems, 1.0)
    if factor is not None and factor < 0:
        problems.add(table.key(f"noise.{kind}_scale"), f"a variance cannot be negative, got {factor:g}")
        return None
    return factor


def input_noise(table: Stated, model: StateSpaceModel, problems: Problems) -> dict[str, float]:
    """Return the variances per sample of the inputs that are stated to be known with noise.

    A rate has none of its own: it is known as well as the signal that it belongs to.
    """
    from harness.common.units import to_si

    given, factor = table.group("noise.input"), noise_scale(table, "input", problems)
    names = [n for n in model.inputs if n not in model.rates and n != "time"]
    readable = (*names, *(n for n in DRIVE_INPUTS if table.side == "plant" and n not in names))
    refuse_unknown(table, "noise.input", given, readable, "input signal", problems)
    variances: dict[str, float] = {}
    for name in (n for n in readable if n in given):
        key = table.key(f"noise.input.{name}")
        with problems.catch(key):
            variance = to_si(given[name], variance_unit(name), problems.at(key))
            if variance < 0:
                problems.add(key, f"a variance cannot be negative, got {variance:g}")
            elif variance * (factor or 0.0) > 0:
                variances[name] = variance * (factor or 0.0)
    return variances


def _refuse_zero(table: Stated, kind: Kind, variances: Mapping[str, float], problems: Problems) -> None:
    """An estimator that holds a measurement for exact, or an unknown input for constant, cannot work."""
    for name, variance in variances.items():
        if variance == 0 and (kind == "measurement" or name in (table["unknown_inputs"] or ())):
            reason = (
                "an estimator cannot divide by a measurement without noise"
                if kind == "measurement"
                else "an unknown input without process noise would stay at its first value"
            )
            problems.add(table.key(f"noise.{kind}.{name}"), f"{reason}; give a positive variance")
