"""The answer on remedies in words; every number in it is computed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.models.quantities import listed, words
from harness.remedy.choices import AS_IT_IS, Equipment, Remedy
from harness.remedy.judge import RemedyOutcome, best, helps, nominal_cost, without_sensor
from harness.remedy.run import Tried
from harness.reporting.style import number, percent, with_unit

_NOTHING_LEARNT = 0.5
"""Share of its first deviation above which a drive hardly tells a parameter."""


def answer(tried: Tried) -> str:
    """Return the answer in a sentence or two."""
    return next(_main(tried))


def times(ratio: float) -> str:
    """Write a ratio, ``1.2×``."""
    return "∞" if np.isinf(ratio) else f"{number(ratio, 2)}×" if np.isfinite(ratio) else "–"


def _main(tried: Tried) -> Iterator[str]:
    first = tried.outcomes[0]
    if not helps(tried.best, first):
        small = "makes the boxes a quarter wider" if first.boxes else "takes a fifth off the error at the worst level"
        yield (
            f"Nothing that was tried helps against the {drivers_of(tried)}: no remedy {small}, also not with further "
            "sensors."
        )
        return
    bare = best(without_sensor(tried.outcomes), first)
    text = f"The best of {len(tried.outcomes)} is to {tried.best.remedy.words}. {_effect(tried.best, first)}"
    if tried.best.remedy.added:
        if helps(bare, first):
            text += f" Without a further sensor the best is to {bare.remedy.words}. {_effect(bare, first)}"
        else:
            text += " Without a further sensor nothing that was tried helps."
    yield text


def _effect(o: RemedyOutcome, first: RemedyOutcome) -> str:
    """Say what a remedy does to the boxes, else to the errors at the worst level."""
    parts = []
    if o.boxes:
        for t, tolerated in o.boxes.items():
            grown = f"from {percent(first.boxes[t].box)} to {percent(tolerated.box)}"
            parts.append(f"{grown} of the way for the {first.targets[t].words}")
        return f"The box that is tolerated goes {listed(parts)}."
    for t, target in enumerate(first.targets):
        before, after = float(first.medians[t].max()), float(o.medians[t].max())
        parts.append(f"from {number(before)} to {with_unit(after, target.unit)} for the {target.words}")
    level = " at the worst level" if len(first.levels) > 1 else ""
    return f"The median error{level} goes {listed(parts)}."


def drivers_of(tried: Tried) -> str:
    """Return the parameters or effects that drive the error."""
    return listed([words(d) for d in tried.drivers])


def further(tried: Tried) -> Iterator[tuple[str, str]]:
    """Return what else there is to say, each with its head."""
    first, taken = tried.outcomes[0], tried.best
    if tried.traced:
        yield "What is wrong?", f"The vehicle has {drivers_of(tried)}, the estimator believes the model without."
    else:
        yield (
            "What drives the error?",
            f"Of what the study varies, {drivers_of(tried)}; remedies are tried against this.",
        )
    if tried.ideal is not None and taken is not first:
        ratios = taken.medians.max(axis=1) / tried.ideal.medians.max(axis=1)
        phrase = listed([f"{times(float(r))} for the {q.words}" for r, q in zip(ratios, first.targets, strict=True)])
        ideal = "believing the amended model" if tried.traced else "with the parameters known"
        yield "How near to the ideal?", f"The error at the worst level over that {ideal}: {phrase}."
    if better := _could_be_better(tried):
        yield "Could any estimator do better?", better
    yield "What does it cost?", _cost(tried)
    if np.isfinite(taken.nees):
        yield (
            "Can its stated uncertainty be believed?",
            f"NEES {number(taken.nees, 2)} times its expectation in the median, {number(first.nees, 2)} as it is; "
            f"{percent(taken.consistent)} of the runs are below their bound, {percent(first.consistent)} as it is.",
        )
    if taken is not first:
        yield "What does it need?", _need(taken.remedy, tried)
    if not tried.traced:
        yield "Why not without a sensor?", _without(tried)


def _could_be_better(tried: Tried) -> str:
    """Say what the best estimator is left with where the parameters are unknown, by sensors of the study and best."""
    parts = []
    for equipment in dict.fromkeys((None, tried.best.remedy.equipment)):
        if equipment not in tried.promise:
            continue
        smallest = tried.promise[equipment].smallest
        phrases = []
        for t, target in enumerate(tried.best.targets):
            drive = int(np.argmax(smallest[:, t]))
            error, limit = float(smallest[drive, t]), _limit(tried, t)
            beyond = f", above the limit of {with_unit(limit, target.unit)}" if error > limit else ""
            where = words(tried.study.drives[drive].name)
            phrases.append(f"{with_unit(error, target.unit)} in the {target.words} ({where}{beyond})")
        sensors = f"{Remedy(equipment=equipment).measures} in addition" if equipment else "the study's own sensors"
        parts.append(f"with {sensors} {listed(phrases)}")
    if not parts:
        return ""
    return (
        "The parameters being as unknown as the study varies them, the best estimator that there can be is left on "
        f"its worst drive with an RMSE of: {'; '.join(parts)} (Cramér-Rao bound)."
    )


def _limit(tried: Tried, t: int) -> float:
    """Return the limit of a target in report units, infinite if the study has none."""
    target = tried.best.targets[t]
    return tried.study.limits.get(target.name, np.inf) * target.scale


def _cost(tried: Tried) -> str:
    first, taken = tried.outcomes[0], tried.best
    cost = nominal_cost(taken, first)
    text = f"Where the vehicle is as believed the error is {times(cost)} that as it is. " if np.isfinite(cost) else ""
    text += f"A step takes {times(tried.slower[0])} the time"
    if np.isfinite(tried.slower[1]):
        text += f", {times(tried.slower[1])} that with these sensors alone"
    before, after = tried.cycle
    if np.isfinite(after):
        share = after / taken.study.belief.step
        text += f"; alone on a core {number(1e6 * after, 2)} µs in place of {number(1e6 * before, 2)} µs, "
        text += f"{percent(share)} of the cycle of {1e3 * taken.study.belief.step:g} ms"
    return text + "."


def _need(remedy: Remedy, tried: Tried) -> str:
    signals = listed([words(s) for s in remedy.added]) if remedy.added else ""
    sensors = f"Measured in addition: {signals}." if signals else "No further sensor."
    if not (remedy.estimated or remedy.banked) or remedy.equipment not in tried.promise:
        return sensors
    if not tried.study.score_after:
        sensors += " The time in which it learns counts; score_after of the study leaves it out."
    poor = _poor_drives(tried, remedy.equipment, remedy.estimated + remedy.banked)
    if not poor:
        return f"{sensors} Every drive excites what is estimated."
    return f"{sensors} Excitation: after {listed(poor)} even the best estimator knows hardly more than before."


def _poor_drives(tried: Tried, equipment: Equipment | None, names: Sequence[str]) -> list[str]:
    """Return the drives that hardly tell some of the parameters named."""
    remaining = tried.promise[equipment].remaining[:, [tried.drivers.index(n) for n in names]].max(axis=1)
    drives = [words(d.name) for d in tried.study.drives]
    return [n for n, share in zip(drives, remaining, strict=True) if share > _NOTHING_LEARNT]


def _without(tried: Tried) -> str:
    """Say what the study's own sensors could tell at best."""
    if None not in tried.promise:
        return "What its sensors could tell was not computed."
    worst = tried.promise[None].remaining.max(axis=1)
    poor = _poor_drives(tried, None, tried.drivers)
    text = (
        f"With the study's own sensors {percent(float(np.median(worst)))} of the first uncertainty is left at best in "
        "the median over the drives"
    )
    if poor:
        text += f", and more than half after {listed(poor)}"
    first = tried.outcomes[0]
    tried_alone = [o for o in without_sensor(tried.outcomes) if o.remedy != AS_IT_IS]
    if tried_alone and not any(helps(o, first) for o in tried_alone):
        text += (
            ". No filter tried turns that into a smaller error: what little the sensors tell of the parameters is not "
            "told apart from what else is unknown"
        )
    return text + "."
