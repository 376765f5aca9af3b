"""Report of a measured car: table 3.3 and figures 3.16 and 3.21 of Sun 2015, then the report of any fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.identification.contract import Fit
from harness.identification.measured_file import SpanTable
from harness.identification.report import report as report_on_fit
from harness.identification.report import spans_sheet
from harness.identification.result import Judged
from harness.models.quantities import quantity
from harness.recordings.check.axle_curves import AxleCurve
from harness.recordings.check.check_report import axle_figure
from harness.reporting import style
from harness.reporting.document import Block, Heading, Prose, Report, Section, Sheet, plain


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
        Section(lambda: [_errors(result)], "How large are the errors of each model?"),
        Section(lambda: [Prose(plain(_steering(result)))], "How is the steering calibrated?"),
        Section(lambda: [spans_sheet({"fitted": spans["train"], "held out": spans["test"]})], "Which drives?"),
        Section(lambda: _stiffness(result), "Where does the search begin, and where does it end?"),
    ]
    return report_on_fit(result.fit, list(result.judged), command, title, evidence)


def _stiffness(result: Identified) -> list[Block]:
    return [
        Heading("Where does the search begin, and where does it end?"),
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
