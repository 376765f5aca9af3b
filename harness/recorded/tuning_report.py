"""The file, the numbers and the report of ``harness tune --data``: which noise, how certain, what it changes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D

from harness.common.arrays import Floats
from harness.common.files import json_text, write_files
from harness.config.parameter_set import set_text
from harness.models.quantities import capital, quantity, words
from harness.recorded.run import SMOOTHED
from harness.recorded.summary import Consistency
from harness.recorded.tuning import NoiseTuning, Variance
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Listing,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
    strong,
)


def parameter_file(tuning: NoiseTuning) -> str:
    """Return the text of a parameter file with the noise found, which studies and ``harness estimate`` load."""
    drives = ", ".join(d.name for d in tuning.drives)
    noise = {(f"{v.kind}_noise", name): _comment(v, i) for v in tuning.variances for i, name in enumerate(v.names)}
    return set_text(tuning.spec, f"noise by harness tune --data on {drives}", {}, noise)


def _comment(v: Variance, i: int) -> str:
    unit = f"{v.unit}{' per step' if v.kind == 'process' else ''}"
    if not v.held:
        return f"{unit}; 95 % interval {v.lower[i]:.3g} to {v.upper[i]:.3g}"
    if v.contradicted:
        return f"{unit}; not determined; stated {v.stated[i]:.3g} is contradicted, this is the nearest that is not"
    return f"{unit}; not determined, left as stated"


def record(tuning: NoiseTuning) -> dict[str, Any]:
    """Return what was found as JSON holds it; SI units."""
    return {
        "answer": tuning.answer,
        "model": tuning.spec.model().name,
        "step": tuning.spec.step,
        "converged": tuning.converged,
        "log_likelihood": {"before": tuning.log_likelihood[0], "after": tuning.log_likelihood[1]},
        "variances": [
            {
                "kind": v.kind,
                "of": list(v.names),
                "unit": v.unit,
                "stated": v.stated.tolist(),
                "value": v.value.tolist(),
                "interval_95": [_ends(v.lower), _ends(v.upper)],
                "standard_error_of_logarithm": v.error,
                "verdict": v.verdict,
                "reason": v.reason,
                "held": v.held,
                "stated_value_contradicted": v.contradicted,
            }
            for v in tuning.variances
        ],
        "recordings": [
            {"name": b.name, "before": _consistency(b), "after": _consistency(a)}
            for b, a in zip(tuning.before, tuning.after, strict=True)
        ],
        "notes": list(tuning.notes),
        "comment": SMOOTHED,
    }


def _ends(values: Floats) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]


def _consistency(c: Consistency) -> dict[str, Any]:
    return {
        "nis_over_degrees": c.nis,
        "nis_inside_95": c.inside,
        "samples": c.samples,
        "whitened_innovations": {n: w.record for n, w in c.outputs.items()},
    }


def write_tuning(path: Path, tuning: NoiseTuning) -> list[Path]:
    """Write the parameter file, and next to it ``<name>.json`` with every number; return their paths.

    Raises:
        UserError: If they cannot be written.
    """
    contents = {path.name: parameter_file(tuning), f"{path.stem}.json": json_text(record(tuning))}
    return write_files(path.parent, contents)


def report(tuning: NoiseTuning, command: str) -> Report:
    """Return the report.

    Args:
        tuning: What was found.
        command: How it was made, for the last section.
    """
    sections = [
        Section(lambda: _answer(tuning), "How noisy are the model and its sensors?"),
        Section(lambda: _variances(tuning), "Which variances?"),
        Section(lambda: _consistencies(tuning), "Do the innovations fit?"),
        Section(lambda: _made(tuning, command), "How was it made?"),
    ]
    return Report(f"How noisy are the model of {words(tuning.spec.vehicle)} and its sensors?", sections)


def _answer(tuning: NoiseTuning) -> list[Block]:
    return [
        Prose(strong(tuning.answer)),
        Prose(plain(SMOOTHED)),
    ]


def _variances(tuning: NoiseTuning) -> list[Block]:
    rows = []
    for v in tuning.variances:
        for i, name in enumerate(v.names):
            q = quantity(name)
            stated, value, low, high = (q.scale * math.sqrt(x[i]) for x in (v.stated, v.value, v.lower, v.upper))
            ends = f"{style.number(low)} to {style.number(high)}" if not v.held else "–"
            source = "found" if not v.held else "nearest allowed" if v.contradicted else "as stated"
            kind = "process, per step" if v.kind == "process" else "measurement"
            rows.append([q.words, kind, q.unit, style.number(stated), style.number(value), ends, source, v.verdict])
    header = ["noise of", "kind", "unit", "stated", "now", "95 % interval", "source", "these recordings"]
    caption = (
        "Standard deviations: roots of the variances. Intervals are those of the profile likelihood with all variances "
        "free; a variance counts as determined where its interval is within a factor of three."
    )
    remarks = [f"{capital(v.label)}: {v.reason}." for v in tuning.variances if v.held]
    blocks: list[Block] = [
        Sheet(header, rows, caption, left=3),
        Drawing(
            lambda: _picture(tuning),
            "What was found over what was stated, as variances, with 95 % intervals; hollow: not determined, held.",
            "Ratio of each variance to its stated value with its 95 % interval.",
        ),
    ]
    return [*blocks, Bullets([plain(r) for r in remarks])] if remarks else blocks


def _picture(tuning: NoiseTuning) -> bytes:
    n = len(tuning.variances)
    with style.drawing():
        fig = style.figure(min(style.TALLEST, 1.1 + 0.26 * n))
        axes = fig.subplots()
        axes.axvline(1.0, color=style.TRUTH, lw=0.8)
        for i, v in enumerate(tuning.variances):
            ratio = v.value[0] / v.stated[0]
            face = "white" if v.held else "#0072B2"
            if not v.held:
                axes.plot([v.lower[0] / v.stated[0], v.upper[0] / v.stated[0]], [i, i], color="#0072B2", lw=1.6)
            axes.plot([ratio], [i], marker="o", ms=5, mfc=face, mec="#0072B2", ls="")
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_yticks(range(n), [v.label for v in tuning.variances])
        axes.invert_yaxis()
        axes.set_xlabel("variance over its stated value")
        axes.grid(True, axis="x")
        handles = [
            Line2D([], [], color="#0072B2", marker="o", lw=1.6, label="determined"),
            Line2D([], [], ls="", marker="o", mfc="white", mec="#0072B2", label="held"),
        ]
        style.head(fig, "How far are the variances from the stated ones?", handles)
        return style.svg(fig)


def _consistencies(tuning: NoiseTuning) -> list[Block]:
    rows, white = [], []
    for b, a in zip(tuning.before, tuning.after, strict=True):
        shares = [style.number(b.nis), style.number(a.nis), style.percent(b.inside), style.percent(a.inside)]
        rows.append([b.name, str(b.samples), *shares])
        for name in b.outputs:
            numbers = [f(getattr(c.outputs[name], part)) for f, part in _TESTS for c in (b, a)]
            white.append([b.name, words(name), *numbers])
    return [
        Sheet(
            ["recording", "samples", "NIS/dof before", "after", "in 95 % band before", "after"],
            rows,
            "NIS over its degrees of freedom is 1, and 95 % of the samples lie in the band, if the noise is right.",
        ),
        Sheet(
            ["recording", "output", "variance before", "after", "p, Ljung-Box before", "after", "p, periodogram before",
             "after"],
            white,
            "Whitened innovations; those of a right model with the right noise are white (large p) with variance 1.",
            left=2,
        ),
    ]  # fmt: skip


_TESTS = ((style.number, "variance"), (style.probability, "ljung_box"), (style.probability, "periodogram"))


def _made(tuning: NoiseTuning, command: str) -> list[Block]:
    before, after = tuning.log_likelihood
    text = (
        f"Largest likelihood of the innovations of an extended Kalman filter: {style.number(before, 6)} with the "
        f"stated noise, {style.number(after, 6)} with that found, {'' if tuning.converged else 'not '}converged. "
        f"Recorded inputs {'run straight between samples' if tuning.model.inputs == 'joined' else 'are held'}."
    )
    notes: list[Block] = [Bullets([plain(n) for n in tuning.notes])] if tuning.notes else []
    return [Prose(plain(text)), *notes, Listing(command, "sh")]
