"""The first page of the campaign: which estimator, inside which envelope, how often it fails, what drives its error."""

from __future__ import annotations

import textwrap
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.common.arrays import Floats
from harness.models.quantities import listed
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Picture, Sheet, plain, strong
from harness.reporting.style import number, with_unit
from harness.study import sobol_indices
from harness.study.report.analysis import Findings
from harness.study.report.overall import ALIKE
from harness.study.report.ranking import Ranking, limits_of, tolerances
from harness.study.report.sections.sensitivity import in_short
from harness.study.report.sections.tolerance import breaks_first, told
from harness.study.results import Design
from harness.study.tolerance import Tolerance
from reproductions.campaign import trust
from reproductions.campaign.claims import Finding
from reproductions.campaign.evidence import Verdict, share
from reproductions.campaign.results import Results


class Joint:
    """The joint study: all factors at once (design ``saltelli``), and nested boxes about what is believed."""

    def __init__(self, results: Results) -> None:
        self.analysis = results.analyses["joint"]
        self.store, self.looks = self.analysis.store, self.analysis.looks

    def _sampled(self, sampling: str) -> Findings:
        return next(f for f in self.analysis.findings if f.design.sampling == sampling)

    @cached_property
    def design(self) -> Design:
        """Design over the whole box."""
        return self._sampled("saltelli").design

    @property
    def ranking(self) -> Ranking:
        """Its indices."""
        return self._sampled("saltelli").ranking

    @cached_property
    def nested(self) -> Design:
        """Design of nested boxes."""
        return self._sampled("tolerance").design

    @cached_property
    def limits(self) -> dict[str, float]:
        """Largest tolerable error by target, SI."""
        return limits_of(self.store.attributes)

    @cached_property
    def borne(self) -> dict[tuple[int, int], Tolerance]:
        """What each estimator tolerates, by target and estimator."""
        return tolerances(self.nested, self.limits)

    @cached_property
    def believed(self) -> Floats:
        """Error over all drives where all is as believed, ``(target, estimator)``; NaN where no run has a score."""
        centre = slice(1)  # the first point of the innermost box
        nominal = self.nested.errors_under_control[:, 0, :, :, centre, :]
        return np.asarray(sobol_indices.over_drives(nominal)[..., 0])

    def quantiles(self, target: int) -> Floats:
        """Return the 5, 50 and 95 % quantile of the error over the box, ``(3, estimator)``."""
        return np.asarray(np.quantile(self.ranking.outcomes[target], [0.05, 0.5, 0.95], axis=-1))

    def diverged(self, estimator: int) -> int:
        """Return in how many runs over the box the estimator diverged."""
        return self.design.diverged(estimator)


def answer(results: Results, tested: list[Finding]) -> list[Block]:
    """Return the answer in words, one figure and one table."""
    joint = Joint(results)
    items = [
        ("Which estimator?", _which(joint)),
        ("Inside which envelope?", _envelope(joint)),
        ("How often does it fail?", _failures(joint)),
        ("What drives its error?", " ".join(in_short(joint.ranking))),
        ("Which findings of the dissertation are reproduced?", _holds(tested)),
    ]
    if said := trust.in_short(results):
        items.append(("Do the filters say when they are not to be trusted?", said))
    return [
        Bullets([f"{strong(question)} {plain(text)}" for question, text in items]),
        _picture(joint),
        _table(joint),
    ]


def _which(joint: Joint) -> str:
    """Name, for each target, the estimators that are as good as the best over the box, and how far the others are."""
    sentences = []
    for t, target in enumerate(joint.design.targets):
        median = joint.quantiles(t)[1]
        order = [int(e) for e in np.argsort(median)]
        best = median[order[0]]
        alike = [joint.design.estimators[e] for e in order if median[e] < (1 + ALIKE) * best]
        worse = [
            f"{joint.design.estimators[e]} {100 * (median[e] / best - 1):.0f} % more"
            for e in order
            if median[e] >= (1 + ALIKE) * best
        ]
        believed = joint.believed[t, order[0]]
        text = f"Over the whole box of perturbations {listed(alike)} estimate{'s' if len(alike) == 1 else ''} the "
        text += f"{target.words} best, with a median error of {with_unit(best, target.unit)} "
        text += f"({with_unit(believed, target.unit)} where all is as believed)"
        sentences.append(f"{text}; {listed(worse)}." if worse else f"{text}.")
    return " ".join(sentences)


def _envelope(joint: Joint) -> str:
    limits = told(joint.nested, joint.limits, joint.borne)
    return " ".join(f"For the {target.words}: {text}" for target, text in limits)


def _failures(joint: Joint) -> str:
    design = joint.design
    parts = []
    for e, name in enumerate(design.estimators):
        lower, upper = share(joint.diverged(e), design.compared())[1:]
        interval = f"{style.percent(lower)} to {style.percent(upper)}"
        parts.append(f"{name} in {joint.diverged(e)} ({interval})")
    text = f"Of {design.compared()} runs over the box, each estimator on each of them, diverged: {listed(parts)}."
    if design.out_of_control.any():
        text += f" In {int(design.out_of_control.sum())} more the vehicle itself went out of control."
    return text


