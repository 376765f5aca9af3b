"""Drives of a study: validate the options, build the profile, refuse what no driver would do.

``python -m harness.simulation.drives studies/drives/robustness.toml`` prints the peaks of every drive of a file on the
reference semitrailer; ``python -m harness.simulation.drives --kinds`` prints the kinds with their options.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from harness.common import registry
from harness.common.errors import ModelError, UserError
from harness.common.files import read_toml
from harness.common.units import registry as unit_registry
from harness.common.units import to_si
from harness.models.assembly.assemble import Model, assemble, symbol
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives._shapes import LIMIT, check_lateral_acceleration, lateral_acceleration
from harness.recordings import readers

if TYPE_CHECKING:
    from harness.config import DriveSpec, ModelSpec

_PACKAGE = "harness.models.drives"

WATCHED = (
    "articulation_angle",
    "yaw_rate_trailer",
    "lateral_acceleration_tractor",
    "lateral_acceleration_trailer",
    "lateral_force_axle_21",
)
"""What ``reference_peaks`` looks at."""


def kinds() -> dict[str, tuple[Option, ...]]:
    """Return every kind of drive with its options."""
    return {name: options_of(name) for name in registry.names(_PACKAGE)}


def options_of(kind: str) -> tuple[Option, ...]:
    """Return the options of a kind; the lateral acceleration limit is one of every kind.

    Raises:
        ModelError: If there is no such kind (with the closest names).
    """
    declared: tuple[Option, ...] = tuple(registry.load(_PACKAGE, kind).OPTIONS)
    return declared if any(o.name == LIMIT.name for o in declared) else (*declared, LIMIT)


def build_drive(kind: str, options: Mapping[str, object], context: DriveContext, where: str = "") -> Profile:
    """Validate a drive's options and return its profile.

    Args:
        kind: File in ``models/drives``.
        options: As a study states them: numbers in SI units, text with a unit, or text.
        context: Vehicle and sampling; ``context.read`` is filled in if absent.
        where: File and drive, named in the errors; by default the kind.

    Raises:
        UserError: If the kind or an option is unknown, absent, out of bounds or of the wrong unit, or a
            recording cannot be read.
        ModelError: If the drive cannot be made from these options, or asks for too much lateral acceleration.
    """
    where = where or f"drive '{kind}'"
    if not context.step > 0 or not context.wheelbase > 0 or not context.steering_ratio > 0:
        raise UserError(
            f"{where}: step, wheelbase and steering ratio must be positive, they are {context.step:g} s, "
            f"{context.wheelbase:g} m and {context.steering_ratio:g}"
        )
    try:
        declared = options_of(kind)
    except ModelError as error:
        raise UserError(f"{where}: {error}") from None
    values = _validate(declared, options, where)
    if context.read is None:
        context = dataclasses.replace(context, read=readers.read)
    module = registry.load(_PACKAGE, kind)
    try:
        profile = module.generate({k: v for k, v in values.items() if _declares(module, k)}, context)
        _check_shape(profile, context.step)
        check_lateral_acceleration(profile, context, values[LIMIT.name])
    except (ModelError, UserError) as error:
        raise type(error)(f"{where}: {error}") from None
    return profile


def profile_of(spec: ModelSpec, drive: DriveSpec) -> Profile:
    """Return a drive as a plant drives it, with the plant's further inputs.

    Args:
        spec: The plant; its wheelbase and steering ratio limit the drive.
        drive: The drive, as a study or the command line states it.

    Raises:
        UserError: As ``build_drive``.
        ModelError: As ``build_drive``.
    """
    vehicle = registry.load("harness.models.vehicles", spec.vehicle)
    context = DriveContext(
        wheelbase=vehicle.wheelbase(spec.values) if hasattr(vehicle, "wheelbase") else 1.0,
        steering_ratio=spec.values.get("steering_ratio", 1.0),
        step=spec.step,
        base=str(drive.base),
    )
    profile = build_drive(drive.kind, drive.options, context, drive.where)
    if not hasattr(vehicle, "drive_inputs"):
        return profile
    return dataclasses.replace(profile, further=vehicle.drive_inputs(profile, context))


def _declares(module: Any, name: str) -> bool:
    return any(o.name == name for o in module.OPTIONS)


def _validate(declared: Sequence[Option], given: Mapping[str, object], where: str) -> dict[str, Any]:
    """Return a value in SI units for every option; refuse unknown and absent keys and wrong values."""
    known = [o.name for o in declared]
    for key in given:
        if key not in known:
            raise UserError(f"{where}: unknown option '{key}'{registry.closest(key, known)}")
    values: dict[str, Any] = {}
    for option in declared:
        if option.name not in given:
            if option.default is None:
                raise UserError(f"{where}: option '{option.name}' is missing: {option.meaning}")
            values[option.name] = option.default
            continue
        value = given[option.name]
        at = f"{where}, {option.name}"
        if option.unit == "text":
            if not isinstance(value, str) or not value:
                raise UserError(f"{at}: expected text, got {value!r}: {option.meaning}")
            values[option.name] = value
            continue
        number = to_si(value, option.unit, at)
        if not option.lower <= number <= option.upper:
            unit = f" {option.unit}" if option.unit else ""
            raise UserError(
                f"{at}: {value!r} lies outside {option.lower:g} to {option.upper:g}{unit}: {option.meaning}"
            )
        values[option.name] = number
    return values


def _check_shape(profile: Profile, step: float) -> None:
    """Refuse a profile that breaks the contract: this is a mistake in the drive's file, not in the study."""
    shapes = {name: np.shape(getattr(profile, name)) for name in ("time", "steering_wheel_angle", "speed")}
    if len(set(shapes.values())) != 1 or len(shapes["time"]) != 1 or shapes["time"][0] < 2:
        raise ModelError(f"time, steering and speed must be vectors of one length, their shapes are {shapes}")
    for name in shapes:
        bad = np.flatnonzero(~np.isfinite(getattr(profile, name)))
        if bad.size:
            raise ModelError(f"{name} is not finite at sample {bad[0]} ({bad.size} in all)")
    grid = np.arange(len(profile.time)) * step
    if np.abs(profile.time - grid).max() > 1e-6 * step:
        n = int(np.argmax(np.abs(profile.time - grid) > 1e-6 * step))
        raise ModelError(f"time is {profile.time[n]:.6f} s at sample {n}, not {grid[n]:.6f} s (step {step:g} s)")
    if profile.speed.min() <= 0:
        n = int(profile.speed.argmin())
        raise ModelError(f"speed is {profile.speed[n]:g} m/s at {profile.time[n]:.2f} s; it must stay positive")


