"""Errors over a population: how often a limit is exceeded, quantiles, and the mean of the largest errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from harness.common.arrays import Floats
from harness.common.statistics import Interval, over_replicates
from harness.models.quantities import capital
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Picture, Prose, Sheet, plain, strong
from harness.reporting.style import number, percent, with_unit
from harness.study.exceedance import (
    QUANTILES,
    TAIL,
    Exceedance,
    between_share,
    exceedance,
    mixture_quantile,
    quantile,
    tail_interval,
)
from harness.study.report.analysis import Analysis
from harness.study.report.population import Population
from harness.study.report.sections.tolerance import uncontrolled
from harness.study.results import Design
from harness.study.score_names import PENDING

_DASHES = {"rmse": "-", "largest": (0, (4, 1.5))}
_CALLED = {"rmse": "RMSE", "largest": "largest error"}


def blocks(analysis: Analysis) -> list[Block]:
    """Return words, a figure and tables for each ``population`` design; else nothing."""
    content: list[Block] = []
    for findings in analysis.findings:
        if findings.design.sampling != "population":
            continue
        population = findings.population
        if findings.design.count(PENDING):
            text = f"Design “{findings.design.name}” is not finished; probabilities need all of its points."
            content.append(Prose(plain(text)))
            continue
        items = in_words(population)
        content += [Bullets(items)] if items else []
        content.append(Prose(plain(_rule(population))))
        content += [Prose(plain(text)) for text in rare(analysis, findings.design)]
        for target in range(len(findings.design.targets)):
            if findings.design.giving(target):
                content += [_picture(analysis, population, target), *_limit_table(population, target)]
                content.append(_quantile_table(population, target))
    return content


def in_short(population: Population) -> list[str]:
    """Say for each target with a limit how often the estimator that exceeds it least does so."""
    sentences = []
    for t, limit in population.limits.items():
        quantity = population.design.targets[t]
        for score in ("largest", "rmse"):
            e, broken = _least(population, score, t, limit)
            sentences.append(
                f"With {population.design.estimators[e]}, the {_CALLED[score]} of the {quantity.words} exceeds "
                f"{with_unit(limit, quantity.unit)} with a probability of {_share(broken.probability)}."
            )
    return sentences


def rare(analysis: Analysis, design: Design) -> list[str]:
    """Say how probable the rare event is that was asked for of a design; nothing where none was."""
    event = analysis.store.rare_event
    if event.get("design") != design.name:
        return []
    quantity = next(q for q in design.targets if q.name == event["target"])
    limit = with_unit(event["limit"] * quantity.scale, quantity.unit)
    if "not_reached" in event:
        return [
            f"How probable it is that the largest error of the {quantity.words} exceeds {limit} with "
            f"{event['estimator']} is not known: subset simulation did not get there (in SI units, "
            f"{event['not_reached']})."
        ]
    effort = f"{len(event['thresholds'])} levels and {event['evaluations']} vehicles, which have the noise of the first"
    return [
        f"With {event['estimator']}, the largest error of the {quantity.words} on the worst drive exceeds {limit} with "
        f"a probability of {event['probability']:.2g}, by subset simulation with {effort}; coefficient of variation "
        f"{percent(event['variation'])}."
    ]


def narrowed(populations: Sequence[Population]) -> list[str]:
    """Say of designs over the same factors how much of the error in the widest one remains in each of the others."""
    alike: dict[tuple[str, ...], list[Population]] = {}
    for population in populations:
        alike.setdefault(tuple(sorted(f.name for f in population.design.factors)), []).append(population)
    sentences = []
    for several in alike.values():
        for t in range(len(several[0].design.targets) if len(several) > 1 else 0):
            e = several[0].best(t)
            if all(np.isfinite(p.rmse[t, e]).all() and np.ptp(p.rmse[t, e]) > 0 for p in several):
                widest, *others = sorted(several, key=lambda p: -float(np.var(p.rmse[t, e])))
                sentences += [_remains(widest, other, t, e) for other in others]
    return sentences


def mixed(populations: Sequence[Population]) -> list[str]:
    """Say how wrong estimates are over all designs that state a share, and how much hangs on which of them is right."""
    several = [p for p in populations if p.share is not None]
    if len(several) < 2:
        return []
    total = sum(p.share or 0.0 for p in several)
    shares = [(p.share or 0.0) / total for p in several]
    likeliest = several[int(np.argmax(shares))]
    return [_over_all(several, shares, t, likeliest.best(t)) for t in range(len(likeliest.design.targets))]


def _over_all(several: Sequence[Population], shares: Sequence[float], t: int, e: int) -> str:
    """Say of one target how large an estimator's error is over designs by their shares."""
    errors, design = [p.rmse[t, e] for p in several], several[0].design
    quantity, estimator = design.targets[t], design.estimators[e]
    middle, high = (mixture_quantile(errors, shares, share) for share in (0.5, 0.95))
    each = ", ".join(
        f"{number(quantile(own, 0.95).value)} if “{p.design.name}” is right ({percent(share)})"
        for p, own, share in zip(several, errors, shares, strict=True)
    )
    text = (
        f"With {estimator}, over all models by their shares, the error of the {quantity.words} is "
        f"{number(middle.value)} ({number(middle.lower)} to {number(middle.upper)}) in the median vehicle and "
        f"{number(high.value)} ({number(high.lower)} to {with_unit(high.upper, quantity.unit)}) at 95 %: {each}."
    )
    if all(np.isfinite(own).all() for own in errors) and any(np.ptp(own) > 0 for own in errors):
        text += f" Which of them is right makes {_share(between_share(errors, shares))} of its variance."
    if (limit := several[0].limits.get(t)) is not None:
        parts = np.array([exceedance(own, limit).probability for own in errors])
        beyond = _share(Interval(*np.tensordot(shares, parts, 1)))
        text += f" It exceeds {with_unit(limit, quantity.unit)} with a probability of {beyond}."
    return text


