"""Which scales, offsets, delays and drifting clocks explain what is left between the signals? As few as possible.

Every comparison states a slope, an offset, a delay and a drift with their uncertainty. A channel that is off shows in
every comparison in which it takes part, by a share that is found by moving it a little. What explains all of them is
looked for among the sets of up to three causes: each has a probability beforehand and a normal spread, so that the
likelihood of a set is a normal one in closed form (spike and slab, George and McCulloch 1993).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.consistency import LEAST_DELAY, LEAST_OFFSET, LEAST_SCALE, SURE, tolerance
from harness.recordings.explain import Mended, View, sides
from harness.recordings.faults import Fault
from harness.recordings.pair_fit import Agreement
from harness.recordings.redundancy import Relation

SCALE, OFFSET, DELAY, DRIFT = "scale", "offset", "delay", "drift"

_MOST = 3
"""Causes of one kind that are looked for together."""
_NEEDS_NONE = 3.0
"""Share of the least deviation that is reported, as its standard deviation where nothing is wrong."""
_NEARLY = 0.75
"""Share of what a comparison must be off that a cause must be, which several comparisons make smaller and surer."""
_CALIBRATION = np.log(2.5)
"""Logarithm of the largest factor that is a calibration; what is further off has another reason."""
_KNOWS_NOTHING = 100.0
"""Standard error, in SI units, of a comparison that says nothing about a cause."""
_MOST_SHOWN = 100.0
"""Share by which a comparison moves with a channel, beyond which the sides are degenerate."""
_SMALL_STEP = {SCALE: 0.01, DELAY: 0.02}
_ALIGNED = np.radians(1.5)
"""rad by which the course differs from the heading without any fault."""
_SPREAD = {SCALE: 0.2, DELAY: 0.1, DRIFT: 0.1}
"""Standard deviation of a cause beforehand: relative, in s and in s over the recording; offsets by unit below."""
_OFFSETS = {"rad/s": 0.01, "m/s^2": 0.5, "m/s": 0.2, "rad": 0.05, "rad/s^2": 0.1}
_LIKELY, _SELDOM, _RARE = 0.03, 0.005, 0.0005
_UNSCALED = ("position", "heading", "latitude", "longitude")
"""Signals that have no scale of their own: a geodetic system and a compass are right or in another unit."""
_TRUSTED = ("position", "heading", "latitude", "longitude", "longitudinal_velocity", "lateral_velocity")
"""Signals of navigation units, which are less often wrong than those of the vehicle."""


@dataclass(frozen=True)
class Cause:
    """One thing that is a little off.

    Attributes:
        kind: ``SCALE``, ``OFFSET``, ``DELAY`` or ``DRIFT``.
        signals: The signals concerned: those of one channel, or of one clock.
        value, std: Factor minus 1, SI units, s, or s over the recording, with the standard error.
        posterior: Its probability among the causes that were looked at.
        clock: Which clock drifts or is late as a whole; -1 for a channel.
    """

    kind: str
    signals: tuple[str, ...]
    value: float
    std: float
    posterior: float
    clock: int = -1


def causes(
    fits: Sequence[Agreement],
    mended: Mended,
    faults: Sequence[Fault],
    twins: Mapping[str, tuple[str, ...]],
    clocks: Mapping[str, int],
) -> list[Cause]:
    """Return what is off by a little and explains the comparisons.

    Args:
        fits: Comparisons of the signals, mended of the faults.
        mended: The signals as recorded.
        faults: What was found wrong by the catalogue.
        twins: All signals that are read from the channel of a signal.
        clocks: Number of the clock by signal.
    """
    forms, time = mended.forms(faults)
    used = [f for f in fits if f.scaled or f.relation.circular]
    channels = list(dict.fromkeys(twins.get(n, (n,)) for f in used for n in f.relation.signals))
    shares = {kind: _shares(kind, used, channels, mended, forms, time) for kind in (SCALE, OFFSET, DELAY)}
    found = []
    for kind in (SCALE, OFFSET, DELAY, DRIFT):
        rows = [(n, *o) for n, f in enumerate(used) if (o := _observed(kind, f)) is not None]
        if not rows:
            continue
        place = [n for n, _, _ in rows]
        table = shares[DELAY if kind == DRIFT else kind][place]
        options = _options(kind, channels, table, clocks)
        needed = any(kind in used[n].off for n in place)
        observed, std = (np.array([row[k] for row in rows]) for k in (1, 2))
        found += _sparse(kind, observed, std, options, needed)
    return [c for c in found if _matters(c, used)]


def _observed(kind: str, fit: Agreement) -> tuple[float, float] | None:
    """Return what a comparison says about scale, offset, delay or drift, and the standard error."""
    relation = fit.relation
    if relation.circular:
        return (fit.offset, float(np.hypot(fit.offset_std, _ALIGNED))) if kind == OFFSET else None
    centre, factor = relation.slope
    if factor > 2 or not fit.scaled:
        return None
    if kind == SCALE:
        least = LEAST_SCALE[relation.through_zero] / _NEEDS_NONE + np.log(factor)
        found = float(np.log(fit.slope / centre)), float(np.hypot(fit.slope_std / fit.slope, least))
        if abs(found[0]) > _CALIBRATION:
            return None
    elif not relation.exact or (kind == OFFSET and relation.through_zero):
        return None
    elif kind == OFFSET:
        least = LEAST_OFFSET * float(np.nanstd(fit.measured)) / _NEEDS_NONE
        found = fit.offset, float(np.hypot(fit.offset_std, least))
    else:
        value, std = (fit.delay, fit.delay_std) if kind == DELAY else (fit.drift, fit.drift_std)
        found = value, float(np.hypot(std, LEAST_DELAY / _NEEDS_NONE))
    return found if np.isfinite(found).all() and found[1] < _KNOWS_NOTHING else None


class _Moved(View):
    """The signals of one hypothesis with some of them moved a little."""

    def __init__(self, view: View, step: float, kind: str, names: Collection[str], by: float) -> None:
        super().__init__(view.mended, view.signals, step)
        self._kind, self._names, self._by = kind, names, by

    def rate(self, name: str, derivative: int = 1) -> Floats:
        values = super().rate(name, derivative)
        if name not in self._names:
            return values
        if self._kind == SCALE:
            return values * (1 + self._by)
        if self._kind == OFFSET:
            return values + self._by if derivative == 0 else values
        return values - self._by * super().rate(name, derivative + 1)  # late


def _shares(
    kind: str,
    fits: Sequence[Agreement],
    channels: Sequence[tuple[str, ...]],
    mended: Mended,
    forms: Mapping[str, object],
    time: float,
) -> Floats:
    """Return by how much each comparison moves with each channel, ``(comparisons, channels)``."""
    step = mended.step * time
    view = View(mended, forms, step)  # type: ignore[arg-type]
    found = np.zeros((len(fits), len(channels)))
    for n, fit in enumerate(fits):
        relation = fit.relation
        measured, computed = sides(relation, view)
        for m, names in enumerate(channels):
            if not set(names) & set(relation.signals):
                continue
            if relation.circular:
                found[n, m] = float(kind == OFFSET and relation.signal in names)
                continue
            by = _SMALL_STEP.get(kind, _OFFSETS.get(SIGNALS[names[0]].unit, 0.1))
            moved = sides(relation, _Moved(view, step, kind, names, by))
            change = (moved[0] - measured) - (moved[1] - computed)
            found[n, m] = _share(kind, relation, computed, change, view) / by
    found[~(np.abs(found) < _MOST_SHOWN)] = 0.0
    return found


def _share(kind: str, relation: Relation, computed: Floats, change: Floats, view: View) -> float:
    """Return how a change of the difference of both sides shows in what is fitted."""
    spacing = view.spacing(relation.signal)
    arm = relation.arm(view) if relation.arm is not None else computed[:0]  # type: ignore[arg-type]
    columns = [computed, -np.gradient(computed, spacing)] + [arm] * (len(arm) == len(computed))
    columns += [] if relation.through_zero else [np.ones(len(computed))]
    table = np.stack([*columns, change], 1)
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 20:
        return 0.0
    fitted = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0]
    return float(fitted[{SCALE: 0, DELAY: 1, OFFSET: -1}[kind]])


@dataclass(frozen=True)
class _Option:
    """A cause that may be: the signals, how it shows, probability and spread beforehand, its clock."""

    signals: tuple[str, ...]
    column: Floats
    prior: float
    spread: float
    clock: int = -1


def _options(kind: str, channels: Sequence[tuple[str, ...]], table: Floats, clocks: Mapping[str, int]) -> list[_Option]:
    """Return the causes of one kind that would show."""
    found = []
    for m, names in enumerate(channels):
        trusted = names[0].startswith(_TRUSTED)
        prior = _RARE if trusted and kind == SCALE else _SELDOM if trusted else _LIKELY
        shown = np.abs(table[:, m]).max(initial=0) > 0.02
        if shown and kind != DRIFT and not (kind == SCALE and names[0].startswith(_UNSCALED)):
            spread = _SPREAD.get(kind, _OFFSETS.get(SIGNALS[names[0]].unit, 0.1))
            found.append(_Option(names, table[:, m], prior, spread))
    groups = sorted({clocks.get(n[0], 0) for n in channels})
    for clock in groups if len(groups) > 1 and kind in (DELAY, DRIFT) else []:
        inside = [m for m, names in enumerate(channels) if clocks.get(names[0], 0) == clock]
        names = tuple(n for m in inside for n in channels[m])
        trusted = any(n.startswith(_TRUSTED) for n in names)
        column = table[:, inside].sum(axis=1)
        if np.abs(column).max(initial=0) > 0.02:
            found.append(_Option(names, column, _SELDOM if trusted else _LIKELY, _SPREAD[kind], clock))
    return found


def _sparse(kind: str, observed: Floats, std: Floats, options: Sequence[_Option], needed: bool) -> list[Cause]:
    """Return the most probable set of causes; their posterior is that of all sets that hold them.

    Where some comparison does not agree (``needed``), at least one cause is looked for.
    """
    noise = np.diag(std**2 + 1e-12)
    scores: dict[tuple[int, ...], float] = {}
    for count in range(int(needed and bool(options)), min(_MOST, len(options)) + 1):
        for chosen in combinations(range(len(options)), count):
            covariance = noise.copy()
            prior = 0.0
            for m in chosen:
                covariance += options[m].spread ** 2 * np.outer(options[m].column, options[m].column)
                prior += np.log(options[m].prior / (1 - options[m].prior))
            _, logarithm = np.linalg.slogdet(covariance)
            scores[chosen] = prior - (logarithm + observed @ np.linalg.solve(covariance, observed)) / 2
    best = max(scores, key=lambda c: scores[c])
    if not best:
        return []
    top = scores[best]
    weights = {c: float(np.exp(s - top)) for c, s in scores.items()}
    design = np.stack([options[m].column for m in best], 1)
    precision = design.T @ np.linalg.solve(noise, design) + np.diag([options[m].spread ** -2.0 for m in best])
    covariance = np.linalg.inv(precision)
    mean = covariance @ design.T @ np.linalg.solve(noise, observed)
    return [
        Cause(
            kind,
            options[m].signals,
            float(np.expm1(value) if kind == SCALE else value),
            float(np.sqrt(covariance[k, k])),
            sum(w for c, w in weights.items() if m in c) / sum(weights.values()),
            options[m].clock,
        )
        for k, (m, value) in enumerate(zip(best, mean, strict=True))
    ]


def _matters(cause: Cause, fits: Sequence[Agreement]) -> bool:
    """Tell whether a cause is sure and large enough to be stated."""
    of = [f for f in fits if set(cause.signals) & set(f.relation.signals)]
    if cause.kind == SCALE:
        least = LEAST_SCALE[any(f.relation.through_zero and f.relation.signal in cause.signals for f in of)]
    elif cause.kind == OFFSET:
        varied = [
            float(np.nanstd(f.measured)) for f in of if f.relation.signal in cause.signals and not f.relation.circular
        ]
        own = [0.2 * tolerance(f.relation) for f in of if f.relation.signal in cause.signals]
        least = max([LEAST_OFFSET * min(varied, default=0.0), *own])
    else:
        least = LEAST_DELAY * (2 if cause.kind == DRIFT else 1)
    return abs(cause.value) > max(_NEARLY * least, _NEARLY * SURE * cause.std)
