"""Agreement of a signal of a recording with the one that kinematics computes from the others.

A measured signal is explained by ``y(t) = k c(t - delay) + offset + arm e(t)``. Both sides carry errors, so the slope
is known only to lie between the regression of one on the other and the inverse of that of the other on the one (Frisch
1934); their geometric mean is stated, and the interval counts as uncertainty. The other standard errors are those of
least squares with residuals that are coloured, as they always are here (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.units import registry
from harness.models.quantities import print_unit
from harness.models.signals import SIGNALS
from harness.recordings.motion.kinematics import Sources
from harness.recordings.motion.pair_fit import (
    LONGEST_DELAY,
    MEMORY,
    RELATED,
    SPACING,
    Agreement,
    correlation_peak,
    fit_pair,
    is_slow,
    slow,
)
from harness.recordings.motion.redundancy import MOVING, RELATIONS, Relation

WINDOWS = (0.3, 0.6, 1.2, 2.4)
"""s over which both sides are smoothed, so that their bandwidths are alike; the one with most information is taken."""
_SAMPLES = 2.4
"""Samples of the slowest signal in a window: what is between them is interpolated, not measured."""
SURE = 4.0
"""Standard errors beyond which a deviation is reported."""
LEAST_SCALE = {True: 0.0015, False: 0.02}
"""Least deviation of a slope from 1 that is reported, for signals that are zero together (distance), and for others."""
LEAST_DELAY = 0.005
"""s; least delay that is reported."""
LEAST_OFFSET = 0.1
"""Least offset, in standard deviations of the signal, that is reported."""
TOLERANCE = {"rad": 0.01, "rad/s": 0.01, "rad/s^2": 0.1, "m/s": 0.1, "m/s^2": 0.3, "m": 0.1}
"""Standard deviation by unit that occurs without a fault, by a bank of the road, roll and vibration."""
_LIVELY = 3.0
"""Standard deviations of the tolerance by which a signal must vary to be judged."""
_CRAWLS, _USUAL = 0.5, 0.9
"""m/s below which a speed is no more than the drift of positions, and the share of the time."""
_FREE = 2.5
"""Factor by which a slope may be off beyond which the relation has no scale of its own (a wheelbase)."""
_MISALIGNED = np.radians(3.0)
"""rad by which heading and course may differ all the time, for the mounting of a sensor and the sideslip."""

AGREES, DISAGREES, NOT_JUDGED = "agrees", "does not agree", "could not be judged"


class DelayUnknown(UserError):
    """A delay that the map wants estimated cannot be."""


@dataclass(frozen=True)
class Origin:
    """Where a signal comes from.

    Attributes:
        channel: Its column.
        rate: Hz, of the column's own samples.
        clock: Number of its clock.
        delay: s that the map takes out already.
    """

    channel: str = ""
    rate: float = np.nan
    clock: int = 0
    delay: float = 0.0


class SmoothedSignals:
    """The signals, smoothed over each of the windows and alike up to each derivative, each computed once.

    Attributes:
        signals: Arrays ``(samples,)`` in SI units by name.
        step: s between samples.
        origins: Where each signal comes from.
    """

    def __init__(self, signals: Mapping[str, Floats], step: float, origins: Mapping[str, Origin] | None = None) -> None:
        self.signals, self.step, self.origins = signals, step, origins or {}
        self._sources = {(w, n): Sources(signals, step, w, n) for w in WINDOWS for n in range(3)}

    def sources(self, relation: Relation, window: float) -> Sources:
        """Return the signals as a relation takes them."""
        return self._sources[window, relation.highest]

    def origin(self, signal: str) -> Origin:
        """Return where a signal comes from; the only clock where nothing else is stated."""
        return self.origins.get(signal, Origin())

    def may_drift(self, relation: Relation) -> bool:
        """Return whether the two sides of a relation have several clocks."""
        return len({self.origin(n).clock for n in relation.signals}) > 1

    def unresolved(self, relation: Relation) -> float:
        """Return how much of the slope is open: by what a sample has apart from its neighbours, and by the bank."""
        native = self.origin(relation.signal).rate
        every = max(round(1 / (native * self.step)), 1) if native > 0 else 1
        values = self.signals[relation.signal][::every]
        apart = values[1:-1] - (values[2:] + values[:-2]) / 2
        if not np.isfinite(apart).any():
            return 0.0
        size = _spread(relation, values)
        return float(np.hypot(np.nanmean(apart**2) / size**2, relation.bank / size)) if size > 0 else 0.0

    def windows(self, relation: Relation) -> tuple[float, ...]:
        """Return the windows that smooth over several samples of the slowest of the signals, at least the longest."""
        slowest = max((1 / self.origin(n).rate for n in relation.signals if self.origin(n).rate > 0), default=0.0)
        return tuple(w for w in WINDOWS if w >= _SAMPLES * slowest) or WINDOWS[-1:]


def applicable(signals: Mapping[str, Floats], derived: Collection[str] = ()) -> list[Relation]:
    """Return the relations that recorded signals allow, without those that derived ones make trivial.

    One channel under two names is compared once, and of one signal and formula the first counts.
    """
    relations: list[Relation] = []
    twins = {n: _first_twin(n, signals) for n in signals}
    done: set[tuple[str, str]] = set()
    for relation in RELATIONS:
        if any(n not in signals or n in derived for n in relation.signals):
            continue
        key = twins[relation.signal], relation.formula
        if key not in done and twins[relation.signal] not in {
            twins[n] for n in relation.needs if len(relation.needs) == 1
        }:
            done.add(key)
            relations.append(relation)
    return relations


def _first_twin(name: str, signals: Mapping[str, Floats]) -> str:
    """Return the first signal with the same values."""
    return next(n for n, values in signals.items() if np.array_equal(values, signals[name], equal_nan=True))


def check(
    signals: Mapping[str, Floats],
    step: float,
    derived: Collection[str] = (),
    origins: Mapping[str, Origin] | None = None,
) -> list[Agreement]:
    """Compare every signal with the one that kinematics computes from the others.

    Args:
        signals: Arrays of shape ``(samples,)`` in SI units by name.
        step: s between samples.
        derived: Signals that were computed from others and so need no check.
        origins: Where each signal comes from.

    Returns:
        One comparison per relation that the signals allow, the exact ones first.
    """
    smoothed = SmoothedSignals(signals, step, origins)
    return [compare(relation, smoothed) for relation in applicable(signals, derived)]


def find_delay(signal: str, signals: dict[str, Floats], step: float, where: str) -> tuple[float, float]:
    """Return how late a signal is and the standard error, both in s, by the first exact relation that it has.

    Raises:
        DelayUnknown: If nothing recorded tells when the signal should have come, or the two do not agree well enough.
    """
    for relation in RELATIONS:
        if relation.signal == signal and relation.exact and all(n in signals for n in relation.needs):
            fit = compare(relation, SmoothedSignals(signals, step))
            if fit.scaled and np.isfinite(fit.delay):
                return fit.delay, fit.delay_std
            why = (
                f"only {fit.explained:.0%} of it is explained" if fit.explained < RELATED else fit.calm or fit.evidence
            )
            raise DelayUnknown(
                f"{where}: cannot be estimated against the {relation.formula}: {why}; state it in s, or choose a "
                "part with more manoeuvres by start and stop"
            )
    choices = [" and ".join(r.needs) for r in RELATIONS if r.signal == signal and r.exact]
    hint = f"it takes {' or '.join(choices)}" if choices else "no relation with other signals is known"
    raise DelayUnknown(f"{where}: '{signal}' has nothing to be compared with ({hint}); state the delay in s")


def compare(relation: Relation, smoothed: SmoothedSignals) -> Agreement:
    """Fit one relation and judge it."""
    windows = smoothed.windows(relation)
    sides = [_sides(relation, smoothed.sources(relation, window)) for window in windows]
    counts = [int((np.isfinite(m) & np.isfinite(c)).sum()) for m, c, _ in sides]
    step, measured, computed = smoothed.step, sides[0][0], sides[0][1]
    empty = Agreement(relation, NOT_JUDGED, (), counts[0], measured, computed, step,
                      unresolved=smoothed.unresolved(relation))  # fmt: skip
    if counts[0] * step < 4 * LONGEST_DELAY or counts[0] < 40:
        only = f" of those {relation.where}" if relation.where else ""
        least = max(4 * LONGEST_DELAY, 40 * step)
        too_few = f"both are known on {counts[0]} samples{only}, {counts[0] * step:.3g} s; {least:.3g} s are needed"
        return replace(empty, reasons=(too_few,))
    if relation.circular:
        return _turned(empty)
    usable = [side for side, count in zip(sides, counts, strict=True) if count > 0.5 * counts[0]]
    slow = crawls(relation, *usable[-1][:2])  # where noise counts least
    if slow is not None:
        drift = f"too slow: below {slow:.2g} m/s for {_USUAL:.0%} of the time, and positions drift as fast"
        return replace(empty, reasons=(drift,))
    calm = _calm(relation, *usable[-1][:2])
    if _still(measured, computed):
        return replace(empty, verdict=NOT_JUDGED, reasons=(calm,)) if calm else _one_still(empty)
    fits = [
        fit_pair(replace(empty, measured=m, computed=c), arm, w)
        for (m, c, arm), w in zip(usable, windows, strict=False)
    ]
    informed = [(f, _information(f, w)) for f, w in zip(fits, windows, strict=False) if f is not None]
    if not informed:
        return replace(empty, reasons=("too few samples on which both are known",))
    best = max(informed, key=lambda item: item[1])[0]
    if best.explained < RELATED and calm is not None:
        return replace(best, reasons=(calm,))
    sharp = [f for f, _ in informed if f.explained >= RELATED and np.isfinite(f.delay)]
    if best.scaled and sharp:  # noise turns no delay, only blurs it: a short window knows it best
        late = min(sharp, key=lambda f: f.delay_std)
        best = replace(best, delay=late.delay, delay_std=late.delay_std, window=late.window, arm=late.arm,
                       arm_std=late.arm_std, signal_share=late.signal_share, calm="")  # fmt: skip
        if smoothed.may_drift(relation):
            best = replace(best, drift=late.drift, drift_std=late.drift_std)
    judged = _judged(best)
    return replace(empty, reasons=(_QUICK,)) if _is_quick(judged) else judged


def _sides(relation: Relation, sources: Sources) -> tuple[Floats, Floats, Floats | None]:
    """Return the measured and the computed side, and what a lever arm would add."""
    measured = sources.rate(relation.signal, relation.order)
    computed = relation.compute(sources)
    arm = relation.arm(sources) if relation.arm is not None else None
    return measured, computed, arm if arm is not None and len(arm) == len(measured) else None


_QUICK = "too quick: the relation holds for slow steering, and what is slow of both does not disagree"


def _is_quick(fit: Agreement) -> bool:
    """Return whether quick motion alone turns or scales one side against the other, as slip angles build up."""
    if not (fit.relation.quasi_static and fit.off and fit.off <= {"sign", "scale"}):
        return False
    if is_slow((fit.measured, fit.computed), fit.step):
        return False
    sides = slow(fit.measured, fit.step), slow(fit.computed, fit.step)
    if not is_slow(sides, fit.step) or _calm(fit.relation, *sides) is not None:
        return True
    passed = fit_pair(replace(fit, measured=sides[0], computed=sides[1]), None, WINDOWS[-1])
    return passed is not None and _judged(passed).verdict == AGREES


def _information(fit: Agreement, window: float) -> float:
    """Return the information of a fit on its slope: windows share the time, noise shares the variance."""
    related = np.clip(fit.explained, 1e-3, 1 - 1e-9)
    return float(related / (1 - related) / window)


def tolerance(relation: Relation) -> float:
    """Return the standard deviation of a compared quantity that occurs without a fault, in SI units."""
    unit = SIGNALS[relation.signal].unit
    return TOLERANCE.get("rad/s" if relation.order and unit == "rad" else unit, 0.1)


def _spread(relation: Relation, values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt((finite**2).mean())) if relation.through_zero else float(finite.std())


def _calm(relation: Relation, measured: Floats, computed: Floats) -> str | None:
    """Return the reason why both sides vary too little to be compared; ``None`` if they vary enough."""
    both = np.isfinite(measured) & np.isfinite(computed)
    free = relation.slope[0] if relation.slope[1] > _FREE else 1.0
    largest = max(_spread(relation, measured[both]), free * _spread(relation, computed[both]))
    least = _LIVELY * tolerance(relation)
    if largest >= least:
        return None
    value, unit = _in_report_unit(relation, largest)
    needed, _ = _in_report_unit(relation, least)
    return f"too calm: varies by {value:.2g} {print_unit(unit)}, {needed:.2g} {print_unit(unit)} are needed"


def crawls(relation: Relation, measured: Floats, computed: Floats) -> float | None:
    """Return the speed in m/s at which a vehicle stands or crawls all the time; ``None`` if it moves.

    Positions that drift then make up a speed, which tells nothing of the unit of the measured one.
    """
    both = np.isfinite(measured) & np.isfinite(computed)
    if SIGNALS[relation.signal].unit != "m/s" or "position_x" not in relation.needs or not both.any():
        return None
    recorded, drifted = (float(np.quantile(np.abs(side[both]), _USUAL)) for side in (measured, computed))
    return recorded if recorded < _CRAWLS and drifted < MOVING else None


def _still(measured: Floats, computed: Floats) -> bool:
    """Return whether one side never changes."""
    both = np.isfinite(measured) & np.isfinite(computed)
    return any(np.ptp(v[both]) <= 1e-9 * np.abs(v[both]).max() for v in (measured, computed))


def _one_still(fit: Agreement) -> Agreement:
    """Judge a pair of which one side never changes: two that are zero together may both be constant."""
    both = np.isfinite(fit.measured) & np.isfinite(fit.computed)
    m, c = fit.measured[both], fit.computed[both]
    alike = fit.relation.through_zero and abs(m.mean() - c.mean()) < _LIVELY * tolerance(fit.relation)
    if alike:
        return replace(fit, reasons=("one of the two never changes",))
    which = "the signal" if np.ptp(m) < np.ptp(c) else "what it is compared with"
    reasons = (f"{which} never changes although the other side does",)
    return replace(fit, verdict=DISAGREES, reasons=reasons, off=frozenset({"still"}))


def _turned(fit: Agreement) -> Agreement:
    """Compare two angles up to full turns."""
    both = np.isfinite(fit.measured) & np.isfinite(fit.computed)
    difference = np.exp(1j * (fit.measured - fit.computed)[both])
    mean = difference.mean()
    offset, together = float(np.angle(mean)), float(np.abs(mean))
    spread = float(np.sqrt(-2 * np.log(max(together, 1e-12))))
    compared = replace(fit, offset=offset, offset_std=spread / np.sqrt(max(both.sum() * fit.step / MEMORY, 1)),
                    explained=together)  # fmt: skip
    if together < 0.95:
        return replace(
            compared, verdict=DISAGREES, reasons=(f"they differ by {np.degrees(spread):.0f}° from time to time",)
        )
    if abs(offset) > max(_MISALIGNED, SURE * compared.offset_std):
        reasons = (f"they differ by {np.degrees(offset):.1f}° throughout",)
        return replace(compared, verdict=DISAGREES, reasons=reasons, off=frozenset({"offset"}))
    return replace(compared, verdict=AGREES)


def _judged(fit: Agreement) -> Agreement:
    """Return a comparison with its verdict and, where the two disagree, the reasons."""
    relation = fit.relation
    centre, factor = relation.expected(fit.slope)
    off = np.log(abs(fit.slope) / centre) if fit.slope else -np.inf
    spread = fit.slope_std / abs(fit.slope) if fit.slope else np.inf
    free = np.log(factor)
    if fit.explained < RELATED:
        blocks = fit.samples * fit.step * max(int(SPACING / fit.step), 1) / MEMORY
        noisy = fit.slope > 0 and fit.explained * blocks > SURE**2 and abs(off) < max(2 * spread, free)
        reason = f"too noisy: R² {fit.explained:.2f}" if noisy else f"hardly related: R² {fit.explained:.2f}"
        return replace(fit, verdict=NOT_JUDGED if noisy else DISAGREES, reasons=(reason,))
    if not fit.determined:
        return replace(fit, reasons=(f"too noisy to tell a slope: {fit.slope:.3g} ± {fit.slope_std:.2g}",))
    reasons = {}
    if fit.slope < 0:
        reasons["sign"] = "opposite sign"
    limit = max(LEAST_SCALE[relation.through_zero], 3 * free, SURE * np.hypot(spread, free / 2))
    if abs(off) > limit:
        size = f"slope {abs(fit.slope) / centre:.4g} in place of 1" if centre == 1 else f"slope {fit.slope:.3g} 1/m"
        reasons["scale"] = size
    if relation.exact:
        reasons |= _shifts(fit)
        if not np.isfinite(fit.delay) and "relation" not in reasons and not fit.calm:
            fit = replace(fit, calm=f"too calm to tell a delay: {_manoeuvre(relation)}")
    verdict = DISAGREES if reasons else AGREES
    return replace(fit, verdict=verdict, reasons=tuple(reasons.values()), off=frozenset(reasons))


def _manoeuvre(relation: Relation) -> str:
    """Return the manoeuvre that would determine the delay of a signal."""
    along = relation.signal.startswith(("speed", "longitudinal"))
    return "accelerate and brake" if along else "steer from side to side"


def _shifts(fit: Agreement) -> dict[str, str]:
    """Return reasons by kind: delay, drift and offset of a signal."""
    reasons = {}
    if not np.isfinite(fit.delay):
        if fit.slope > 0 and _differ(fit):
            reasons["relation"] = f"alike at no delay up to {LONGEST_DELAY} s"
    elif abs(fit.delay) > max(LEAST_DELAY, SURE * fit.delay_std):
        way = "late" if fit.delay > 0 else "early"
        reasons["delay"] = f"{abs(fit.delay) * 1e3:.0f} ± {fit.delay_std * 1e3:.1f} ms {way}"
    if abs(fit.drift) > max(2 * LEAST_DELAY, SURE * fit.drift_std):
        shown = f"{fit.drift * 1e3:.0f} ± {fit.drift_std * 1e3:.1f} ms"
        reasons["drift"] = f"later by {shown} at the end than at the beginning"
    least = max(SURE * fit.offset_std, LEAST_OFFSET * float(np.nanstd(fit.measured)))
    if not fit.relation.through_zero and abs(fit.offset) > least:
        value, unit = in_report_unit(fit, fit.offset)
        spread, _ = in_report_unit(fit, fit.offset_std)
        reasons["offset"] = f"offset of {value:.3g} ± {spread:.2g} {print_unit(unit)}"
    return reasons


def _differ(fit: Agreement) -> bool:
    """Return whether both sides vary by more than the tolerance, and are correlated at no delay."""
    shift = round(correlation_peak(fit.measured, fit.computed, fit.step) / fit.step)
    measured, computed = fit.measured[max(shift, 0) :], fit.computed[max(-shift, 0) :]
    both = np.stack([v[: min(len(measured), len(computed))] for v in (measured, computed)])
    both = both[:, np.isfinite(both).all(axis=0)]
    lively = (both.std(axis=1) >= _LIVELY * tolerance(fit.relation)).all()
    return bool(lively and float(np.asarray(np.corrcoef(both))[0, 1]) ** 2 < RELATED)


def verdicts(fits: Sequence[Agreement]) -> str:
    """Return in one sentence how many comparisons agree, do not, or could not be judged, and why."""
    if not fits:
        return "nothing could be compared: no two of the signals are tied by kinematics"
    by = {v: [f for f in fits if f.verdict == v] for v in (AGREES, DISAGREES, NOT_JUDGED)}
    counts = {v: len(group) for v, group in by.items()}
    parts = [f"{counts[AGREES]} agree{'s' if counts[AGREES] == 1 else ''}"]
    if counts[DISAGREES]:
        parts.append(f"{counts[DISAGREES]} do{'es' if counts[DISAGREES] == 1 else ''} not")
    if counts[NOT_JUDGED]:
        reasons = [f"{f.name}: {', '.join(f.reasons)}" for f in by[NOT_JUDGED]]
        parts.append(f"{counts[NOT_JUDGED]} could not be judged because: {'; '.join(reasons)}")
    if calm := [f"{f.name} is {f.calm}" for f in fits if f.calm]:
        parts[-1] += f"; {'; '.join(calm)}"
    return f"{len(fits)} comparison{'s' if len(fits) > 1 else ''}: {', '.join(parts)}"


def in_report_unit(fit: Agreement, value: float) -> tuple[float, str]:
    """Return a value that is in the unit of the compared signal as reports show it, with the unit."""
    return _in_report_unit(fit.relation, value)


def _in_report_unit(relation: Relation, value: float) -> tuple[float, str]:
    signal = SIGNALS[relation.signal]
    per = "/s" if relation.order else ""
    return float(registry().Quantity(value, signal.unit).to(signal.report_unit).magnitude), signal.report_unit + per