def _remains(wide: Population, narrow: Population, t: int, e: int) -> str:
    """Say how much of the variance of an error remains, by the scramblings, which both designs share."""
    variances = [np.var(p.rmse[t, e], axis=-1) for p in (wide, narrow)]
    ratio = float(np.log(variances[1].mean() / variances[0].mean()))
    share = Interval(*np.exp(over_replicates(ratio, np.log(variances[1] / variances[0]) - ratio)))
    quantity, (before, after) = wide.design.targets[t], [quantile(p.rmse[t, e], 0.95).value for p in (wide, narrow)]
    return (
        f"With {wide.design.estimators[e]}, {_share(share)} of the variance of the error of the {quantity.words} in "
        f"design “{wide.design.name}” remains in “{narrow.design.name}”; the 95 % quantile of the error goes from "
        f"{number(before)} to {with_unit(after, quantity.unit)}."
    )


def in_words(population: Population) -> list[str]:
    """Return the sentences of ``in_short`` with how many more points a narrower interval takes, as items."""
    items = []
    for t, limit in population.limits.items():
        quantity = population.design.targets[t]
        _, broken = _least(population, "largest", t, limit)
        text = " ".join(s for s in in_short(population) if f"of the {quantity.words} exceeds" in s)
        items.append(f"{strong(capital(quantity.words) + '.')} {plain(f'{text} {_needed(population, broken)}')}")
    return items


def _least(population: Population, score: str, target: int, limit: float) -> tuple[int, Exceedance]:
    """Return the estimator whose error exceeds a limit least often, and how often."""
    errors = getattr(population, score)[target]
    broken = {e: exceedance(errors[e], limit) for e in population.design.giving(target)}
    return min(broken.items(), key=lambda item: item[1].probability.value)


def _needed(population: Population, broken: Exceedance) -> str:
    needed, within = broken.needed(population.within), percent(population.within)
    if needed <= broken.points:
        return f"{broken.points} points suffice for an interval of ±{within}."
    return f"An interval of ±{within} takes about {needed} points, {needed - broken.points} more."


def _share(probability: Interval) -> str:
    value, lower, upper = (f"{100 * p:.3g}" for p in probability)
    return f"{value} % ({lower} to {upper} %)"


