"""Which factor drives the error: Sobol indices of the designs that vary all factors at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.common.statistics import Interval
from harness.models.quantities import capital, listed
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Picture, Prose, Sheet, plain, strong
from harness.study.report.analysis import Analysis
from harness.study.report.ranking import FEWEST, Ranking
from harness.study.report.sections.tolerance import uncontrolled
from harness.study.score_names import ESTIMATOR_DIVERGED, PENDING
from harness.study.sobol_indices import Indices

DRIVING = 0.1
"""Total index from which on a factor is said to drive the error."""

NAMED = 2
"""Factors that are named where the answer is told in short."""

_FACTOR_HEIGHT = 0.34
_LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
_MARKERS = ("o", "s", "^", "D", "v")


def blocks(analysis: Analysis) -> list[Block]:
    """Return words, figures and tables for each ``saltelli`` design; else nothing."""
    content: list[Block] = []
    for findings in analysis.findings:
        if findings.design.sampling == "saltelli":
            content += _design(analysis, findings.ranking)
    return content


def _design(analysis: Analysis, ranking: Ranking) -> list[Block]:
    design = ranking.design
    if design.count(PENDING):
        return [Prose(plain(f"Design “{design.name}” is not finished; Sobol indices need all of its points."))]
    content: list[Block] = [Bullets(_words(ranking)), Prose(plain(_rule(ranking)))]
    for target in range(len(design.targets)):
        if any(ranking.errors[target]):
            content += [_indices_picture(analysis, ranking, target), *_tables(ranking, target)]
    if any(ranking.divergence):
        content += [_divergence_picture(analysis, ranking), _divergence_table(ranking)]
    return content + _convergence_picture(ranking)


def in_short(ranking: Ranking) -> list[str]:
    """Say for each target which factors drive the error of the estimator that is best over the box."""
    design, sentences = ranking.design, []
    for t, target in enumerate(design.targets):
        best = ranking.best(t)
        indices = ranking.errors[t][best]
        if indices is None:
            continue
        who = f"With {design.estimators[best]}, the error of the {target.words}"
        first = indices.total[indices.order[0]]
        if first.upper - first.lower > 1.0:  # an index is a share: such an interval holds all of them
            sentences.append(f"{who} is driven by factors that {indices.samples} base samples are too few to tell.")
            continue
        large = [i for i in indices.order if indices.total[i].value >= DRIVING][:NAMED]
        parts = [f"{design.factors[i].words} (total index {indices.total[i].value:.2f})" for i in large]
        by = listed(parts) if parts else "no factor more than by others"
        sentences.append(f"{who} is driven by {by}{_undecided(ranking, indices)}.")
    return sentences


def _undecided(ranking: Ranking, indices: Indices) -> str:
    """Say that the samples do not tell which factor leads, where they do not."""
    second = indices.total[indices.order[1]].value if len(indices.order) > 1 else 0.0
    if second < DRIVING or indices.lead.lower > 0:
        return ""
    first, other = (ranking.design.factors[i].words for i in indices.order[:2])
    return (
        f"; {indices.samples} base samples are too few to decide whether {first} or {other} does more (difference "
        f"{told(indices.lead)})"
    )


def _words(ranking: Ranking) -> list[str]:
    design = ranking.design
    items = []
    for t, target in enumerate(design.targets):
        name = strong(capital(target.words) + ".")
        items.append(f"{name} {plain(_drivers(ranking, ranking.errors[t], ranking.best(t)) + _by_ranks(ranking, t))}")
    divergence = strong("Divergence.")
    if any(ranking.divergence):
        some = [e for e, tried in enumerate(ranking.divergence) if tried is not None]
        most = max(some, key=lambda e: float(ranking.lost[e].mean()))
        items.append(f"{divergence} {plain(_drivers(ranking, ranking.divergence, most, 'the share of diverged runs'))}")
    else:
        items.append(f"{divergence} {plain('No estimator diverged at enough points to explain it by factors.')}")
    if (indices := ranking.out_of_control) is not None:
        total = [f"{design.factors[i].words} {told(indices.total[i])}" for i in indices.order[:NAMED]]
        text = f"The largest total indices of the share of runs out of control are {listed(total)}."
        items.append(f"{strong('Loss of control.')} {plain(text)}")
    return items


def _drivers(ranking: Ranking, indices: Sequence[Indices | None], shown: int, what: str = "the error") -> str:
    """Name the factors with a large total index for one estimator, and the estimators for which another one leads."""
    design, own = ranking.design, indices[shown]
    if own is None:
        return f"With {design.estimators[shown]} {what} does not vary."
    large = [i for i in own.order if own.total[i].value >= DRIVING]
    small = [own.total[i].value for i in own.order if i not in large]
    parts = [f"{design.factors[i].words} {told(own.total[i])}" for i in large]
    text = f"With {design.estimators[shown]}, the total indices of {what} are {listed(parts)}"
    if not parts:
        text = f"With {design.estimators[shown]}, no factor has a total index of {what} of {DRIVING}"
    elif small:
        text += f"; the other {len(small)} factors have at most {max(small[0], 0.0):.2f} each"
    text += _undecided(ranking, own)
    other = [
        f"{name} ({design.factors[f.order[0]].words} {f.total[f.order[0]].value:.2f})"
        for name, f in zip(design.estimators, indices, strict=True)
        if f is not None and f.order[0] != own.order[0]
    ]
    return text + (f". Another factor leads for {listed(other)}." if other else ".")


def _by_ranks(ranking: Ranking, target: int) -> str:
    """Say whether the leading factor is the same when only the order of the errors counts."""
    pairs = zip(ranking.design.estimators, ranking.errors[target], ranking.of_ranks[target], strict=True)
    other = [
        f"{name} ({ranking.design.factors[ranks.order[0]].words})"
        for name, error, ranks in pairs
        if error is not None and ranks is not None and error.order[0] != ranks.order[0]
    ]
    if not other:
        return " By ranks of the error the same factor leads."
    return (
        f" By ranks of the error another factor leads for {listed(other)}: there, few large errors dominate the "
        "variance."
    )


def _rule(ranking: Ranking) -> str:
    design = ranking.design
    runs = design.status[:, 0].size
    lost = f"Of these {_lost(ranking)}." if ranking.lost.any() else "No run diverged."
    base = int(design.data.attrs["base_samples"])
    return (
        f"Sobol indices from {base} base samples, {len(design.factors)} factors, hence {design.status.shape[3]} "
        f"points, on {len(design.drives)} drives: {runs} runs of each estimator. The error of a point is the root "
        "mean square over its drives; all points share the noise, so the factors alone make it vary. The "
        "first-order index is the share of the variance that one factor explains alone, the total index adds what "
        "it does together with others; intervals are at 95 %, bootstrapped over base samples. A diverged run keeps the "
        f"design balanced with the largest error that any other run had on the same drive. {lost}{uncontrolled(design)}"
    )


def _indices_picture(analysis: Analysis, ranking: Ranking, target: int) -> Picture:
    design, quantity = ranking.design, ranking.design.targets[target]
    question = f"Which parameter drives the error of the {quantity.words}?"
    order = ranking.order(target)
    rows = _rows(ranking, ranking.errors[target], order)
    svg = dots(analysis, rows, _factors(ranking, order), question, "share of the variance of the RMSE")
    caption = (
        f"Sobol indices of the RMSE of {quantity.words}, design “{design.name}”, n = {design.status[:, 0].size} "
        f"runs of each estimator, {_lost(ranking)}. Filled: total index with its 95 % interval; open: first order."
    )
    return Picture(svg, caption, question)


def _divergence_picture(analysis: Analysis, ranking: Ranking) -> Picture:
    question = "Which parameter makes runs diverge?"
    estimated = [indices for indices in ranking.divergence if indices is not None]
    order = [
        int(i) for i in np.argsort(-np.mean([[t.value for t in f.total] for f in estimated], axis=0), kind="stable")
    ]
    rows, label = _rows(ranking, ranking.divergence, order), "share of the variance of the outcome “diverged”"
    svg = dots(analysis, rows, _factors(ranking, order), question, label)
    caption = (
        f"Sobol indices of the share of runs that diverged at a point, design “{ranking.design.name}”, "
        f"{_lost(ranking)}. Filled: total index with its 95 % interval; open: first order. Estimators whose "
        f"divergences differ at less than {100 * FEWEST:g} % of the points are not shown."
    )
    return Picture(svg, caption, question)


def _lost(ranking: Ranking) -> str:
    design = ranking.design
    counts = [f"{n} {design.count(ESTIMATOR_DIVERGED, None, e)}" for e, n in enumerate(design.estimators)]
    return f"diverged: {', '.join(counts)}"


Row = tuple[str, list[Interval], list[float]]
"""An estimator with its filled and its hollow marks, one of each per factor."""


def _rows(ranking: Ranking, indices: Sequence[Indices | None], order: list[int]) -> list[Row]:
    shown = [(name, own) for name, own in zip(ranking.design.estimators, indices, strict=True) if own is not None]
    return [(name, [own.total[i] for i in order], [own.first[i].value for i in order]) for name, own in shown]


def _factors(ranking: Ranking, order: list[int]) -> list[str]:
    return [ranking.design.factors[i].words for i in order]


def dots(analysis: Analysis, shown: Sequence[Row], factors: Sequence[str], question: str, label: str) -> bytes:
    """Draw shares of the variance of several estimators, a row for each factor."""
    with style.drawing():
        fig = style.figure(1.0 + _FACTOR_HEIGHT * len(factors))
        axes = fig.subplots()
        for k, (name, filled, hollow) in enumerate(shown):
            look = analysis.looks[name]
            places = np.arange(len(factors)) + ((k + 0.5) / len(shown) - 0.5) * 0.8
            total = np.array(filled)
            with style.series(axes, name):
                axes.hlines(places, total[:, 1], total[:, 2], color=look.line, lw=1.2)
                axes.plot(total[:, 0], places, look.marker, ms=4.2, color=look.line, label=name)
                axes.plot(hollow, places, look.marker, ms=4.2, mec=look.line, mfc="white", mew=0.7)
        _factor_rows(axes, factors)
        axes.set_xlim(left=min(axes.get_xlim()[0], -0.02))
        axes.set_xlabel(label)
        handles = [
            Line2D([], [], color=analysis.looks[n].line, marker=analysis.looks[n].marker, label=n) for n, *_ in shown
        ]
        style.head(fig, question, handles)
        return style.svg(fig)


def _factor_rows(axes: Axes, factors: Sequence[str]) -> None:
    for k in range(0, len(factors), 2):
        axes.axhspan(k - 0.5, k + 0.5, color="#f4f4f4", lw=0, zorder=0)
    axes.axvline(0.0, color="black", lw=0.6)
    axes.set_yticks(range(len(factors)), factors)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(factors) - 0.5, -0.5)
    axes.grid(axis="x")


def _two_digits(interval: Interval) -> list[str]:
    return [f"{v:.2f}".replace("-0.00", "0.00").replace("-", "−") for v in interval]


def told(interval: Interval) -> str:
    """Write an estimate with its interval behind it."""
    value, lower, upper = _two_digits(interval)
    return f"{value} ({lower} to {upper})"


def in_table(interval: Interval) -> str:
    """Write an estimate with its interval below it."""
    value, lower, upper = _two_digits(interval)
    return f"{value}\n{lower} to {upper}"


def _tables(ranking: Ranking, target: int) -> list[Block]:
    design, words = ranking.design, ranking.design.targets[target].words
    order = ranking.order(target)
    sheets: list[Block] = []
    for kind, name in (("total", "Total"), ("first", "First-order")):
        rows = [
            [
                design.factors[i].words,
                *("–" if f is None else in_table(getattr(f, kind)[i]) for f in ranking.errors[target]),
            ]
            for i in order
        ]
        caption = f"{name} Sobol indices of the RMSE of {words} with 95 % intervals, design “{design.name}”."
        sheets.append(Sheet(["factor", *design.estimators], rows, caption))
    rows = [
        [design.factors[i].words, *("–" if f is None else in_table(f.total[i]) for f in ranking.of_ranks[target])]
        for i in order
    ]
    caption = (
        f"Total Sobol indices of the rank of the RMSE of {words}: what is left when only the order of errors counts."
    )
    return [*sheets, Sheet(["factor", *design.estimators], rows, caption)]


def _divergence_table(ranking: Ranking) -> Sheet:
    design = ranking.design
    rows = [
        [f.words, *("–" if indices is None else in_table(indices.total[i]) for indices in ranking.divergence)]
        for i, f in enumerate(design.factors)
    ]
    share = [f"{100 * float(np.mean(lost)):.1f} %" for lost in ranking.lost]
    caption = f"Total Sobol indices of the share of diverged runs with 95 % intervals, design “{design.name}”."
    return Sheet(["factor", *design.estimators], [["runs diverged", *share], *rows], caption)


def _convergence_picture(ranking: Ranking) -> list[Block]:
    """Draw the total indices of the leading factors over the number of base samples, for the best estimator.

    There is nothing to draw where the design is too small to be divided.
    """
    design = ranking.design
    converging = {
        t: series
        for t in range(len(design.targets))
        if any(ranking.errors[t]) and (series := ranking.converging(t, ranking.best(t)))
    }
    if not converging:
        return []
    question = "Are there enough samples to tell the factors apart?"
    with style.drawing():
        fig = style.figure(0.9 + 2.2 * len(converging))
        rows = fig.subplots(len(converging), 1, sharex=True, squeeze=False)[:, 0]
        leading = list(dict.fromkeys(i for t in converging for i in ranking.order(t)[:3]))[: len(_LINES)]
        for axes, (t, series) in zip(rows, converging.items(), strict=True):
            sizes = [f.samples for f in series]
            for k, i in enumerate(leading):
                total = np.array([f.total[i] for f in series])
                axes.fill_between(sizes, total[:, 1], total[:, 2], color=_LINES[k], alpha=0.15, lw=0)
                axes.plot(sizes, total[:, 0], color=_LINES[k], marker=_MARKERS[k], ms=4)
            axes.set_title(f"{design.targets[t].words}, {design.estimators[ranking.best(t)]}", loc="left")
            axes.set_ylabel("total index")
            axes.set_xscale("log", base=2)
            axes.set_xticks(sizes, [str(n) for n in sizes], minor=False)
            axes.grid()
        rows[-1].set_xlabel("base samples N")
        handles = [
            Line2D([], [], color=_LINES[k], marker=_MARKERS[k], label=design.factors[i].words)
            for k, i in enumerate(leading)
        ]
        style.head(fig, question, handles)
        svg = style.svg(fig)
    caption = (
        f"Total Sobol indices of the RMSE over the number of base samples, design “{design.name}”, for the "
        "estimator with the smallest median error and the leading factors; shaded: 95 % interval. Each N is what a "
        "study of that size would have found."
    )
    return [Picture(svg, caption, question)]
