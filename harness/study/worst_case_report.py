"""The report of ``harness tune --objective worst-case``: what the worst case gains, and what that costs at home."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from harness.common.arrays import Floats
from harness.config import NOISE_GROUPS, DesignSpec, StudySpec
from harness.models.quantities import listed, words
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Drawing, Prose, Report, Section, Sheet, plain, strong
from harness.reporting.style import in_unit, number, percent
from harness.study.worst_case import LOST, TAIL, NoiseCandidate, WorstCase

_SHOWN = 30.0
"""Errors beyond this times the smallest are drawn at the edge of the figure."""

_WORTH = 0.95
"""Share of the worst case, on points and noise of its own, from which on tuning is not worth it."""


def answer(tuned: dict[str, WorstCase]) -> str:
    """Return the result in words, an estimator each."""
    return " ".join(_sentence(name, result) for name, result in tuned.items())


def _sentence(name: str, result: WorstCase) -> str:
    before, after = result.checked
    if after > _WORTH * before:
        least = min(result.tried, key=lambda c: c.nominal)
        return (
            f"{name}: no noise that was tried takes a twentieth off the worst case, {_times(before)} the error at the "
            f"nominal point; the smallest error there is {_times(least.nominal)} the one as it is."
        )
    gain = (
        "some runs are lost as it is, none" if before >= 1e3 > after else f"{_times(before)} as it is, {_times(after)}"
    )
    return (
        f"{name}: worst case, over the error at the nominal point, {gain} with the noise found (on fresh points and "
        f"noise); at the nominal point the error is {_times(result.after.nominal)} the one as it is."
    )


def _times(value: float) -> str:
    return "runs lost" if value >= 1e3 else f"{number(value, 3)}×"


def report(study: StudySpec, design: DesignSpec, tuned: dict[str, WorstCase], command: str) -> Report:
    """Return the report.

    Args:
        study: What was tuned; its drives are the training drives.
        design: Whose box it was tuned over.
        tuned: By estimator.
        command: How it was made, for the last section.
    """
    sections = [
        Section(partial(_answer, tuned), "Answer"),
        Section(partial(_front, tuned), "Nominal error against the worst case"),
        Section(partial(_made, study, design, tuned, command), "How was this made?"),
    ]
    return Report(f"{study.title or study.name} Tuned for the worst case", sections)


def _answer(tuned: dict[str, WorstCase]) -> Iterator[Block]:
    yield Bullets([strong(_sentence(name, result)) for name, result in tuned.items()])
    groups = [g.replace("_", " ") for g in NOISE_GROUPS]
    kinds = [(name, kind, result) for name, result in tuned.items() for kind in ("as it is", "found")]
    rows = [
        [name, kind, *_factors(_of(result, kind)), *_errors(_of(result, kind), result)] for name, kind, result in kinds
    ]
    caption = (
        "Factors on the variances believed; errors over the one at the nominal point as it is, in the mean over the "
        f"targets; worst case: mean of the worst {percent(TAIL)} of the runs in the box (conditional value at risk), "
        "on the points tuned on and on fresh ones."
    )
    yield Sheet(["estimator", "noise", *groups, "nominal", "worst case", "fresh"], rows, caption, left=2)
    targets = next(iter(tuned.values())).targets
    header = ["estimator", "noise"]
    for q in targets:
        header += [f"{q.words}{in_unit(q.unit)}, nominal", f"{q.words}, worst case"]
    rows = [
        [name, kind, *(_rmse(v[t] * q.scale) for t, q in enumerate(targets) for v in _rmses(_of(result, kind)))]
        for name, kind, result in kinds
    ]
    yield Sheet(header, rows, "RMSE of each target: mean at the nominal point, and worst case.", left=2)


def _of(result: WorstCase, kind: str) -> NoiseCandidate:
    return result.before if kind == "as it is" else result.after


def _factors(c: NoiseCandidate) -> list[str]:
    return [number(c.factors.get(g, 1.0)) for g in NOISE_GROUPS]


def _errors(c: NoiseCandidate, result: WorstCase) -> list[str]:
    return [_times(v) for v in (c.nominal, c.worst, result.checked[0 if c is result.before else 1])]


def _rmses(c: NoiseCandidate) -> tuple[Floats, Floats]:
    return c.nominal_rmse, c.worst_rmse


def _rmse(value: float) -> str:
    return number(value) if np.isfinite(value) else "∞"


def _front(tuned: dict[str, WorstCase]) -> Iterator[Block]:
    yield Drawing(
        partial(_draw, tuned),
        "Every candidate by its error at the nominal point and in the worst case, both over the nominal error as it "
        "is; the line is the front: no candidate is better in both. What is far off lies at the edge.",
        "Front between nominal and worst-case error of each estimator",
    )
    for name, result in tuned.items():
        rows = [[*_factors(c), _times(c.nominal), _times(c.worst)] for c in _thinned(result.front)]
        header = [*(g.replace("_", " ") for g in NOISE_GROUPS), "nominal", "worst case"]
        yield Sheet(header, rows, f"The front of {name}, from the smallest nominal error on.", left=0)


def _thinned(front: list[NoiseCandidate]) -> list[NoiseCandidate]:
    """Return at most ten candidates of a front, both ends among them, evenly apart in the nominal error."""
    if len(front) <= 10:
        return front
    at = np.log([c.nominal for c in front])
    chosen = {int(np.argmin(np.abs(at - v))) for v in np.linspace(at[0], at[-1], 10)}
    return [front[i] for i in sorted({0, len(front) - 1} | chosen)]


def _draw(tuned: dict[str, WorstCase]) -> bytes:
    looks = style.looks(list(tuned))
    marks = {"tried": ("#bbbbbb", "."), "as it is": (style.TRUTH, "s"), "found": (style.TRUTH, "*")}
    with style.drawing():
        fig = style.figure(0.9 + 2.6 * len(tuned))
        panels = fig.subplots(len(tuned), 1, squeeze=False)[:, 0]
        for axes, (name, result) in zip(panels, tuned.items(), strict=True):
            _panel(axes, name, result, looks[name])
        handles = [Line2D([], [], color=c, ls="none", marker=m, label=n) for n, (c, m) in marks.items()]
        handles.append(Line2D([], [], color=looks[next(iter(tuned))].line, label="front"))
        style.head(fig, "What does the worst case cost where all is as believed?", handles)
        return style.svg(fig)


def _panel(axes: Axes, name: str, result: WorstCase, look: style.Look) -> None:
    points = np.array([[c.nominal, c.worst] for c in result.tried])
    low = points.min(axis=0)
    high = np.minimum(points.max(axis=0), _SHOWN * low)

    def place(some: list[NoiseCandidate]) -> np.ndarray:
        return np.minimum([[c.nominal, c.worst] for c in some], high)

    with style.series(axes, name):
        axes.plot(*place(result.tried).T, ls="none", marker=".", ms=3, color="#bbbbbb")
        axes.plot(*place(result.front).T, drawstyle="steps-post", color=look.line, lw=1.4)
        axes.plot(*place([result.before]).T, ls="none", marker="s", ms=5, color=style.TRUTH)
        axes.plot(*place([result.after]).T, ls="none", marker="*", ms=9, color=style.TRUTH)
    style.logarithmic(axes, float(low[1]), float(high[1]))
    axes.set_xscale("log")
    axes.set_xlim(0.9 * low[0], 1.15 * high[0])
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_title(name, loc="left")
    axes.set_xlabel("error at the nominal point, over the one as it is")
    axes.set_ylabel("worst case")
    axes.grid()


def _made(study: StudySpec, design: DesignSpec, tuned: dict[str, WorstCase], command: str) -> Iterator[Block]:
    tried = max(len(result.tried) for result in tuned.values())
    box = listed([words(f.parameter) for f in design.factors])
    yield Prose(
        plain(
            f"{command}. {tried} candidates for each estimator, each on {len(study.drives)} training drives: eight "
            f"runs of the nominal vehicle and the points of the box of design '{design.name}' ({box}), with noise that "
            "no scored run shares. A third of the candidates each seek the smallest nominal error, the smallest "
            f"product of both errors and the smallest worst case. A lost run counts as {LOST:.0e} times the nominal "
            "error."
        )
    )
