"""Resolve a ``[plant]`` of somebody else, an FMU or a Python class, into a ``ModelSpec``."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import closest
from harness.common.units import to_si
from harness.config.bounds import out_of_bounds
from harness.config.model import Stated, input_noise, noise_scale, number, refuse_unknown, stated
from harness.config.parameter_set import refuse_unknown_units, variance_unit
from harness.config.problems import Problems, validated
from harness.config.schema import ModelTable
from harness.config.specs import ExternalSpec, ModelSpec
from harness.external import python_plant
from harness.external.description import Description
from harness.external.processes import TIMEOUT
from harness.models.assembly.model import StateSpaceModel
from harness.models.assembly.placement import is_degradation, load_effect
from harness.models.roles import SENSORS

_OF_EQUATIONS = (
    "vehicle",
    "parameters",
    "tyre",
    "unknown_inputs",
    "unknown_parameters",
    "considered_parameters",
)


def is_external(table: ModelTable) -> bool:
    """Whether a table names a plant of somebody else."""
    return table.fmu is not None or table.python is not None


def inherited(plant: Stated) -> Stated:
    """Return what a belief inherits from a plant of somebody else: its step."""
    entries = {name: value for name, value in plant.entries.items() if name == "step"}
    return Stated(plant.side, entries, {name: plant.key(name) for name in entries})


def resolve_external(
    raw: ModelTable, table: Stated, belief: ModelSpec | None, folder: Path, problems: Problems
) -> ModelSpec | None:
    """Return the plant, or ``None`` if a problem with it was noted.

    Sensors, their noise, and the sizes that drives ask for are those of the belief where nothing is stated.

    Args:
        raw: The table ``[plant]``.
        table: What it states.
        belief: The belief, ``None`` where a problem with it was noted.
        folder: Of the study.
        problems: Where problems are noted.
    """
    before = len(problems)
    if raw.fmu is not None and raw.python is not None:
        problems.add("plant.python", "a plant is one thing; state 'fmu' or 'python'")
    for name in ("map", "interface"):
        if getattr(raw, name) is not None and raw.fmu is None:
            problems.add(f"plant.{name}", "this belongs to an FMU; a Python class declares its signals itself")
    for name in _OF_EQUATIONS:
        if table[name]:
            problems.add(f"plant.{name}", "this belongs to a vehicle of the library, not to a plant of somebody else")
    effects = tuple(table["effects"] or ())
    for i, effect in enumerate(effects):
        with problems.catch(f"plant.effects[{i}]"):
            refuse_unknown_units(load_effect(effect))
            if not is_degradation(effect) or effect in effects[:i]:
                problems.add(
                    f"plant.effects[{i}]", "of a plant of somebody else sensors degrade, each way once; remove it"
                )
    if len(problems) > before:
        return None
    description: Description | None = None
    with problems.catch("plant.fmu" if raw.fmu is not None else "plant.python"):
        description = _description(raw, folder, problems)
    timeout = number(table, "timeout", "s", problems, TIMEOUT)
    step = number(table, "step", "s", problems, 0.01 if belief is None else belief.step)
    if timeout is not None and not timeout > 0:
        problems.add("plant.timeout", "a run takes some time; give a positive one, e.g. '60 s'")
    if step is not None and step <= 0:
        problems.add("plant.step", f"the sample time must be positive, e.g. '10 ms', got {raw.step!r}")
    if belief is None or description is None or timeout is None or step is None or len(problems) > before:
        return None
    sizes = {n: getattr(belief, n) for n in ("wheelbase", "steering_ratio") if getattr(description, n) is None}
    description = replace(description, **sizes)
    spec = ModelSpec(
        vehicle="",
        parameters="",
        tyre=None,
        effects=effects,
        sensors=raw.sensors or belief.sensors,
        integrator=raw.integrator or "euler",
        step=step,
        substeps=raw.substeps or 1,
        values={},
        process_noise={},
        measurement_noise={},
        external=ExternalSpec(description, (folder, Path()), timeout),
    )
    model: StateSpaceModel | None = None
    if _sensors_fit(spec, description, problems):
        with problems.catch("plant.effects"):
            model = spec.model()
    if model is None:
        return None
    complete = replace(
        spec,
        values=_values(table, model, description, problems),
        process_noise=_process_noise(table, description, problems),
        measurement_noise=_measurement_noise(table, model, belief, problems),
        input_noise=input_noise(table, model, problems),
    )
    return complete if len(problems) == before else None


def plant_alone(content: Mapping[str, Any], recorded: Collection[str], step: float) -> ModelSpec:
    """Return a plant without a belief, whose sensors are what of its outputs is recorded.

    Args:
        content: Keys of ``[plant]``; files are looked for in the working directory.
        recorded: Signals of the recordings.
        step: Their sample time in s.

    Raises:
        UserError: If anything in it is wrong, or nothing that it publishes is recorded.
    """
    problems = Problems("the plant")
    raw = validated(dict(content), ModelTable, problems)
    problems.stop()
    assert raw is not None
    description = _description(raw, Path(), problems)
    sensors = [p.signal for p in description.outputs if p.signal in recorded]
    if not sensors:
        published = ", ".join(p.signal for p in description.outputs)
        raise UserError(f"nothing that the plant publishes is recorded; it publishes {published}")
    spec = ModelSpec(
        vehicle="",
        parameters="",
        tyre=None,
        effects=(),
        sensors=", ".join(sensors),
        integrator=raw.integrator or "euler",
        step=step,
        substeps=raw.substeps or 1,
        values={},
        process_noise={p.signal: 0.0 for p in description.disturbances},
        measurement_noise=dict.fromkeys(sensors, 0.0),
        external=ExternalSpec(description, (Path(),)),
    )
    table = stated("plant", raw, Path(), problems)
    spec = replace(spec, values=_values(table, spec.model(), description, problems))
    problems.stop()
    return spec


def _description(raw: ModelTable, folder: Path, problems: Problems) -> Description:
    """Return what is known of the plant: from its file, or where a store says it, from there."""
    if raw.described is not None:
        return replace(Description.of(raw.described), file=raw.fmu or raw.python or "")
    if raw.python is not None:
        return python_plant.described(raw.python, (folder, Path()), problems.at("plant.python"))
    from harness.external.fmu import read  # with its extra packages, for an FMU only

    assert raw.fmu is not None
    chosen = None if raw.map is None else _beside(raw.map, folder, problems.at("plant.map"))
    content = None if chosen is None else read_toml(chosen)
    path = _beside(raw.fmu, folder, problems.at("plant.fmu"))
    return read.describe(path, content, str(chosen or path), raw.fmu, raw.interface)


def _beside(name: str, folder: Path, where: str) -> Path:
    """Return the file of a name, next to the study or in the working directory.

    Raises:
        UserError: If there is none.
    """
    for place in (folder, Path()):
        if (place / name).is_file():
            return place / name
    raise UserError(f"{where}: there is no file '{name}' in {folder.absolute()} or in the working directory")


def _sensors_fit(spec: ModelSpec, description: Description, problems: Problems) -> bool:
    before, published = len(problems), [p.signal for p in (*description.outputs, *description.inputs)]
    with problems.catch("plant.sensors"):
        for output, signal in SENSORS.load(spec.sensors).OUTPUTS.items():
            if signal not in published:
                problems.add(
                    "plant.sensors", f"the sensor '{output}' needs '{signal}', which '{description.file}' does not "
                    f"publish{closest(signal, published)}"
                )  # fmt: skip
    return len(problems) == before


def _values(table: Stated, model: StateSpaceModel, description: Description, problems: Problems) -> dict[str, float]:
    given = table.group("values")
    refuse_unknown(table, "values", given, model.parameter_names, "parameter", problems)
    values = {p.name: p.neutral for p in model.parameters if p.neutral is not None}
    values |= {p.name: p.value for p in description.parameters}
    for parameter in model.parameters:
        if parameter.name not in given:
            continue
        key = table.key(f"values.{parameter.name}")
        with problems.catch(key):
            values[parameter.name] = to_si(given[parameter.name], parameter.unit, problems.at(key))
            if (wrong := out_of_bounds(parameter, values[parameter.name])) is not None:
                problems.add(key, wrong)
    return values


def _variances(table: Stated, kind: str, units: dict[str, str], problems: Problems) -> dict[str, float]:
    """Return the variances that are stated, times the factor on all of their kind."""
    given, factor = table.group(f"noise.{kind}"), noise_scale(table, kind, problems)
    refuse_unknown(
        table, f"noise.{kind}", given, tuple(units), "disturbance" if kind == "process" else "output", problems
    )
    variances: dict[str, float] = {}
    for name in (n for n in units if n in given):
        key = table.key(f"noise.{kind}.{name}")
        with problems.catch(key):
            variances[name] = to_si(given[name], units[name], problems.at(key))
            if variances[name] < 0:
                problems.add(key, f"a variance cannot be negative, got {variances[name]:g}")
    return {name: variance * (factor or 0.0) for name, variance in variances.items()}


def _process_noise(table: Stated, description: Description, problems: Problems) -> dict[str, float]:
    """Return variances per step by disturbance, none where none is stated."""
    units = {p.signal: f"({p.unit})**2" if p.unit else "" for p in description.disturbances}
    return dict.fromkeys(units, 0.0) | _variances(table, "process", units, problems)


def _measurement_noise(
    table: Stated, model: StateSpaceModel, belief: ModelSpec, problems: Problems
) -> dict[str, float]:
    """Return variances by output; of those not stated what the belief holds."""
    units = {name: variance_unit(name) for name in model.outputs}
    stated = _variances(table, "measurement", units, problems)
    factor = noise_scale(table, "measurement", problems) or 0.0
    variances = {name: variance * factor for name, variance in belief.measurement_noise.items()} | stated
    for name in model.outputs:
        if name not in variances:
            problems.add(f"plant.noise.measurement.{name}", "no variance is known for this output; add this key")
    return {name: variances.get(name, 0.0) for name in model.outputs}


def external_table(spec: ModelSpec) -> dict[str, Any]:
    """Return the keys by which a store states a plant of somebody else."""
    assert spec.external is not None
    description = spec.external.description
    return {
        description.kind: description.file,
        "timeout": spec.external.timeout,
        "described": description.as_dict(),
        "sensors": spec.sensors,
        "effects": list(spec.effects),
        "integrator": spec.integrator,
        "step": spec.step,
        "substeps": spec.substeps,
        "values": spec.values,
    }
