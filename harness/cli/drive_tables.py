"""Tables of ``docs/drives.md``: the peaks of the drives of a file, and the kinds of drives with their options.

``python -m harness.cli.drive_tables studies/drives/robustness.toml`` prints the peaks of every drive of a file on the
reference semitrailer; ``python -m harness.cli.drive_tables --kinds`` prints the kinds with their options.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.units import registry as unit_registry
from harness.models.assembly.assemble import StateSpaceModel, assemble, symbol
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drive_options import kinds
from harness.models.drives._shapes import lateral_acceleration
from harness.models.roles import DRIVES, PARAMETERS, VEHICLES
from harness.simulation.drives import build_drive, read_drives

WATCHED = (
    "articulation_angle",
    "yaw_rate_trailer",
    "lateral_acceleration_tractor",
    "lateral_acceleration_trailer",
    "lateral_force_axle_21",
)
"""What ``reference_peaks`` looks at."""


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
    values = dict(PARAMETERS.load(parameters).VALUES)
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
    bound = model.limits[:, None, None]
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


def _compile(model: StateSpaceModel, watched: Sequence[str]) -> Any:
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
    values = PARAMETERS.load("ziaukas_2023").VALUES
    vehicle = VEHICLES.load("semitrailer")
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
        profile, largest = profiles[name], peaks[name]
        slow, fast = profile.speed.min(), profile.speed.max()
        lines.append(
            f"| `{name}` | `{kind}` | {profile.time[-1]:.0f} "
            f"| {slow:.1f}{f' to {fast:.1f}' if fast - slow > 0.05 else ''} "
            f"| {np.degrees(np.abs(profile.steering_wheel_angle).max()):.0f} "
            f"| {np.abs(lateral_acceleration(profile, context)).max():.2f} "
            f"| {cells(largest['lateral_acceleration_tractor'], 1, 2)} "
            f"| {cells(largest['lateral_acceleration_trailer'], 1, 2)} "
            f"| {cells(largest['articulation_angle'], 180 / np.pi)} "
            f"| {cells(largest['yaw_rate_trailer'], 180 / np.pi)} "
            f"| {cells(largest['lateral_force_axle_21'], 1e-3)} |"
        )
    return "\n".join(lines)


def kinds_table() -> str:
    """Return the Markdown description of every kind of drive with its options."""
    lines: list[str] = []
    for kind, options in kinds().items():
        summary = str(DRIVES.load(kind).__doc__).split("\n\n")[0].replace("\n", " ")
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


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Print the tables of the documentation."""
    parser = Parser(
        prog="python -m harness.cli.drive_tables", description="Tables of the drives of a file, or of the kinds"
    )
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--kinds", action="store_true", help="the kinds of drives with their options")
    wanted.add_argument("file", nargs="?", help="such as studies/drives/robustness.toml: the peaks of its drives")
    chosen = parser.parse_args(arguments)
    print(kinds_table() if chosen.kinds else table(chosen.file))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