def _holds(tested: list[Finding]) -> str:
    counts = {v: sum(f.verdict is v for f in tested) for v in Verdict}
    return (
        f"Of {len(tested)} findings {counts[Verdict.REPRODUCED]} are reproduced, {counts[Verdict.NOT_REPRODUCED]} are "
        f"not, {counts[Verdict.UNDECIDED]} cannot be decided; the table of findings says which and why."
    )


def _picture(joint: Joint) -> Picture:
    design = joint.design
    question = "Which is best when everything drifts at once, and what drives its error?"
    with style.drawing():
        fig = style.figure(1.35 * len(design.targets) + 2.4)
        rows = fig.subplots(len(design.targets) + 1, 1, squeeze=False)[:, 0]
        for t, axes in enumerate(rows[:-1]):
            _errors(axes, joint, t)
        _indices(rows[-1], joint)
        handles = [
            Line2D([], [], color="black", marker="o", ls="-", label="over the box: median, 5 to 95 %"),
            Line2D([], [], color="black", marker="_", ls="", ms=11, mew=1.6, label="all as believed"),
        ]
        style.head(fig, question, handles)
        svg = style.svg(fig)
    caption = (
        f"Above: error over all {len(design.drives)} drives at {design.status.shape[3]} points of the box of "
        f"{len(design.factors)} factors; a lost run has the largest error of its drive. Below: total Sobol index of "
        "each factor with its 95 % bootstrap interval, for "
        f"{listed([_best(joint, t) for t in range(len(design.targets))])}; the share of the variance that "
        "the factor has a part in."
    )
    return Picture(svg, caption, question)


def _best(joint: Joint, target: int) -> str:
    name = joint.design.estimators[joint.ranking.best(target)]
    return f"the {joint.design.targets[target].words} of {name}"


def _errors(axes: Axes, joint: Joint, target: int) -> None:
    low, median, high = joint.quantiles(target)
    quantity = joint.design.targets[target]
    for e, name in enumerate(joint.design.estimators):
        look = joint.looks[name]
        with style.series(axes, name):
            axes.vlines(e, low[e], high[e], color=look.line, lw=2.0)
            axes.plot(e, median[e], look.marker, color=look.line, ms=7)
            axes.plot(e, joint.believed[target, e], "_", color="black", ms=16, mew=1.6)
    lowest = min(float(low.min()), float(np.nanmin(joint.believed[target])))
    style.logarithmic(axes, lowest, float(high.max()))
    axes.set_xticks(range(len(joint.design.estimators)), joint.design.estimators)
    axes.tick_params(axis="x", length=0)
    axes.set_ylabel(f"RMSE of ${quantity.symbol}${style.in_unit(quantity.unit)}", parse_math=True)
    axes.set_title(quantity.words, loc="left")
    axes.grid(axis="y")


def _indices(axes: Axes, joint: Joint) -> None:
    design = joint.design
    count = len(design.targets)
    for t, target in enumerate(design.targets):
        ranking = joint.ranking.errors[t][joint.ranking.best(t)]
        if ranking is None:
            continue
        places = np.arange(len(design.factors)) + (t - (count - 1) / 2) * 0.25
        values, low, high = np.array(ranking.total).T
        marker, shade = "osv^D"[t % 5], ("black", "0.45")[t % 2]
        axes.vlines(places, low, high, color=shade, lw=1.4)
        axes.plot(places, values, marker, color=shade, ms=5.5, label=target.words)
    labels = [textwrap.fill(f.words, 9, break_long_words=False) for f in design.factors]
    axes.set_xticks(range(len(labels)), labels)
    axes.tick_params(axis="x", length=0)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("total index")
    axes.set_title("what drives the error", loc="left")
    axes.legend(loc="upper right")
    axes.grid(axis="y")


def _table(joint: Joint) -> Sheet:
    design, rows = joint.design, []
    for t, target in enumerate(design.targets):
        quantiles = joint.quantiles(t)
        for e, name in enumerate(design.estimators):
            borne = joint.borne.get((t, e))
            driver = _driver(joint, t, e)
            rows.append(
                [
                    "" if e else f"{target.words}{style.in_unit(target.unit)}",
                    name,
                    driver,
                    "–" if borne is None else breaks_first(joint.nested, borne),
                    number(joint.believed[t, e]),
                    number(quantiles[1, e]),
                    number(quantiles[2, e]),
                    str(joint.diverged(e)),
                    "–" if borne is None else f"{100 * borne.box:.0f} %",
                ]
            )
    header = ["", "estimator", "driven by", "alone breaks first", "believed", "median", "95 %", "diverged", "box"]
    limits = listed(
        [
            f"{with_unit(joint.limits[t.name] * t.scale, t.unit)} of {t.words}"
            for t in design.targets
            if t.name in joint.limits
        ]
    )
    caption = (
        f"The estimators over the whole box, {design.planned} runs each. Box: how far all factors may drift together,"
        f" in % of the way to the edges, until the error exceeds {limits} on some drive. Driven by: factor with the "
        "largest total index."
    )
    return Sheet(header, rows, caption, left=4)


def _driver(joint: Joint, target: int, estimator: int) -> str:
    """Name the factor with the largest total index, with that index."""
    ranking = joint.ranking.errors[target][estimator]
    if ranking is None:
        return "–"
    first = ranking.order[0]
    return f"{joint.design.factors[first].words} {number(ranking.total[first].value, 2)}"