def read_drives(path: str | Path) -> dict[str, tuple[str, dict[str, object]]]:
    """Read the ``[[drive]]`` tables of a TOML file: name to kind and options, in the order of the file.

    Raises:
        UserError: If the file is absent or no TOML, a table lacks ``name`` or ``kind``, or two share a name.
    """
    tables = read_toml(Path(path)).get("drive")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise UserError(f"{path}: holds no [[drive]] table")
    found: dict[str, tuple[str, dict[str, object]]] = {}
    for number, table in enumerate(tables, start=1):
        for key in ("name", "kind"):
            if not isinstance(table.get(key), str):
                raise UserError(f"{path}, [[drive]] number {number}: '{key}' is missing or no text")
        if table["name"] in found:
            raise UserError(f"{path}: two drives are named '{table['name']}'")
        found[table["name"]] = (
            table["kind"],
            {k: v for k, v in table.items() if k not in ("name", "kind")},
        )
    return found


def reference_peaks(
    profiles: Mapping[str, Profile], masses: Sequence[float], parameters: str = "ziaukas_2023"
) -> dict[str, dict[str, Any]]:
    """Drive the reference semitrailer and return the largest magnitudes for each trailer mass.

    Explicit Euler at the drives' own step, without noise; all drives and masses advance together as lanes.

    Args:
        profiles: Drives of one step, by name.
        masses: Trailer masses in kg.
        parameters: File in ``models/parameters``.

    Returns:
        Per drive the signals of ``WATCHED``, each of shape ``(masses,)`` and in SI units; NaN where the run
        left the model's validity.
    """
    values = dict(registry.load("harness.models.parameters", parameters).VALUES)
    model = assemble("semitrailer", "magic_formula")
    right_side = _compile(model, WATCHED)
    names, step = list(profiles), next(iter(profiles.values())).time[1]
    lengths = np.array([len(profiles[n].time) for n in names])
    steering, speed = (
        np.stack([np.pad(getattr(profiles[n], key), (0, lengths.max() - len(profiles[n].time)), "edge") for n in names])
        for key in ("steering_wheel_angle", "speed")
    )
    # The derivative towards the next sample is the one the explicit Euler step needs.
    rate = np.diff(speed, axis=1, append=speed[:, -1:]) / step
    lanes = (len(names), len(masses))
    parameter_lanes = [
        np.broadcast_to(np.asarray(masses, float), lanes) if p == "trailer_mass" else values[p]
        for p in model.parameter_names
    ]
    inputs = {"steering_wheel_angle": steering, "speed": speed, "speed_rate": rate}
    x = np.zeros((len(model.states), *lanes))
    bound = np.array([model.valid.get(s, np.inf) for s in model.states])[:, None, None]
    peak, lost = np.zeros((len(WATCHED), *lanes)), np.zeros(lanes, dtype=bool)
    for k in range(lengths.max()):
        u = [np.broadcast_to(inputs[i][:, k, None], lanes) for i in model.inputs]
        out = right_side(x, u, parameter_lanes)
        running = (k < lengths)[:, None] & ~lost
        peak = np.where(running, np.maximum(peak, np.abs(out[len(model.states) :])), peak)
        x = np.where(running, x + step * out[: len(model.states)], x)
        lost |= running & ~(np.abs(x) <= bound).all(axis=0)
    peak[:, lost] = np.nan
    return {name: dict(zip(WATCHED, peak[:, row], strict=True)) for row, name in enumerate(names)}


