"""Which scales, offsets, delays and drifting clocks explain what is left between the signals? As few as possible.

Every comparison says something of every channel in it (``responses``). What explains all of them is looked for among
sets of causes, of all kinds together, as a scale that is overlooked biases a delay: each cause has a probability
beforehand and a normal spread, so that the likelihood of a set is a normal one in closed form (spike and slab, George
and McCulloch 1993). The spread is one of several, as nobody knows beforehand whether a fault is small or large: with
one of them, large values of a channel that hardly shows would be likelier than a small one of another that shows well.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.cause import DELAY, DRIFT, OFFSET, SCALE, Cause, mended
from harness.recordings.consistency import LEAST_DELAY, LEAST_OFFSET, LEAST_SCALE, SURE, Smoothed, compare, tolerance
from harness.recordings.pair_fit import Agreement
from harness.recordings.responses import KINDS, Response, response, tells, usual_size

_MOST = 3
"""Causes that are looked for together."""
_ROUNDS = 4
"""Times at most that causes are looked for around those found before: a large one shows otherwise than a small one."""
_KEPT = 200
"""Sets of causes that are extended by one more."""
_SPREADS = (1 / 8, 1 / 2, 2.0)
"""Standard deviations of a cause beforehand, in its usual size; one is as probable as the other."""
_NEARLY = 0.75
"""Share of what a comparison must be off that a cause must be, which several comparisons make smaller and surer."""
_LIKELY, _SELDOM, _RARE = 0.03, 0.005, 0.0005
_OFTEN = 0.1
"""Probability that a clock is late against another or drifts: two devices seldom agree, channels of one mostly do."""
_LISTED = 0.05
"""Posterior from which another explanation is stated."""
_UNSCALED = ("position", "heading", "latitude", "longitude")
"""Signals that have no scale of their own: a geodetic system and a compass are right or in another unit."""
_UNSHIFTED = ("position", "latitude", "longitude", "speed", "longitudinal_velocity")
"""Signals that have no offset of their own: a speed is zero at rest, and a position is relative."""
_TRUSTED = ("position", "heading", "latitude", "longitude", "longitudinal_velocity", "lateral_velocity")
"""Signals of navigation units, which are less often wrong than those of the vehicle."""


def causes(
    fits: Sequence[Agreement],
    smoothed: Smoothed,
    twins: Mapping[str, tuple[str, ...]],
    clocks: Mapping[str, int],
    only: Collection[Cause] | None = None,
) -> list[Cause]:
    """Return what is off by a little and explains the comparisons.

    Args:
        fits: Comparisons of the signals, mended of the faults.
        smoothed: The signals that they compare.
        twins: All signals that are read from the channel of a signal.
        clocks: Number of the clock by signal.
        only: Causes beside which no other is looked for.
    """
    used = [f for f in fits if tells(f)]
    if not used:
        return []
    channels = list(dict.fromkeys(twins.get(n, (n,)) for f in used for n in f.relation.signals))
    several = len({clocks.get(names[0], 0) for names in channels}) > 1
    wanted = None if only is None else {(c.kind, c.signals) for c in only}
    options = [o for o in _options(channels, clocks) if wanted is None or (o.kind, o.signals) in wanted]
    found: list[Cause] = []
    for _ in range(_ROUNDS):
        around = mended(found, smoothed) if found else smoothed
        near = [compare(f.relation, around) for f in used] if found else used
        said = [r for f in near if tells(f) and (r := response(f, around, channels, several)) is not None]
        before, found = found, _Evidence([_moved(r, found, channels) for r in said], options).best() if said else []
        if not found or _alike(before, found):
            break
    return [c for c in found if _matters(c, used)]


def _moved(said: Response, found: Sequence[Cause], channels: Sequence[tuple[str, ...]]) -> Response:
    """Return what a comparison of mended signals says of those that were not."""
    value = said.value
    for cause in found:
        inside = [m for m, names in enumerate(channels) if set(names) & set(cause.signals)]
        size = np.log1p(cause.value) if cause.kind == SCALE else cause.value
        value = value + said.design[:, KINDS.index(cause.kind), inside].sum(axis=1) * size
    return replace(said, value=value)


def _alike(before: Sequence[Cause], found: Sequence[Cause]) -> bool:
    """Tell whether the causes are the same as before, within a third of their standard error."""
    old = {(c.kind, c.signals): c.value for c in before}
    new = {(c.kind, c.signals): c for c in found}
    return set(old) == set(new) and all(abs(new[key].value - old[key]) < new[key].std / 3 for key in new)


@dataclass(frozen=True)
class _Option:
    """A cause that may be: its kind, its channels by number, its signals, its probability beforehand, its clock."""

    kind: str
    channels: tuple[int, ...]
    signals: tuple[str, ...]
    prior: float
    clock: int = -1


def _options(channels: Sequence[tuple[str, ...]], clocks: Mapping[str, int]) -> Iterator[_Option]:
    """Yield the causes that may be."""
    trusted = [any(n.startswith(_TRUSTED) for n in names) for names in channels]
    for m, names in enumerate(channels):
        for kind in (SCALE, OFFSET, DELAY):
            if names[0].startswith({SCALE: _UNSCALED, OFFSET: _UNSHIFTED}.get(kind, ("-",))):
                continue
            prior = _RARE if trusted[m] and kind == SCALE else _SELDOM if trusted[m] else _LIKELY
            yield _Option(kind, (m,), names, prior)
    for inside in _devices(channels, clocks, trusted):
        names = tuple(n for m in inside for n in channels[m])
        yield from (_Option(kind, inside, names, _SELDOM) for kind in (SCALE, DELAY))
    clock_of = [clocks.get(names[0], 0) for names in channels]
    first = next((c for m, c in enumerate(clock_of) if trusted[m]), clock_of[0])
    for clock in sorted(set(clock_of) - {first}):  # what is late against the first, which may be early as well
        inside = tuple(m for m, c in enumerate(clock_of) if c == clock)
        names = tuple(n for m in inside for n in channels[m])
        yield from (_Option(kind, inside, names, _OFTEN, clock) for kind in (DELAY, DRIFT))


def _devices(
    channels: Sequence[tuple[str, ...]], clocks: Mapping[str, int], trusted: Sequence[bool]
) -> list[tuple[int, ...]]:
    """Return the channels in one unit and with one clock: they may be of one make, late or misread alike."""
    found: dict[tuple[str, int], list[int]] = {}
    for m, names in enumerate(channels):
        if not trusted[m]:
            found.setdefault((SIGNALS[names[0]].unit, clocks.get(names[0], 0)), []).append(m)
    return [tuple(inside) for inside in found.values() if len(inside) > 1]


class _Evidence:
    """What all comparisons say together of the causes that may be.

    Args:
        said: What each comparison says.
        options: The causes.
    """

    def __init__(self, said: Sequence[Response], options: Sequence[_Option]) -> None:
        precision = np.zeros((len(options), len(options)))
        pull = np.zeros(len(options))
        for each in said:
            shown = np.stack(
                [each.design[:, KINDS.index(o.kind)][:, list(o.channels)].sum(axis=1) for o in options], axis=1
            )
            solved = np.linalg.solve(each.covariance, np.column_stack([shown, each.value]))
            precision += shown.T @ solved[:, :-1]
            pull += shown.T @ solved[:, -1]
        sizes = np.array([usual_size(o.kind, o.signals[0]) for o in options])
        seen = [n for n in range(len(options)) if precision[n, n] * (_SPREADS[-1] * sizes[n]) ** 2 > 1]
        self._options = [options[n] for n in seen]
        self._precision, self._pull = precision[np.ix_(seen, seen)], pull[seen]
        self._of = np.repeat(np.arange(len(seen)), len(_SPREADS))
        self._spread = np.outer(sizes[seen], _SPREADS).ravel()
        priors = np.array([o.prior for o in self._options])
        self._prior = np.repeat(np.log(priors / (1 - priors) / len(_SPREADS)), len(_SPREADS))

    def _scores(self, sets: Floats) -> Floats:
        """Return the logarithm of likelihood times prior of sets of causes with their spreads, ``(sets, causes)``."""
        which, spread = self._of[sets], self._spread[sets]
        whole = (
            np.eye(sets.shape[1])
            + spread[:, :, None] * self._precision[which[:, :, None], which[:, None]] * spread[:, None]
        )
        pull = spread * self._pull[which]
        gain = (pull * np.linalg.solve(whole, pull[:, :, None])[:, :, 0]).sum(axis=1)
        return self._prior[sets].sum(axis=1) + (gain - np.linalg.slogdet(whole)[1]) / 2

    def _weighed(self) -> dict[tuple[int, ...], float]:
        """Return what sets of causes score, each cause with each spread; sets are extended by one cause at a time."""
        scores: dict[tuple[int, ...], float] = {(): 0.0}
        frontier: list[tuple[int, ...]] = [()]
        for _ in range(min(_MOST, len(self._options))):
            longer = {
                tuple(sorted((*s, n)))
                for s in frontier
                for n in range(len(self._of))
                if self._of[n] not in {self._of[k] for k in s}
            }
            sets = sorted(longer)
            found = dict(zip(sets, self._scores(np.array(sets)).tolist(), strict=True))
            scores |= found
            frontier = sorted(sets, key=lambda s: -found[s])[:_KEPT]
        return scores

    def best(self) -> list[Cause]:
        """Return the most probable set of causes, each with the probability of all sets that hold it."""
        scores = self._weighed()
        top = max(scores.values())
        weights: dict[tuple[int, ...], float] = {}
        spreads: dict[tuple[int, ...], tuple[int, ...]] = {}
        for chosen, score in scores.items():
            of = tuple(int(self._of[n]) for n in chosen)
            weights[of] = weights.get(of, 0.0) + float(np.exp(score - top))
            if of not in spreads or score > scores[spreads[of]]:
                spreads[of] = chosen
        total = sum(weights.values())
        best = max(weights, key=lambda of: weights[of])
        found = []
        for cause, m in zip(self._values(spreads[best]), best, strict=True):
            sure = sum(w for of, w in weights.items() if m in of) / total
            found.append(replace(cause, posterior=sure, rivals=self._rivals(m, best, weights, spreads)))
        return found

    def _rivals(
        self,
        m: int,
        best: tuple[int, ...],
        weights: Mapping[tuple[int, ...], float],
        spreads: Mapping[tuple[int, ...], tuple[int, ...]],
    ) -> tuple[tuple[Cause, ...], ...]:
        """Return what stands in the place of a cause of the best set in other sets that are probable."""
        found: dict[tuple[int, ...], float] = {}
        first: dict[tuple[int, ...], tuple[int, ...]] = {}
        for of, weight in sorted(weights.items(), key=lambda item: -item[1]):
            if m not in of:
                other = tuple(n for n in of if n not in best)
                found[other] = found.get(other, 0.0) + weight
                first.setdefault(other, of)
        least = _LISTED * sum(weights.values())
        ranked = sorted((other for other in found if found[other] > least), key=lambda other: -found[other])
        return tuple(
            tuple(c for c, n in zip(self._values(spreads[first[other]]), first[other], strict=True) if n in other)
            for other in ranked
        )

    def _values(self, chosen: tuple[int, ...]) -> list[Cause]:
        """Return the causes of a set with their values and standard errors."""
        which = self._of[list(chosen)]
        if not len(which):
            return []
        covariance = np.linalg.inv(self._precision[np.ix_(which, which)] + np.diag(self._spread[list(chosen)] ** -2.0))
        values, stds = covariance @ self._pull[which], np.sqrt(np.diag(covariance))
        found = []
        for m, value, std in zip(which, values, stds, strict=True):
            option = self._options[m]
            value = float(np.expm1(value) if option.kind == SCALE else value)
            found.append(Cause(option.kind, option.signals, value, float(std), np.nan, option.clock))
        return found


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
