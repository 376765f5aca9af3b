"""Sparse estimate of scales, offsets, delays and clock drifts from all comparisons of a recording together.

Every comparison responds to every channel in it (``responses``). The search is over sets of causes of all kinds
together, as a scale that is overlooked biases a delay. Each cause has a prior probability and a normal prior of its
size, so that the likelihood of a set is normal in closed form (spike and slab, George and McCulloch 1993). The standard
deviation of that prior is one of several, since a fault may be small or large: with a single one, large values of a
channel that hardly shows would be likelier than a small value of another that shows well.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.check.causes import DELAY, DRIFT, OFFSET, SCALE, Cause, corrected
from harness.recordings.check.responses import KINDS, Response, response, tells, usual_size
from harness.recordings.motion.consistency import (
    LEAST_DELAY,
    LEAST_OFFSET,
    LEAST_SCALE,
    SURE,
    SmoothedSignals,
    compare,
    tolerance,
)
from harness.recordings.motion.pair_fit import Agreement

_MOST = 3
"""Most causes in a set."""
_ROUNDS = 4
"""Most iterations about the last estimate: the response to a large cause is not that to a small one."""
_KEPT = 200
"""Sets of causes that are extended by one more."""
_SPREADS = (1 / 8, 1 / 2, 2.0)
"""Prior standard deviations of a cause, in its usual size; all are equally probable."""
_ANY = 10.0
"""Usual sizes that a value may have once its cause is decided."""
_NEARLY = 0.75
"""Share of what a comparison must be off that a cause must be, which several comparisons make smaller and surer."""
_LIKELY, _SELDOM, _RARE = 0.03, 0.005, 0.0005
_DEVICE = 0.02
"""Probability that all channels of a device are late."""
_EARLY = 0.01
"""How much less probable it is that a reading comes before the event than after it."""
_LOOK_AHEAD = 0.02
"""s by which a filter without phase, or a stamp at the end of its window, may make a reading early."""
_OFTEN = 0.1
"""Probability that a clock is late against another or drifts: two devices seldom agree, channels of one mostly do."""
_LISTED = 0.05
"""Posterior from which another explanation is stated."""
_UNSCALED = ("position", "heading", "latitude", "longitude")
"""Signals that have no scale of their own: a geodetic system and a compass are right or in another unit."""
_UNSHIFTED = ("position", "latitude", "longitude", "speed", "longitudinal_velocity")
"""Signals that have no offset of their own: a speed is zero at rest, and a position is relative."""
_PLACE = ("position_x", "position_y")
_INERTIAL = ("yaw_rate", "roll_rate", "lateral_acceleration", "longitudinal_acceleration")
_TRUSTED = ("position", "heading", "latitude", "longitude", "longitudinal_velocity", "lateral_velocity")
"""Signals of navigation units, which are less often wrong than those of the vehicle."""


def causes(
    fits: Sequence[Agreement],
    smoothed: SmoothedSignals,
    twins: Mapping[str, tuple[str, ...]],
    only: Collection[Cause] | None = None,
) -> list[Cause]:
    """Return the small deviations that explain the comparisons.

    Args:
        fits: Comparisons of the signals, mended of the faults.
        smoothed: The signals that they compare.
        twins: All signals that are read from the channel of a signal.
        only: The only candidates; all by default.
    """
    used = [f for f in fits if tells(f)]
    if not used:
        return []
    together = {**twins, **dict.fromkeys(_PLACE, _PLACE)}  # the axes of one receiver
    channels = list(dict.fromkeys(together.get(n, (n,)) for f in used for n in f.relation.signals))
    several = len({smoothed.origin(names[0]).clock for names in channels}) > 1
    wanted = None if only is None else {(c.kind, c.signals) for c in only}
    options = [o for o in _options(channels, smoothed) if wanted is None or (o.kind, o.signals) in wanted]
    estimated: list[Cause] = []
    for _ in range(_ROUNDS):
        around = corrected(estimated, smoothed) if estimated else smoothed
        refitted = [compare(f.relation, around) for f in used] if estimated else used
        responses = [r for f in refitted if tells(f) and (r := response(f, around, channels, several)) is not None]
        moved = [_moved(r, estimated, channels) for r in responses]
        before, estimated = estimated, _CauseEvidence(moved, options).best() if moved else []
        if not estimated or _alike(before, estimated):
            break
    return [c for c in estimated if _matters(c, used)]


def _moved(residual: Response, taken_out: Sequence[Cause], channels: Sequence[tuple[str, ...]]) -> Response:
    """Return the response of the signals as recorded from that of the corrected ones.

    Args:
        residual: Response of a comparison of corrected signals.
        taken_out: Causes for which they were corrected.
        channels: The signals of every channel.
    """
    value = residual.value
    for cause in taken_out:
        inside = [m for m, names in enumerate(channels) if set(names) & set(cause.signals)]
        size = np.log1p(cause.value) if cause.kind == SCALE else cause.value
        value = value + residual.design[:, KINDS.index(cause.kind), inside].sum(axis=1) * size
    return replace(residual, value=value)


def _alike(before: Sequence[Cause], after: Sequence[Cause]) -> bool:
    """Return whether the causes are the same as before, within a third of their standard deviations."""
    old = {(c.kind, c.signals): c.value for c in before}
    new = {(c.kind, c.signals): c for c in after}
    return set(old) == set(new) and all(abs(new[key].value - old[key]) < new[key].doubt / 3 for key in new)


@dataclass(frozen=True)
class _Option:
    """A candidate cause.

    Attributes:
        kind: ``SCALE``, ``OFFSET``, ``DELAY`` or ``DRIFT``.
        channels: Numbers of its channels.
        signals: Their signals.
        prior: Prior probability.
        size: Usual size.
        sign: 1 or -1 where it cannot be of the other sign; 0 otherwise.
        clock: Which clock it is; -1 for channels.
    """

    kind: str
    channels: tuple[int, ...]
    signals: tuple[str, ...]
    prior: float
    size: float
    sign: int = 0
    clock: int = -1


def _options(channels: Sequence[tuple[str, ...]], smoothed: SmoothedSignals) -> Iterator[_Option]:
    """Yield the candidate causes."""
    trusted = [any(n.startswith(_TRUSTED) for n in names) for names in channels]
    origins = [smoothed.origin(names[0]) for names in channels]
    clock_of = [o.clock for o in origins]

    def signals(inside: Sequence[int]) -> tuple[str, ...]:
        return tuple(n for m in inside for n in channels[m])

    for m, names in enumerate(channels):
        for kind in (SCALE, OFFSET):
            if not names[0].startswith({SCALE: _UNSCALED, OFFSET: _UNSHIFTED}[kind]):
                prior = _RARE if trusted[m] and kind == SCALE else _SELDOM if trusted[m] else _LIKELY
                yield _Option(kind, (m,), names, prior, usual_size(kind, names[0]))
        alone = len(set(clock_of)) > 1 and clock_of.count(clock_of[m]) == 1  # then it is the clock that is late
        if not alone:
            prior = _SELDOM if trusted[m] and names != _PLACE else _LIKELY
            yield from _delays((m,), names, prior, origins[m].delay)
    for inside in _misread_together(channels, clock_of, trusted):
        yield _Option(SCALE, inside, signals(inside), _SELDOM, usual_size(SCALE, channels[inside[0]][0]))
    for inside, names in _devices(channels, smoothed):
        yield from _delays(inside, names, _DEVICE, min(origins[m].delay for m in inside))
    first = next((c for m, c in enumerate(clock_of) if trusted[m]), clock_of[0])
    for clock in sorted(set(clock_of)) if len(set(clock_of)) > 1 else ():
        inside = tuple(m for m, c in enumerate(clock_of) if c == clock)
        others = (n for n in smoothed.origins if n in smoothed.signals and smoothed.origin(n).clock == clock)
        names = tuple(dict.fromkeys((*signals(inside), *others)))
        yield from _delays(inside, names, _OFTEN, 0.0, clock)
        if clock != first:  # clocks drift against each other only
            yield _Option(DRIFT, inside, names, _OFTEN, usual_size(DRIFT, ""), 0, clock)


def _delays(
    channels: tuple[int, ...], signals: tuple[str, ...], prior: float, stated: float, clock: int = -1
) -> Iterator[_Option]:
    """Yield that channels are late, and that they are early: by a little, or by what the map takes out too much."""
    yield _Option(DELAY, channels, signals, prior, usual_size(DELAY, signals[0]), 1, clock)
    early = 1.0 if stated > 0 else _EARLY
    yield _Option(DELAY, channels, signals, prior * early, max(_LOOK_AHEAD, stated), -1, clock)


def _misread_together(
    channels: Sequence[tuple[str, ...]], clock_of: Sequence[int], trusted: Sequence[bool]
) -> list[tuple[int, ...]]:
    """Return the channels in one unit and with one clock: they may be of one make, misread alike."""
    alike: dict[tuple[str, int], list[int]] = {}
    for m, names in enumerate(channels):
        if not trusted[m]:
            alike.setdefault((SIGNALS[names[0]].unit, clock_of[m]), []).append(m)
    return [tuple(inside) for inside in alike.values() if len(inside) > 1]


def _devices(
    channels: Sequence[tuple[str, ...]], smoothed: SmoothedSignals
) -> Iterator[tuple[tuple[int, ...], tuple[str, ...]]]:
    """Yield the signals that may be of one device, late together: by kind, by name, and by rate.

    Those that nothing is compared with are late with the others, so that two devices may show alike.
    """
    recorded = [n for n in smoothed.signals if n in smoothed.origins or n in _PLACE]
    recorded = list(dict.fromkeys([*(n for names in channels for n in names), *recorded]))
    groups = [
        [n for n in recorded if n.startswith((*_PLACE, "heading"))],
        [n for n in recorded if n.startswith(_TRUSTED)],
        [n for n in recorded if not n.startswith(_TRUSTED)],
        [n for n in recorded if n.startswith(_INERTIAL)],
    ]
    for key in (lambda o: _group_of(o.channel), lambda o: f"{o.rate:.3g}"):
        keys = {n: key(smoothed.origin(n)) for n in recorded}
        groups += [[n for n in recorded if keys[n] == each] for each in dict.fromkeys(keys.values()) if each]
    clocks = dict.fromkeys(smoothed.origin(n).clock for n in recorded)
    seen = {frozenset(n for n in recorded if smoothed.origin(n).clock == clock) for clock in clocks}  # options already
    for group in groups:
        for clock in dict.fromkeys(smoothed.origin(n).clock for n in group):
            here = [n for n in group if smoothed.origin(n).clock == clock]
            tied = tuple(m for m, names in enumerate(channels) if set(names) <= set(here))
            single = {frozenset(channels[m]) for m in tied if len(tied) == 1}
            if tied and len(tied) < len(channels) and frozenset(here) not in seen | single:
                seen.add(frozenset(here))
                yield tied, tuple(here)


def _group_of(channel: str) -> str:
    """Return the device of a column by its name: the message or structure, or the first word."""
    for separator in "./:":
        if separator in channel:
            return channel.rpartition(separator)[0]
    return re.split(r"[_ ]", channel)[0] if re.search(r"[_ ]", channel) else ""


class _CauseEvidence:
    """Evidence of all comparisons together for the candidate causes.

    Args:
        responses: One per comparison.
        options: The candidates.
    """

    def __init__(self, responses: Sequence[Response], options: Sequence[_Option]) -> None:
        precision = np.zeros((len(options), len(options)))
        pulls = []
        pull = np.zeros(len(options))
        for each in responses:
            shown = np.stack(
                [each.design[:, KINDS.index(o.kind)][:, list(o.channels)].sum(axis=1) for o in options], axis=1
            )
            solved = np.linalg.solve(each.covariance, np.column_stack([shown, each.value]))
            precision += shown.T @ solved[:, :-1]
            pulls.append((solved[:, :-1], each.noise))
            pull += shown.T @ solved[:, -1]
        sizes = np.array([o.size for o in options])
        seen = [n for n in range(len(options)) if precision[n, n] * (_SPREADS[-1] * sizes[n]) ** 2 > 1]
        self._options = [options[n] for n in seen]
        self._precision, self._pull = precision[np.ix_(seen, seen)], pull[seen]
        self._pulls = [(solved[:, seen], noise) for solved, noise in pulls]
        self._sizes = sizes[seen]
        self._option_of = np.repeat(np.arange(len(seen)), len(_SPREADS))
        self._spread = np.outer(sizes[seen], _SPREADS).ravel()
        self._sign = np.array([o.sign for o in self._options])
        priors = np.array([o.prior for o in self._options])
        self._prior = np.repeat(np.log(priors / (1 - priors) / len(_SPREADS)), len(_SPREADS))

    def _scores(self, sets: Floats) -> Floats:
        """Return the logarithm of likelihood times prior of sets of causes with their spreads, ``(sets, causes)``."""
        which, spread = self._option_of[sets], self._spread[sets]
        whole = (
            np.eye(sets.shape[1])
            + spread[:, :, None] * self._precision[which[:, :, None], which[:, None]] * spread[:, None]
        )
        pull = spread * self._pull[which]
        covariance = np.linalg.inv(whole)
        mean = (covariance @ pull[:, :, None])[:, :, 0]
        # a normal spread cut at zero holds what of it is on the right side, of which half was there beforehand
        away = self._sign[which] * mean / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        cut = np.where(self._sign[which] != 0, np.log(2.0) + scipy.special.log_ndtr(away), 0.0)
        fits = ((pull * mean).sum(axis=1) - np.linalg.slogdet(whole)[1]) / 2
        return self._prior[sets].sum(axis=1) + fits + cut.sum(axis=1)

    def _weighed(self) -> dict[tuple[int, ...], float]:
        """Return the scores of sets of causes, each cause with each spread; sets grow by one cause at a time."""
        scores: dict[tuple[int, ...], float] = {(): 0.0}
        frontier: list[tuple[int, ...]] = [()]
        option_of = self._option_of.tolist()
        for _ in range(min(_MOST, len(self._options))):
            longer = {
                tuple(sorted((*s, n)))
                for s in frontier
                for taken in [{option_of[k] for k in s}]
                for n, option in enumerate(option_of)
                if option not in taken
            }
            sets = sorted(longer)
            added = dict(zip(sets, self._scores(np.array(sets)).tolist(), strict=True))
            scores |= added
            frontier = sorted(sets, key=lambda s: -added[s])[:_KEPT]
        return scores

    def best(self) -> list[Cause]:
        """Return the most probable set of causes, each with the probability of all sets that hold it."""
        scores = self._weighed()
        top = max(scores.values())
        weights: dict[tuple[int, ...], float] = {}
        spreads: dict[tuple[int, ...], tuple[int, ...]] = {}
        option_of = self._option_of.tolist()
        for chosen, score in scores.items():
            subset = tuple(option_of[n] for n in chosen)
            weights[subset] = weights.get(subset, 0.0) + float(np.exp(score - top))
            if subset not in spreads or score > scores[spreads[subset]]:
                spreads[subset] = chosen
        total = sum(weights.values())
        best = max(weights, key=lambda subset: weights[subset])
        result = []
        for cause, m in zip(self._values(spreads[best]), best, strict=True):
            sure = sum(w for subset, w in weights.items() if m in subset) / total
            result.append(replace(cause, posterior=sure, rivals=self._rivals(m, best, weights, spreads)))
        return result

    def _rivals(
        self,
        m: int,
        best: tuple[int, ...],
        weights: Mapping[tuple[int, ...], float],
        spreads: Mapping[tuple[int, ...], tuple[int, ...]],
    ) -> tuple[tuple[Cause, ...], ...]:
        """Return the causes that replace one of the best set in other probable sets."""
        weight_of: dict[tuple[int, ...], float] = {}
        first: dict[tuple[int, ...], tuple[int, ...]] = {}
        for subset, weight in sorted(weights.items(), key=lambda item: -item[1]):
            if m not in subset:
                other = tuple(n for n in subset if n not in best)
                weight_of[other] = weight_of.get(other, 0.0) + weight
                first.setdefault(other, subset)
        least = _LISTED * sum(weights.values())
        ranked = sorted((other for other in weight_of if weight_of[other] > least), key=lambda other: -weight_of[other])
        return tuple(
            tuple(c for c, n in zip(self._values(spreads[first[other]]), first[other], strict=True) if n in other)
            for other in ranked
        )

    def _values(self, chosen: tuple[int, ...]) -> list[Cause]:
        """Return the causes of a set with their values and standard errors."""
        which = self._option_of[list(chosen)]
        if not len(which):
            return []
        precision = self._precision[np.ix_(which, which)]
        doubts = np.sqrt(np.diag(np.linalg.inv(precision + np.diag(self._spread[list(chosen)] ** -2.0))))
        covariance = np.linalg.inv(precision + np.diag((_ANY * self._sizes[which]) ** -2.0))  # nothing is drawn to zero
        values = covariance @ self._pull[which]
        # comparisons share signals, and with them noise: their errors add up as if they were one
        stds = sum(
            np.sqrt(np.diag(covariance @ solved[:, which].T @ noise @ solved[:, which] @ covariance))
            for solved, noise in self._pulls
        )
        result = []
        for m, value, std, doubt in zip(which, values, stds, doubts, strict=True):
            option = self._options[m]
            value = float(np.expm1(value) if option.kind == SCALE else value)
            result.append(Cause(option.kind, option.signals, value, float(std), float(doubt), np.nan, option.clock))
        return result


def _matters(cause: Cause, fits: Sequence[Agreement]) -> bool:
    """Return whether a cause is sure and large enough to be stated."""
    concerned = [f for f in fits if set(cause.signals) & set(f.relation.signals)]
    if cause.kind == SCALE:
        least = LEAST_SCALE[any(f.relation.through_zero and f.relation.signal in cause.signals for f in concerned)]
    elif cause.kind == OFFSET:
        measured = [f for f in concerned if f.relation.signal in cause.signals]
        varied = [float(np.nanstd(f.measured)) for f in measured if not f.relation.circular]
        own = [0.2 * tolerance(f.relation) for f in measured]
        least = max([LEAST_OFFSET * min(varied, default=0.0), *own])
    else:
        least = LEAST_DELAY * (2 if cause.kind == DRIFT else 1)
    return abs(cause.value) > max(_NEARLY * least, _NEARLY * SURE * max(cause.doubt, cause.std))
