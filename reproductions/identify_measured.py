"""Identify a measured car as Sun 2015, section 3.3, and write data and report: table 3.3, figures 3.16 and 3.21.

``python -m reproductions.identify_measured studies/identify/genesis.toml --out results/identify-genesis`` identifies
the car of a file and writes what ``harness identify`` does. Where the folder of the recordings is absent it says so and
exits with status 0.

The published car, its cornering stiffnesses started from the slopes of its axle curves; the free parameters of the
file are fitted to the drives it names and judged on the held-out ones. Steering factor and offset (3.48) are
parameters: ``steering_ratio`` and ``steering_offset``.
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.stages import showing
from harness.config import ModelSpec
from harness.identification.contract import Fit, Problem, load_method, settings_of
from harness.identification.data import DriveData
from harness.identification.filtered_model import Candidates
from harness.identification.innovations import Innovations
from harness.identification.measured_file import MeasuredStudy, SpanTable, names_of
from harness.identification.report import report as report_on_fit
from harness.identification.report import spans_sheet
from harness.identification.result import Judged, judge, judged_on, write_outcome
from harness.models.quantities import quantity
from harness.recordings.check.axle_curves import GRAVITY, AxleCurve, Slope, axles_of
from harness.recordings.check.check_report import axle_figure
from harness.reporting import style
from harness.reporting.document import Block, Prose, Report, Section, Sheet, plain


@dataclass(frozen=True)
class Identified:
    """A measured car, identified.

    Attributes:
        published: The car as published.
        fit: What was found; it began at the published car with the slopes of ``axles_before``.
        judged: Every drive at the first and at the found values.
        published_error: Simulation error of the published model on each of these drives, root mean square ``(ny,)``.
        axles_before: Axle curves of the fitted drives by the published car.
        axles_after: The same by the car found, with the lines of the stiffnesses found.
    """

    published: ModelSpec
    fit: Fit
    judged: tuple[Judged, ...]
    published_error: tuple[Floats, ...]
    axles_before: tuple[AxleCurve, ...]
    axles_after: tuple[AxleCurve, ...]


def report(result: Identified, title: str, spans: Mapping[str, Sequence[SpanTable]], command: str) -> Report:
    """Return the report.

    Args:
        result: What was identified.
        title: The question.
        spans: The drives by what they were used for.
        command: How it was made.
    """
    evidence = [
        Section(lambda: [_errors(result)], "How large are the errors of each model?", headed=False),
        Section(lambda: [Prose(plain(_steering(result)))], "How is the steering calibrated?", headed=False),
        Section(
            lambda: [spans_sheet({"fitted": spans["train"], "held out": spans["test"]})], "Which drives?", headed=False
        ),
        Section(lambda: _stiffness(result), "Where does the search begin, and where does it end?"),
    ]
    return report_on_fit(result.fit, list(result.judged), command, title, evidence)


def _stiffness(result: Identified) -> list[Block]:
    return [
        Prose(plain(_slopes(result))),
        axle_figure(result.axles_before, title="How stiff are the axles with the published parameters?"),
        axle_figure(
            result.axles_after, "identified stiffness", "How stiff are the axles with the identified parameters?"
        ),
    ]


def _errors(result: Identified) -> Sheet:
    """Return table 3.3 with the fitted and the held-out drives."""
    rows = []
    outputs = list(result.published.model().outputs)
    for judged, published in zip(result.judged, result.published_error, strict=True):
        for a, name in enumerate(outputs):
            q = quantity(name)
            errors = (published[a], *judged.free_error[:, a])
            role = "held out" if judged.held_out else "fitted"
            rows.append([judged.drive.name, role, q.words, q.unit, *(style.number(q.scale * e) for e in errors)])
    header = ["drive", "role", "output", "unit", "published", "from slopes", "identified"]
    caption = (
        "Simulation error, root mean square of measurement minus free run (table 3.3 of Sun): as published, with the "
        "initial stiffnesses of the search, and as identified. "
        "A free run that leaves the range in which the equations hold counts up to then."
    )
    return Sheet(header, rows, caption, left=4)


def _steering(result: Identified) -> str:
    """State factor and offset of the steering calibration (3.48)."""
    stated, values = result.published.values, result.fit.spec.values
    factor = stated["steering_ratio"] / values["steering_ratio"]
    offset = math.degrees(values.get("steering_offset", 0.0))
    return (
        f"Steering: the road wheels turn {style.number(factor)} times the recorded angle (steering ratio "
        f"{style.number(stated['steering_ratio'])} as stated, {style.number(values['steering_ratio'])} identified) "
        f"plus {style.number(offset)}°."
    )


def _slopes(result: Identified) -> str:
    """State the slopes before and after (3.46, 3.47)."""
    parts = []
    for before, after in zip(result.axles_before, result.axles_after, strict=True):
        assert after.slope is not None
        began = "no line by the published car" if before.slope is None else f"{_slope(before)} by the published car"
        parts.append(f"{before.name} axle: {began}, {_slope(after)} identified")
    return f"Lateral force over load per slip angle: {'; '.join(parts)}."


def _slope(axle: AxleCurve) -> str:
    assert axle.slope is not None
    return f"{style.number(axle.slope.value)} 1/rad (points correlate by {axle.slope.correlation:.2f})"


def identified(study: MeasuredStudy, jobs: int | None, say: Callable[[str], None]) -> Identified:
    """Return the car of a file, identified."""
    say("reading the recordings")
    recordings = study.drives()
    train, test = recordings["train"], recordings["test"]
    published, free = study.nominal(), study.fitted_parameters()
    before = axles_of(train, published.values, str(study.path))
    say("compiling")
    innovations = Innovations(from_slopes(published, before), jobs=jobs)
    drives = [
        innovations.drive(r, name, "joined") for r, name in zip(train + test, names_of(train + test), strict=True)
    ]
    fitted, held_out = tuple(drives[: len(train)]), tuple(drives[len(train) :])
    problem, method = Problem(innovations, fitted, free), load_method(study.raw.method)
    fit = method.identify(problem, settings_of(method, study.raw.settings), say)
    judged = judge(problem, fit, held_out)
    errors = [_alone(innovations, published, j.drive) for j in judged]
    after = axles_of([calibrated(r, fit.spec.values) for r in train], fit.spec.values, str(study.path))
    lines = [replace(axle, slope=_line(axle, fit.spec.values)) for axle in after]
    outputs = list(published.model().outputs)
    further = {
        **fit.further,
        "published_free_running_rmse": {
            j.drive.name: dict(zip(outputs, e.tolist(), strict=True)) for j, e in zip(judged, errors, strict=True)
        },
    }
    return Identified(
        published, replace(fit, further=further), tuple(judged), tuple(errors), tuple(before), tuple(lines)
    )


def _alone(innovations: Innovations, spec: ModelSpec, drive: DriveData) -> Floats:
    """Return the root mean square simulation error of a model on a drive ``(ny,)``."""
    return judged_on(innovations, [drive], Candidates.of(spec))[0].simulation_error


def static_load(values: Mapping[str, float], end: str) -> float:
    """Return the vertical load of an axle at rest in N."""
    front, rear = values["cog_to_front_axle"], values["cog_to_rear_axle"]
    return values["mass"] * GRAVITY * (rear if end == "front" else front) / (front + rear)


def _growth(values: Mapping[str, float], end: str) -> float:
    """Return the stiffness at the static load over its peak (Ziaukas 2023, 4.6)."""
    return math.sin(2 * math.atan(static_load(values, end) / values[f"stiffness_load_{end}"]))


def from_slopes(spec: ModelSpec, axles: Sequence[AxleCurve]) -> ModelSpec:
    """Return the model with the cornering stiffnesses of its axle curves; an axle without a line keeps its own."""
    stiffnesses = {
        f"stiffness_peak_{a.name}": a.slope.value * static_load(spec.values, a.name) / _growth(spec.values, a.name)
        for a in axles
        if a.slope is not None
    }
    return replace(spec, values={**spec.values, **stiffnesses})


def _line(axle: AxleCurve, values: Mapping[str, float]) -> Slope:
    """Return the identified stiffness as the line of an axle curve."""
    slope = values[f"stiffness_peak_{axle.name}"] * _growth(values, axle.name) / static_load(values, axle.name)
    finite = np.isfinite(axle.slip) & np.isfinite(axle.share)
    return Slope(slope, float(np.corrcoef(axle.slip[finite], axle.share[finite])[0, 1]), 0.0, int(finite.sum()))


def calibrated(recording: xr.Dataset, values: Mapping[str, float]) -> xr.Dataset:
    """Return a recording freed of what was identified of its sensors: steering (3.48), zeros, and the lever arm.

    An accelerometer whose zero was found tells the force of the tyres on a banked road too, where velocities do not.
    """
    signals = {
        n: recording[n] - values.get(f"sensor_bias_{n}", 0.0)
        for n in ("yaw_rate", "lateral_velocity", "lateral_acceleration")
        if n in recording and (f"sensor_bias_{n}" in values or n != "lateral_acceleration")
    }
    signals["lateral_velocity"] = signals["lateral_velocity"] - values["reference_from_cog"] * signals["yaw_rate"]
    steered = recording["steering_wheel_angle"] / values["steering_ratio"] + values.get("steering_offset", 0.0)
    return recording.assign({**signals, "road_wheel_angle": steered})


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.identify_measured", description=__doc__)
    parser.add_argument("file", type=Path, help="such as studies/identify/genesis.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--jobs", type=int, default=None, help="threads; all cores if absent")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Identify as the file says and write data and report."""
    chosen = _arguments().parse_args(arguments)
    study = MeasuredStudy.read(chosen.file)
    if study.absent:
        print(study.absent)
        return
    with showing(Console(stderr=True), "starting") as show:
        result = identified(study, chosen.jobs, show)
    command = f"python -m reproductions.identify_measured {shlex.join(arguments)}"
    names = ", ".join(j.drive.name for j in result.judged if not j.held_out)
    source = f"{study.path}, method {result.fit.method}, on {names}"
    write_outcome(chosen.out, result.fit, list(result.judged), source)
    report(result, study.raw.title, study.spans(), command).write(chosen.out)
    print(f"wrote {chosen.out}/report.html")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
