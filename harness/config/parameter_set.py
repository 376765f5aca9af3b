"""Parameter sets: a file of ``models/parameters``, or a TOML file, read and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from harness.common import registry
from harness.common.components import place_of
from harness.common.errors import MissingFileError, ModelError, UserError
from harness.common.files import read_toml, toml_text
from harness.common.units import scale
from harness.config.problems import Problems, validated
from harness.config.schema import ParameterFile
from harness.config.specs import ModelSpec
from harness.models.assembly.placement import OF_SIGNAL, load_effect, possible_parameters
from harness.models.roles import DEGRADATIONS, EFFECTS, PARAMETERS, SENSORS, TYRES, VEHICLES
from harness.models.signals import SIGNALS


@dataclass(frozen=True)
class ParameterSet:
    """A set of values with its noise, from ``models/parameters`` or a TOML file.

    ``tyre``, ``effects`` and ``sensors`` come with it where it names them; ``source`` is the place errors name when one
    of its values is wrong. ``std`` holds how well values are known, where that is stated, and ``warning`` what whoever
    takes them has to know. ``unsure`` has what an estimator with these values is not sure of, by ``UNSURE``.
    """

    vehicle: str = ""
    values: dict[str, float] = field(default_factory=dict)
    process: dict[str, float] = field(default_factory=dict)
    measurement: dict[str, float] = field(default_factory=dict)
    noise_step: float = 0.01
    source: str = ""
    tyre: str | None = None
    effects: tuple[str, ...] = ()
    sensors: str | None = None
    std: dict[str, float] = field(default_factory=dict)
    warning: str = ""
    unsure: dict[str, list[Any]] = field(default_factory=dict)


UNSURE = ("unknown_inputs", "unknown_parameters", "considered_parameters")
"""Keys of ``[belief]`` that a parameter file may state as well; they count for estimators alone."""


def load_set(name: str, folder: Path, where: str) -> ParameterSet:
    """Return a set by the name of a file in ``models/parameters`` or the path of a TOML file; none by no name.

    Args:
        name: Name or path.
        folder: Folder in which the file is looked for first, then in the working directory.
        where: File and key that name it, for errors.

    Raises:
        UserError: If the file is absent or anything in it is wrong.
        ModelError: If there is no set of that name.
    """
    if not name:
        return ParameterSet()
    return set_from_file(name, folder, where) if name.endswith(".toml") else published_set(name)


def published_set(name: str) -> ParameterSet:
    """Return the set of a file in ``models/parameters``.

    Raises:
        ModelError: If there is no such file or it is incomplete.
    """
    module = PARAMETERS.load(name)
    return ParameterSet(
        vehicle=module.VEHICLE,
        values=dict(module.VALUES),
        process=dict(module.PROCESS_NOISE),
        measurement=dict(module.MEASUREMENT_NOISE),
        noise_step=float(module.NOISE_STEP),
        source=f"models/parameters/{name}.py",
        tyre=getattr(module, "TYRE", None),
        std=dict(getattr(module, "STD", {})),
    )


def set_from_file(name: str, folder: Path, where: str) -> ParameterSet:
    """Return the set of a TOML file.

    Args:
        name: Path, from the folder or from the working directory.
        folder: Folder of the study.
        where: File and key of the study that names it, for errors.

    Raises:
        UserError: If the file is absent or anything in it is wrong.
    """
    from harness.common.units import to_si

    path = next((p for p in (folder / name, Path(name)) if p.is_file()), None)
    if path is None:
        raise MissingFileError(f"{where}: there is no parameter file '{name}' in {folder} or the working directory")
    inner = Problems(str(path))
    raw = validated(read_toml(path), ParameterFile, inner)
    inner.stop()
    assert raw is not None
    units = _parameter_units(raw.vehicle)
    numbers: dict[str, dict[str, float]] = {"values": {}, "std": {}, "process_noise": {}, "measurement_noise": {}}
    for group, target in numbers.items():
        for item, value in getattr(raw, group).items():
            key = f"{group}.{item}"
            with inner.catch(key):
                of_parameter = group in ("values", "std")
                if of_parameter and item not in units:
                    raise UserError(
                        f"'{raw.vehicle}' has no parameter '{item}' with any tyre or effect"
                        f"{registry.closest(item, list(units))}"
                    )
                unit = units[item] if of_parameter else variance_unit(item)
                target[item] = to_si(value, unit, inner.at(key))
                if group == "std" and not target[item] > 0:
                    raise UserError(f"a standard deviation must be positive, got {target[item]:g} {unit}".rstrip())
    if raw.tyre is not None:
        with inner.catch("tyre"):
            TYRES.load(raw.tyre)
    if raw.sensors is not None:
        with inner.catch("sensors"):
            SENSORS.load(raw.sensors)
    for i, effect in enumerate(raw.effects):
        with inner.catch(f"effects[{i}]"):
            load_effect(effect)
    step = 0.01
    with inner.catch("noise_step"):
        step = to_si(raw.noise_step, "s", inner.at("noise_step"))
        if step <= 0:
            raise UserError(f"must be positive, got {step:g} s")
    inner.stop()
    return ParameterSet(
        raw.vehicle,
        numbers["values"],
        numbers["process_noise"],
        numbers["measurement_noise"],
        step,
        str(path),
        raw.tyre,
        tuple(raw.effects),
        raw.sensors,
        numbers["std"],
        raw.warning,
        {key: stated for key in UNSURE if (stated := getattr(raw, key))},
    )


RELATIVE_STD = 0.1
"""Standard deviation of a value over the value, where its set does not state how well it is known."""


def set_std(spec: ModelSpec, folder: Path | None = None) -> dict[str, float]:
    """Return the standard deviations that the parameter set of a model states, SI units, by parameter.

    A parameter file is looked for next to the study, in ``folder``, then in the working directory.
    """
    return load_set(spec.parameters, folder or Path(), "parameters").std


def stated_std(spec: ModelSpec) -> dict[str, float]:
    """Return the standard deviation with which each value of a model is known before recordings, SI units.

    It is the one that its parameter set states; elsewhere a tenth of the value, and of what is zero a tenth of the
    larger bound.
    """
    stated, std = set_std(spec), {}
    for p in spec.model().parameters:
        size = abs(spec.values[p.name]) or max(abs(p.lower), abs(p.upper))
        std[p.name] = stated.get(p.name, RELATIVE_STD * size)
    return std


def set_text(
    spec: ModelSpec,
    source: str,
    comments: Mapping[str, str],
    noise: Mapping[tuple[str, str], str] | None = None,
    warning: str = "",
    further: Mapping[str, Any] | None = None,
) -> str:
    """Return the text of a parameter file that holds a model: values, tyre, effects and noise.

    States and outputs that the model does not have keep the noise of its own set, so that studies may add sensors and
    unknown inputs; for the same reason the file states no sensors.

    Args:
        spec: The model; a parameter file of its own is found from the working directory.
        source: Where the values come from.
        comments: What stands behind a value, such as unit and standard error, by parameter; others are passed over.
        noise: What stands behind a variance, by ``process_noise`` or ``measurement_noise`` and state or output.
        warning: What whoever takes the values has to know.
        further: More keys of a parameter file, such as ``sensors`` and ``UNSURE``.
    """
    base = load_set(spec.parameters, Path(), source)
    stretch = 1.0 if spec.model().discrete else spec.step / base.noise_step
    process = {n: v * stretch for n, v in base.process.items()}
    process |= {n: v for n, v in spec.process_noise.items() if n in SIGNALS}
    content = {
        "vehicle": spec.vehicle,
        **({"tyre": spec.tyre} if spec.tyre else {}),
        **({"effects": list(spec.effects)} if spec.effects else {}),
        "source": source,
        **({"warning": warning} if warning else {}),
        **(further or {}),
        "noise_step": spec.step,
        "values": spec.values,
        **({"std": std} if (std := {n: s for n, s in base.std.items() if n in spec.values}) else {}),
        "process_noise": process,
        "measurement_noise": base.measurement | spec.measurement_noise,
    }
    behind: dict[tuple[str, ...], str] = {("values", n): words for n, words in comments.items() if n in spec.values}
    held = {"process_noise": process, "measurement_noise": spec.measurement_noise}
    behind |= {(kind, n): words for (kind, n), words in (noise or {}).items() if n in held[kind]}
    return toml_text(content, comments=behind)


def _parameter_units(vehicle: str) -> dict[str, str]:
    """Return the unit of every parameter the vehicle can have with any tyre and any effect."""
    module = VEHICLES.load(vehicle)
    units = {p.name: p.unit for p in module.PARAMETERS}
    for tyre in TYRES.names():
        for p in TYRES.load(tyre).PARAMETERS:
            units |= {f"{p.name}_{group}": p.unit for group in module.AXLES.values()}
    for effect in (*EFFECTS.names(), *DEGRADATIONS.names()):
        units |= {p.name: p.unit for p in possible_parameters(load_effect(effect), module)}
    return units


def variance_unit(signal: str) -> str:
    """Return the unit of a signal's variance; a signal not in the table takes plain numbers only."""
    unit = SIGNALS[signal].unit if signal in SIGNALS else ""
    return f"({unit})**2" if unit not in ("", "dimensionless") else ""


def refuse_unknown_units(effect: ModuleType) -> None:
    """Refuse an effect or degradation with a parameter in a unit that there is not, before a value of it is read.

    Raises:
        ModelError: If it has one.
    """
    for parameter in effect.PARAMETERS:
        try:
            if parameter.unit != OF_SIGNAL:
                scale(parameter.unit, parameter.unit, parameter.name)
        except UserError:
            raise ModelError(
                f"{place_of(effect)}: parameter '{parameter.name}': '{parameter.unit}' is no unit; write one such "
                "as 'kg*m^2', or 'dimensionless'"
            ) from None
