"""Answer of a study in words: which estimator bears the deviations best, and how much the error grows in each design.

The report opens with it and ``harness run`` ends with it. It is built from names and numbers of the store alone, so it
fits any study: one level or many, any number of factors, targets, estimators and designs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.models.quantities import Quantity, capital, listed
from harness.reporting.style import number, percent, with_unit
from harness.study.report.analysis import Analysis
from harness.study.report.levels import NAMED, phrase
from harness.study.report.overall import ALIKE, Standing, standings
from harness.study.report.ranking import limits_of
from harness.study.results import Design
from harness.study.score_names import PENDING

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
    scored, designs = [s for s in of_targets if s.order], analysis.store.designs
    counts = _counts(designs)
    if not scored:
        return ["No run has a score."], [], counts
    return _best(scored, designs), _harms(scored), counts


def _best(scored: Sequence[Standing], designs: Sequence[Design]) -> list[str]:
    """Say which estimator bears all designs best, with its losses, and which is worst; for each target that differs."""
    levelled = [f.design for f in scored[0].designs]
    if len(designs[0].estimators) == 1:
        return []
    groups: dict[tuple[int, ...], list[Standing]] = {}
    for standing in scored:
        groups.setdefault(tuple(sorted(standing.leaders)), []).append(standing)
    over = f" over {_all(levelled)}" if len(levelled) > 1 else ""
    return [_leading(group, designs, over, len(groups) > 1) for group in groups.values()]


def _all(designs: Sequence[Design]) -> str:
    return "both designs" if len(designs) == 2 else f"all {len(designs)} designs"


def _leading(group: Sequence[Standing], designs: Sequence[Design], over: str, several: bool) -> str:
    """Return which estimators are best for some targets and by what, and which is the worst."""
    leaders, given, last = group[0].leaders, group[0].order, group[0].order[-1]
    names = designs[0].estimators
    aim = f"for the {listed([_quantity(s).words for s in group])} " if several else ""
    who = _everyone([_with_losses(designs, names[e], e) for e in leaders])
    sizes = listed([_numbers(s, s.leaders[0], not several or len(group) > 1) for s in group])
    if len(leaders) == len(given):
        alike = f"are alike within {100 * ALIKE:.0f} %" if len(given) > 1 else "alone gives it"
        text = f"{aim}{who} {alike}{over}, with an error of {sizes}"
    else:
        verb = "is the best" if len(leaders) == 1 else "are the best"
        text = f"{aim}{who} {verb} of {len(given)}{over}, with an error of {sizes}"
        if all(s.order[-1] == last for s in group):
            text += f"; {_with_losses(designs, names[last], last)} is the worst"
            if all(np.isfinite(s.mean[last]) for s in group):
                text += f" with {listed([_numbers(s, last, False) for s in group])}"
    return f"{capital(text) if several else text}."


def _quantity(standing: Standing) -> Quantity:
    return standing.designs[0].design.targets[standing.target]


def _numbers(standing: Standing, e: int, named: bool) -> str:
    """Return the median error in the mean over all levels and at the worst one, and how often it keeps the limit."""
    quantity = _quantity(standing)
    text = with_unit(standing.mean[e], quantity.unit)
    worst = float(np.fmax.reduce(standing.worst[:, e]))
    if worst > standing.mean[e] * (1 + _STEADY):
        text += f" ({with_unit(worst, quantity.unit)} at the worst level)"
    text += f" in the {quantity.words}" if named else ""
    if standing.limit is None:
        return text
    share = percent(float(np.average(standing.within[:, e], weights=standing.weights)))
    return f"{text}, within {with_unit(standing.limit, quantity.unit)} in {share} of the runs"


def _with_losses(designs: Sequence[Design], name: str, e: int) -> str:
    """Name an estimator with the runs in which it diverged, if there are any."""
    diverged = sum(d.diverged(e) for d in designs)
    return f"{name} (diverged in {diverged} of {sum(d.compared() for d in designs)} runs)" if diverged else name


def _harms(scored: Sequence[Standing]) -> list[str]:
    """Say what each design does to the error of the best estimator, the most harmful one first.

    A design of the same factors that does the same as one before it, such as a band around its levels, is not said.
    """
    limited = [s for s in scored if s.limit is not None] or scored
    harms = {place: max(s.harm(place) for s in limited) for place in range(len(scored[0].designs))}
    shown: dict[int, str] = {}
    for place in sorted(harms, key=lambda place: -harms[place]):
        factors = [(f.name, f.of) for f in scored[0].designs[place].design.factors]
        again = any(
            [(f.name, f.of) for f in scored[0].designs[other].design.factors] == factors
            and harms[other] * (1 - ALIKE) <= harms[place]
            for other in shown
        )
        if not again and (text := _harm(scored, place)):
            shown[place] = f"{capital(text)}."
    more = len(shown) - NAMED
    return list(shown.values())[:NAMED] + ([f"The other {more} designs do less."] if more > 0 else [])


def _harm(scored: Sequence[Standing], place: int) -> str:
    """Return a sentence on a design: where the error of each target is largest, and from what it grows there."""
    design = scored[0].designs[place].design
    clauses: dict[int, list[str]] = {}
    for standing in scored:
        if not standing.order_in(place) or not (standing.tells_growth(place) or len(design.estimators) == 1):
            continue
        level = standing.worst_level(place)
        subject = "that of the" if clauses else "the median error of the"
        clauses.setdefault(level, []).append(f"{subject} {_change(standing, place, level)}")
    texts = [f"{_where(design, level, not k)} {_joined(parts)}" for k, (level, parts) in enumerate(clauses.items())]
    return "; ".join([*texts, *_out_of_control(design)])


def _joined(parts: Sequence[str]) -> str:
    return "; ".join(parts) if any("," in part for part in parts) else listed(parts)


def _out_of_control(design: Design) -> list[str]:
    """Say at which levels of a design the vehicle goes out of control, in how many runs."""
    clauses = []
    of_vehicle = design.out_of_control & ~design.lost
    for what, which in (("the vehicle goes out of control in", of_vehicle), ("the plant's code lost", design.lost)):
        runs = which.sum(axis=(1, 2, 3))
        some = [f"{n} of {design.planned} runs at {design.bands[b]}" for b, n in enumerate(runs) if n]
        if len(some) > NAMED:
            some = [f"{runs.sum()} of {design.planned * len(runs)} runs, at {len(some)} of {len(runs)} levels"]
        if some and len(design.bands) > 1:
            clauses.append(f"{what} {listed(some)}")
    return clauses


def _where(design: Design, band: int, first: bool) -> str:
    """Say which level is meant, of the first also what it is compared with."""
    compared = first and design.matched is not None and design.matched != band
    text = phrase(design, band, design.matched if compared else None)
    return f"{text}," if compared else text


def _change(standing: Standing, place: int, level: int) -> str:
    """Return e.g. ``sideslip angle grows from 0.2 to 2.4° (12 times) with EKF, the best, and is 3° with UKF``."""
    design, quantity = standing.designs[place].design, _quantity(standing)
    medians, order = standing.designs[place].medians[standing.target, level], standing.order_in(place)
    after, before = float(medians[order[0]]), standing.home(place, order[0], level)
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
    alike, last = standing.alike(place, level), max(order, key=lambda e: medians[e])
    everyone = len(alike) == len(order) > 2
    text += " with all estimators" if everyone else f" with {_everyone([design.estimators[e] for e in alike])}"
    if last in alike:
        return text
    if not np.isfinite(medians[last]):
        return f"{text}, while {design.estimators[last]} diverges in most runs"
    worst = ", the worst" if len(order) > 2 else ""
    return f"{text}, and is {with_unit(float(medians[last]), quantity.unit)} with {design.estimators[last]}{worst}"


def _times(before: float, after: float) -> str:
    growth = after / before
    return f"{100 * (growth - 1):.0f} % more" if growth < 1.5 else f"{number(growth, 2)} times"


def at(design: Design, band: int) -> str:
    """Say at which level, e.g. ``at 24 t``."""
    return f"over the {design.whole}" if design.whole else f"at {design.bands[band]}"


def _everyone(names: Sequence[str]) -> str:
    return listed(names) if len(names) <= NAMED else f"the {len(names)} estimators"


def _counts(designs: Sequence[Design]) -> list[str]:
    """Say in how many runs the vehicle went out of control, in how many an estimator diverged, and what is to come."""
    runs, counted = sum(d.out_of_control.size for d in designs), []
    out_of_control = any(d.out_of_control.any() for d in designs)
    for words, which in (
        ("the vehicle itself goes out of control", [d.out_of_control & ~d.lost for d in designs]),
        ("the plant's code failed, not the vehicle", [d.lost for d in designs]),
    ):
        out = {d.name: (int(each.sum()), each.size) for d, each in zip(designs, which, strict=True)}
        if without := sum(n for n, _ in out.values()):
            where = listed([f"{n} of {size} in the design “{name}”" for name, (n, size) in out.items() if n])
            scope = f" ({where})" if len(designs) > 1 else ""
            counted.append(f"In {without} of {runs} runs{scope} {words}; these are left out for every estimator.")
    names = dict.fromkeys(name for d in designs for name in d.estimators)
    diverged = {n: sum(d.diverged(d.estimators.index(n)) for d in designs if n in d.estimators) for n in names}
    if losses := [
        f"{name} diverged in {diverged[name]}" for name in sorted(names, key=lambda n: -diverged[n]) if diverged[name]
    ]:
        under_control = sum(d.compared() for d in designs)
        scope = (
            f"{under_control} runs in which the vehicle stayed under control"
            if out_of_control
            else f"{under_control} runs"
        )
        counted.append(f"Of {scope}, {listed(losses)}.")
    if pending := sum(d.count(PENDING, None, 0) for d in designs):
        counted.append(f"{pending} of {runs} runs are still to come.")
    return counted
