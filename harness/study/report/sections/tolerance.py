"""How far the vehicle may drift in all factors at once: the tolerance map of ``tolerance`` designs."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.models.quantities import Quantity, capital
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Picture, Prose, Sheet, plain, strong
from harness.reporting.style import number, with_unit
from harness.study.report.analysis import Analysis
from harness.study.report.ranking import limits_of, tolerances
from harness.study.results import Design, Factor
from harness.study.score_names import ESTIMATOR_DIVERGED, PENDING
from harness.study.tolerance import Tolerance

_ROW = 0.34


def blocks(analysis: Analysis) -> list[Block]:
    """Return words, a figure per target and tables for each ``tolerance`` design; else nothing."""
    content: list[Block] = []
    limits = limits_of(analysis.store.attributes)
    for findings in analysis.findings:
        design = findings.design
        if design.sampling != "tolerance":
            continue
        if design.count(PENDING):
            content.append(
                Prose(plain(f"Design “{design.name}” is not finished; a tolerance needs all of its points."))
            )
            continue
        borne = tolerances(design, limits)
        items = [f"{strong(_capital(target))} {plain(text)}" for target, text in told(design, limits, borne)]
        content += [Bullets(items), Prose(plain(_rule(design, borne)))]
        for t, target in enumerate(design.targets):
            if target.name in limits and design.giving(t):
                limit = with_unit(limits[target.name] * target.scale, target.unit)
                content += [_picture(analysis, design, t, limit, borne), _summary(design, t, limit, borne)]
                content.append(_box(design, t, borne))
    return content


def value_at(factor: Factor, share: float) -> float:
    """Return a factor's value at a share of the way to an edge of the whole box, negative towards the lower one."""
    edge = float(factor.upper[-1] if share > 0 else factor.lower[-1])
    if factor.log:
        return float(factor.nominal * (edge / factor.nominal) ** abs(share))
    return factor.nominal + abs(share) * (edge - factor.nominal)


def breaks_first(design: Design, borne: Tolerance) -> str:
    """Name the factor that alone breaks the limit first, and where."""
    if borne.first is None:
        return "no factor alone" if borne.nominal <= 1.0 else f"broken as {design.nominal_is}"
    i, upwards = borne.first
    reach = float(borne.upper[i] if upwards else -borne.lower[i])
    factor = design.factors[i]
    return f"{factor.words} {'above' if upwards else 'below'} {with_unit(value_at(factor, reach), factor.unit)}"


def told(
    design: Design, limits: dict[str, float], borne: dict[tuple[int, int], Tolerance]
) -> list[tuple[Quantity, str]]:
    """Say for each target with a limit which estimator tolerates the largest box, and what breaks the limit first."""
    items = []
    for t, target in enumerate(design.targets):
        if target.name not in limits or not design.giving(t):
            continue
        limit = with_unit(limits[target.name] * target.scale, target.unit)
        best = _best(design, t, borne)
        items.append((target, _sentence(design, limit, best, borne[t, best])))
    return items


def _best(design: Design, t: int, borne: dict[tuple[int, int], Tolerance]) -> int:
    """Return the estimator that tolerates most."""
    return max(design.giving(t), key=lambda e: (borne[t, e].box, borne[t, e].typical))


def uncontrolled(design: Design) -> str:
    """Say of a design over all factors in how many runs the vehicle goes out of control, and how these count."""
    runs = int(design.out_of_control.sum())
    if not runs:
        return ""
    points = int(design.out_of_control.any(axis=(1, 3)).sum())
    return (
        f" In {runs} runs, at {points} points, the vehicle itself goes out of control; the error of an estimator "
        "counts up to there."
    )


def _capital(target: Quantity) -> str:
    return f"{capital(target.words)}."


def _sentence(design: Design, limit: str, e: int, borne: Tolerance) -> str:
    name = design.estimators[e]
    if borne.nominal > 1.0:
        how = "diverges" if np.isinf(borne.nominal) else f"has an error {number(borne.nominal, 2)} times as large"
        return (
            f"No estimator stays below {limit} even where the vehicle is as {design.nominal_is}: the best, {name}, "
            f"{how} on the worst drive. No box meets this limit."
        )
    text = f"{name} tolerates most: its error stays below {limit} on every drive"
    text += f" while all factors together stay within {100 * borne.box:.0f} % of the way to the edges of the box."
    if borne.first is None:
        return f"{text} No factor alone breaks it."
    return f"{text} Alone, {breaks_first(design, borne)} breaks it first."


def _rule(design: Design, borne: dict[tuple[int, int], Tolerance]) -> str:
    whole = next(iter(borne.values()))
    runs = design.status[:, 0].size
    return (
        f"{whole.rays} points of the whole box and each factor alone drift from the {design.nominal_is} values to the "
        f"edges in {len(design.bands)} steps, {runs} runs of each estimator on {len(design.drives)} drives. The limit "
        "is broken where the RMSE on any drive exceeds it or the estimator diverges. Between two steps the error is "
        "taken as linear. The box is the largest in which no point broke the limit; so "
        f"{100 * whole.holds:.1f} % of its "
        f"points or more hold it at 95 % confidence (distribution-free, Wilks 1941).{uncontrolled(design)}"
    )