def _rule(population: Population) -> str:
    design = population.design
    drives = f"{len(design.drives)} drive{'s' if len(design.drives) > 1 else ''}"
    return (
        f"{design.status.shape[3]} vehicles drawn from the joint distribution in {population.scramblings} independent "
        f"scramblings, each on {drives}. An error is that on the worst drive of a vehicle: its "
        "RMSE, and its largest error at any time; that of a diverged run is infinite. Intervals are at 95 %, by "
        "Student's t over the scramblings; where few vehicles exceed a limit, or nearly all, by Clopper and Pearson. "
        f"The mean of the largest errors is over the worst {100 * TAIL:g} % (conditional value at risk)."
        f"{uncontrolled(design)}"
    )


def _picture(analysis: Analysis, population: Population, target: int) -> Picture:
    design, quantity = population.design, population.design.targets[target]
    question = f"How often is the error of the {quantity.words} larger than this?"
    giving = design.giving(target)
    with style.drawing():
        fig = style.figure(3.4)
        axes = fig.subplots()
        for e in giving:
            name = design.estimators[e]
            for score, dashes in _DASHES.items():
                errors = np.sort(getattr(population, score)[target, e].ravel())
                above = 1.0 - np.arange(len(errors)) / len(errors)
                shown = np.isfinite(errors)
                with style.series(axes, name):
                    axes.plot(errors[shown], above[shown], color=analysis.looks[name].line, ls=dashes,
                              drawstyle="steps-pre")  # fmt: skip
        handles = [
            Line2D([], [], color=analysis.looks[n].line, label=n) for n in (design.estimators[e] for e in giving)
        ]
        handles += [Line2D([], [], color="black", ls=dashes, label=_CALLED[s]) for s, dashes in _DASHES.items()]
        if (limit := population.limits.get(target)) is not None:
            axes.axvline(limit, color="black", lw=0.8, ls=":")
            handles.append(Line2D([], [], color="black", lw=0.8, ls=":", label="limit"))
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g} %"))
        axes.set_ylabel("share of the vehicles beyond")
        axes.set_xlabel(f"error{style.in_unit(quantity.unit)}")
        axes.set_xlim(left=0.0)
        axes.grid()
        style.head(fig, question, handles)
        svg = style.svg(fig)
    caption = (
        f"Share of the {design.status.shape[3]} vehicles of design “{design.name}” whose error of {quantity.words} on "
        "the worst drive is larger than a value: RMSE, and largest error at any time."
    )
    return Picture(svg, caption, question)


def _limit_table(population: Population, target: int) -> list[Block]:
    design, quantity = population.design, population.design.targets[target]
    if (limit := population.limits.get(target)) is None:
        return []
    rows = []
    for e in design.giving(target):
        for k, (score, called) in enumerate(_CALLED.items()):
            broken = exceedance(getattr(population, score)[target, e], limit)
            events = f"{broken.events} of {broken.points}"
            needed = str(broken.needed(population.within))
            rows.append(["" if k else design.estimators[e], called, events, _share(broken.probability), needed])
    caption = (
        f"How often the error of {quantity.words} exceeds {with_unit(limit, quantity.unit)} in design “{design.name}”, "
        f"and how many points an interval of ±{percent(population.within)} takes."
    )
    return [Sheet(["estimator", "of the", "vehicles", "probability", "points"], rows, caption, left=2)]


def _quantile_table(population: Population, target: int) -> Sheet:
    design, quantity = population.design, population.design.targets[target]
    rows = []
    for e in design.giving(target):
        for k, (score, called) in enumerate(_CALLED.items()):
            errors: Floats = getattr(population, score)[target, e]
            numbers = [_interval(quantile(errors, share)) for share in QUANTILES]
            rows.append(["" if k else design.estimators[e], called, *numbers, _interval(tail_interval(errors))])
    header = ["estimator", "of the", *(f"{100 * share:g} %" for share in QUANTILES), f"worst {100 * TAIL:g} %"]
    caption = (
        f"Quantiles of the error of {quantity.words}{style.in_unit(quantity.unit)} over the vehicles of design "
        f"“{design.name}”, and the mean of the largest errors, with 95 % intervals."
    )
    return Sheet(header, rows, caption, left=2)


def _interval(estimate: Interval) -> str:
    if np.isinf(estimate.value):
        return "diverged"
    return f"{number(estimate.value)}\n{number(estimate.lower)} to {number(estimate.upper)}"