def _compile(model: Model, watched: Sequence[str]) -> Any:
    """Return ``f(x, u, p)``: the derivatives and then the watched quantities, stacked, for lanes."""
    arguments = [[symbol(n) for n in group] for group in (model.states, model.inputs, model.parameter_names)]
    ports = [(symbol(name), expression) for name, expression in model.ports.items()]
    expressions = [*model.derivatives, *(model.resolve(w) for w in watched)]
    # The ports, already in order of use, serve as the common subexpressions.
    function = sp.lambdify(arguments, expressions, "numpy", cse=lambda wanted: (ports, wanted))

    def stacked(x: Any, u: Any, p: Any) -> Any:
        return np.stack([np.broadcast_to(value, x.shape[1:]) for value in function(list(x), u, p)])

    return stacked


def table(path: str | Path, masses: Sequence[float] = (8e3, 24e3, 32e3)) -> str:
    """Return the Markdown table of a drive file's peaks on the reference semitrailer.

    Raises:
        UserError: As ``read_drives`` and ``build_drive``.
        ModelError: As ``build_drive``.
    """
    values = registry.load("harness.models.parameters", "ziaukas_2023").VALUES
    vehicle = registry.load("harness.models.vehicles", "semitrailer")
    context = DriveContext(vehicle.wheelbase(values), values["steering_ratio"], base=str(Path(path).parent))
    drives = read_drives(path)
    profiles = {
        name: build_drive(kind, options, context, f"{path}, drive '{name}'") for name, (kind, options) in drives.items()
    }
    peaks = reference_peaks(profiles, masses)

    def cells(row: Any, factor: float = 1.0, digits: int = 1) -> str:
        return " / ".join("lost" if np.isnan(v) else f"{v * factor:.{digits}f}" for v in row)

    at = " / ".join(f"{m / 1e3:g}" for m in masses)
    lines = [
        f"Largest magnitudes at a trailer mass of {at} t:",
        "",
        "| drive | kind | length in s | speed in m/s | steering wheel in deg "
        "| lateral acceleration in m/s²: kinematic | tractor | trailer "
        "| articulation in deg | yaw rate of the trailer in deg/s | force of axle 21 in kN |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, (kind, _) in drives.items():
        profile, found = profiles[name], peaks[name]
        slow, fast = profile.speed.min(), profile.speed.max()
        lines.append(
            f"| `{name}` | `{kind}` | {profile.time[-1]:.0f} "
            f"| {slow:.1f}{f' to {fast:.1f}' if fast - slow > 0.05 else ''} "
            f"| {np.degrees(np.abs(profile.steering_wheel_angle).max()):.0f} "
            f"| {np.abs(lateral_acceleration(profile, context)).max():.2f} "
            f"| {cells(found['lateral_acceleration_tractor'], 1, 2)} "
            f"| {cells(found['lateral_acceleration_trailer'], 1, 2)} "
            f"| {cells(found['articulation_angle'], 180 / np.pi)} "
            f"| {cells(found['yaw_rate_trailer'], 180 / np.pi)} "
            f"| {cells(found['lateral_force_axle_21'], 1e-3)} |"
        )
    return "\n".join(lines)


def kinds_table() -> str:
    """Return the Markdown description of every kind of drive with its options."""
    lines: list[str] = []
    for kind, options in kinds().items():
        summary = str(registry.load(_PACKAGE, kind).__doc__).split("\n\n")[0].replace("\n", " ")
        lines += [
            f"### `{kind}`",
            "",
            summary,
            "",
            "| option | default | allowed | meaning |",
            "|---|---|---|---|",
        ]
        lines += [f"| `{o.name}` | {_default(o)} | {_bounds(o)} | {o.meaning} |" for o in options]
        lines.append("")
    return "\n".join(lines).rstrip()


def _shown(option: Option, value: float) -> tuple[float, str]:
    """Return a number and its unit as a study would write it: angles in degrees, factors as they are."""
    shown = {"rad": "deg", "rad/s": "deg/s"}.get(option.unit, option.unit)
    if shown == option.unit or option.name.endswith("_scale"):
        return value, option.unit
    return float(unit_registry().Quantity(value, option.unit).to(shown).magnitude), shown


def _default(option: Option) -> str:
    if option.default is None:
        return "required"
    if option.unit == "text":
        return f"`{option.default}`"
    value, unit = _shown(option, option.default)
    return f"{value:.6g} {unit}".strip() if np.isfinite(value) else "none"


def _bounds(option: Option) -> str:
    if option.unit == "text":
        return "text"
    (lower, _), (upper, unit) = _shown(option, option.lower), _shown(option, option.upper)
    span = f"{lower:.6g} to {upper:.6g}" if np.isfinite(upper) else f"from {lower:.6g}"
    return f"{span} {unit}".strip()


def main(arguments: Sequence[str]) -> int:
    """Print the tables of the documentation; return the exit status."""
    if len(arguments) != 1:
        print("usage: python -m harness.simulation.drives (--kinds | FILE.toml)", file=sys.stderr)
        return 2
    try:
        print(kinds_table() if arguments[0] == "--kinds" else table(arguments[0]))
    except (UserError, ModelError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