def _picture(
    analysis: Analysis, design: Design, t: int, limit: str, borne: dict[tuple[int, int], Tolerance]
) -> Picture:
    target = design.targets[t]
    question = f"How far may each parameter drift until the error of the {target.words} exceeds {limit}?"
    with style.drawing():
        fig = style.figure(1.2 + _ROW * (len(design.factors) + 1))
        axes = fig.subplots()
        giving = design.giving(t)
        for place, e in enumerate(giving):
            name = design.estimators[e]
            look, borne_here = analysis.looks[name], borne[t, e]
            places = np.arange(len(design.factors) + 1) + ((place + 0.5) / len(giving) - 0.5) * 0.8
            low, high = -np.append(borne_here.box, borne_here.lower), np.append(borne_here.box, borne_here.upper)
            with style.series(axes, name):
                axes.hlines(places, low, high, color=look.line, lw=1.2)
                for ends in (low, high):
                    held = np.abs(ends) >= 1.0
                    axes.plot(ends[~held], places[~held], look.marker, ms=4.2, color=look.line)
                    axes.plot(ends[held], places[held], look.marker, ms=4.2, mec=look.line, mfc="white", mew=0.7)
        _rows(axes, design)
        handles = [
            Line2D([], [], color=analysis.looks[n].line, marker=analysis.looks[n].marker, label=n)
            for n in (design.estimators[e] for e in giving)
        ]
        style.head(fig, question, handles)
        svg = style.svg(fig)
    lost = ", ".join(f"{n} {design.count(ESTIMATOR_DIVERGED, None, e)}" for e, n in enumerate(design.estimators))
    caption = (
        f"Drift from the {design.nominal_is} value (0) towards the edges of the box (−100 %, 100 %), design "
        f"“{design.name}”, at which the RMSE of {target.words} reaches {limit} on some drive: all factors at once, and "
        "each alone. Filled: the limit is reached; open: it holds up to the edge. "
        f"n = {design.status[:, 0].size} runs of each estimator, diverged: {lost}."
    )
    return Picture(svg, caption, question)


def _rows(axes: Axes, design: Design) -> None:
    labels = ["all at once"]
    for f in design.factors:
        unit = f" {f.unit}" if f.unit else ""
        edges = f"{number(float(f.lower[-1]))} … {number(f.nominal)} … {number(float(f.upper[-1]))}{unit}"
        labels.append(f"{f.words}\n{edges}")
    axes.axhspan(-0.5, 0.5, color=style.SHADE, lw=0, zorder=0)
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(-1.04, 1.04)
    axes.set_xticks(np.linspace(-1, 1, 9), [f"{x:.0f}".replace("-", "−") for x in np.linspace(-100, 100, 9)])
    axes.set_xlabel("drift in % of the way to the edge of the box")
    axes.grid(axis="x")


def _summary(design: Design, t: int, limit: str, borne: dict[tuple[int, int], Tolerance]) -> Sheet:
    rows = []
    for e in design.giving(t):
        name, borne_here = design.estimators[e], borne[t, e]
        nominal = "diverged" if np.isinf(borne_here.nominal) else f"{100 * borne_here.nominal:.0f} %"
        rows.append(
            [
                name,
                breaks_first(design, borne_here),
                nominal,
                f"{100 * borne_here.box:.0f} %",
                f"{100 * borne_here.typical:.0f} %",
            ]
        )
    caption = (
        f"What the estimators tolerate until the RMSE of {design.targets[t].words} exceeds {limit}. As "
        f"{design.nominal_is}: error on the worst drive over the limit. Box: of the way to the edges, all factors at "
        "once; half of the points break the limit before the median."
    )
    return Sheet(["estimator", "alone breaks first", f"as {design.nominal_is}", "box", "median"], rows, caption, left=2)


def _box(design: Design, t: int, borne: dict[tuple[int, int], Tolerance]) -> Sheet:
    """Write the box of the estimator that tolerates most in the units of the factors."""
    best = _best(design, t, borne)
    borne_here = borne[t, best]
    rows = []
    for i, f in enumerate(design.factors):
        unit = f" ({f.unit})" if f.unit else ""
        together = f"{number(value_at(f, -borne_here.box))} to {number(value_at(f, borne_here.box))}"
        alone = (
            f"{number(value_at(f, -float(borne_here.lower[i])))} to {number(value_at(f, float(borne_here.upper[i])))}"
        )
        rows.append([f.words + unit, number(f.nominal), together, alone])
    caption = (
        f"The box that {design.estimators[best]} tolerates for {design.targets[t].words}, and what it tolerates of "
        "each factor alone."
    )
    return Sheet(["factor", design.nominal_is, "all at once", "alone"], rows, caption)
