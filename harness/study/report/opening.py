"""Answer of a study in words: which estimator bears the deviations best, and how much the error grows in each design.

The report opens with it and ``harness run`` ends with it. It is built from names and numbers of the store alone, so it
fits any study: one level or many, any number of factors, targets, estimators and designs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.models.quantities import Quantity, listed
from harness.reporting.style import number, percent, with_unit
from harness.study.report.analysis import Analysis
from harness.study.report.levels import NAMED, phrase
from harness.study.report.overall import ALIKE, Standing, standings
from harness.study.report.ranking import limits_of
from harness.study.results import Design
from harness.study.scores import PENDING

_STEADY = 0.02


def answer_in_short(analysis: Analysis) -> str:
    """Return the answer of a study in some sentences."""
    best, harms, counts = sentences(analysis)
    return " ".join([*best, *harms, *counts])


def sentences(analysis: Analysis) -> tuple[list[str], list[str], list[str]]:
    """Return the answer in parts.

    Returns:
        Which estimator is best over all designs, nothing of a single one; what each design does to the error, the
        most harmful one first; and what was lost.
    """
    of_targets = standings(analysis.findings, limits_of(analysis.store.attributes))
    scored = [s for s in of_targets if s.order]
    counts = _counts(analysis.store.designs)
    if not scored:
        return ["No run has a score."], [], counts
    return _best(scored), _harms(scored), counts


def _best(scored: Sequence[Standing]) -> list[str]:
    """Say which estimator bears all designs best, with its losses, and which is last; for each target that differs."""
    designs = [f.design for f in scored[0].designs]
    if len(designs[0].estimators) == 1:
        return []
    groups: dict[tuple[int, ...], list[Standing]] = {}
    for standing in scored:
        groups.setdefault(tuple(sorted(standing.leaders)), []).append(standing)
    over = f" over {_all(designs)}" if len(designs) > 1 else ""
    return [_leading(group, designs, over, len(groups) > 1) for group in groups.values()]


def _all(designs: Sequence[Design]) -> str:
    return "both designs" if len(designs) == 2 else f"all {len(designs)} designs"


def _leading(group: Sequence[Standing], designs: Sequence[Design], over: str, several: bool) -> str:
    """Return which estimators are best for some targets and by what, and which is the last."""
    leaders, given, last = group[0].leaders, group[0].order, group[0].order[-1]
    names = designs[0].estimators
    aim = f"for the {listed([_quantity(s).words for s in group])} " if several else ""
    who = _everyone([_with_losses(designs, names[e], e) for e in leaders])
    sizes = listed([_numbers(s, s.leaders[0], not several or len(group) > 1) for s in group])
    if len(leaders) == len(given):
        alike = f"are alike within {100 * ALIKE:.0f} %" if len(given) > 1 else "alone gives it"
        text = f"{aim}{who} {alike}{over}, with a median error of {sizes}"
    else:
        verb = "is the best" if len(leaders) == 1 else "are the best"
        text = f"{aim}{who} {verb} of {len(given)}{over}, with a median error of {sizes}"
        if all(s.order[-1] == last for s in group):
            text += f"; {_with_losses(designs, names[last], last)} is the last"
            if all(np.isfinite(s.mean[last]) for s in group):
                text += f" with {listed([_numbers(s, last, False) for s in group])}"
    return f"{_capital(text) if several else text}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _quantity(standing: Standing) -> Quantity:
    return standing.designs[0].design.targets[standing.target]


def _numbers(standing: Standing, e: int, named: bool) -> str:
    """Return the error of an estimator in the mean over all levels, at worst, and how often it is within the limit."""
    quantity = _quantity(standing)
    text = with_unit(standing.mean[e], quantity.unit)
    worst = float(np.fmax.reduce(standing.worst[:, e]))
    if worst > standing.mean[e] * (1 + _STEADY):
        text += f" (at worst {with_unit(worst, quantity.unit)})"
    text += f" in the {quantity.words}" if named else ""
    if standing.limit is None:
        return text
    share = percent(float(standing.within[:, e].mean()))
    return f"{text}, within {with_unit(standing.limit, quantity.unit)} in {share} of the runs"


def _with_losses(designs: Sequence[Design], name: str, e: int) -> str:
    """Name an estimator with the runs in which it diverged, if there are any."""
    diverged = sum(d.diverged(e) for d in designs)
    return f"{name} (diverged in {diverged} of {sum(d.compared() for d in designs)} runs)" if diverged else name


def _harms(scored: Sequence[Standing]) -> list[str]:
    """Say what each design does to the error of the best estimator, the most harmful one first."""
    limited = [s for s in scored if s.limit is not None] or scored
    places = range(len(scored[0].designs))
    order = sorted(places, key=lambda place: -max(s.harm(place) for s in limited))
    shown = [text for place in order if (text := _harm(scored, place))]
    return [f"{_capital(text)}." for text in shown[:NAMED]] + (
        [f"The other {len(shown) - NAMED} designs do less."] if len(shown) > NAMED else []
    )


def _harm(scored: Sequence[Standing], place: int) -> str:
    """Return a sentence on a design: where the error of each target is largest, and from what it grows there."""
    design = scored[0].designs[place].design
    clauses: dict[int, list[str]] = {}
    for standing in scored:
        order = standing.order_in(place)
        if not order or not (standing.tells_growth(place) or len(design.estimators) == 1):
            continue
        band = int(np.nanargmax(standing.designs[place].medians[standing.target][:, order[0]]))
        subject = "that of the" if clauses else "the median error of the"
        clauses.setdefault(band, []).append(f"{subject} {_change(standing, place, order, band)}")
    texts = [f"{_where(design, band, first=not k)} {listed(parts)}" for k, (band, parts) in enumerate(clauses.items())]
    gone = [design.bands[b] for b in range(len(design.bands)) if design.out_of_control[b].all()]
    if gone:
        texts.append(f"at {listed(gone)} the vehicle goes out of control in every run")
    return "; ".join(texts)


def _where(design: Design, band: int, first: bool) -> str:
    """Say which level is meant, of the first also what it is compared with."""
    compared = first and design.matched is not None and design.matched != band
    text = phrase(design, band, design.matched if compared else None)
    return f"{text}," if compared else text


def _change(standing: Standing, place: int, order: Sequence[int], band: int) -> str:
    """Return e.g. ``sideslip angle grows from 0.2 to 2.4° (12 times) with EKF, the best (3° with UKF, the worst)``.

    Args:
        standing: Of the target.
        place: Index of the design.
        order: Its estimators, best first.
        band: Level at which the error of the best one is largest.
    """
    design, e, quantity = standing.designs[place].design, order[0], _quantity(standing)
    medians = standing.designs[place].medians[standing.target, band]
    after, before = float(medians[e]), standing.home(place, e)
    last = max(order, key=lambda other: medians[other])
    text = f"{quantity.words} "
    if before is None or not before > 0:
        text += f"is {with_unit(after, quantity.unit)}"
    elif after / before < 1 + _STEADY:
        text += f"stays at {with_unit(after, quantity.unit)}"
    else:
        text += f"grows from {number(before)} to {with_unit(after, quantity.unit)} ({_times(before, after)})"
    if standing.limit is not None:
        text += f", {'beyond' if after > standing.limit else 'within'} the limit"
    if len(design.estimators) == 1:
        return text
    if not medians[last] > (1 + ALIKE) * after:
        return f"{text} with {'all estimators' if len(order) > 1 else design.estimators[e]}"
    size = with_unit(float(medians[last]), quantity.unit) if np.isfinite(medians[last]) else "no bound"
    others = f"{size} with {design.estimators[last]}" + (", the worst" if len(order) > 2 else "")
    return f"{text} with {design.estimators[e]}, the best ({others})"


def _times(before: float, after: float) -> str:
    growth = after / before
    return f"{100 * (growth - 1):.0f} % more" if growth < 1.5 else f"{number(growth, 2)} times"


def at(design: Design, band: int) -> str:
    """Say at which level, e.g. ``at 24 t``."""
    return "over the whole box" if design.sampling == "saltelli" else f"at {design.bands[band]}"


def _everyone(names: Sequence[str]) -> str:
    return listed(names) if len(names) <= NAMED else f"the {len(names)} estimators"


def _counts(designs: Sequence[Design]) -> list[str]:
    """Say in how many runs the vehicle went out of control, in how many an estimator diverged, and what is to come."""
    runs = sum(d.out_of_control.size for d in designs)
    total = f"{runs} runs" if len(designs) == 1 else f"{runs} runs of {_all(designs)}"
    told = []
    out = {d.name: int(d.out_of_control.sum()) for d in designs}
    if lost := sum(out.values()):
        where = f" ({listed([f'{n} of {name}' for name, n in out.items() if n])})" if len(designs) > 1 else ""
        told.append(f"In {lost} of {total} the vehicle itself goes out of control{where}: they count for no estimator.")
    names = dict.fromkeys(name for d in designs for name in d.estimators)
    diverged = {n: sum(d.diverged(d.estimators.index(n)) for d in designs if n in d.estimators) for n in names}
    if losses := [f"{name} in {n}" for name, n in diverged.items() if n]:
        told.append(f"Of {sum(d.compared() for d in designs)} runs under control diverged {listed(losses)}.")
    if pending := sum(d.count(PENDING, None, 0) for d in designs):
        told.append(f"{pending} of {total} are still to come.")
    return told
