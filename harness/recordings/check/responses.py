"""Linear response of a comparison to a scale, offset, delay or drift of every channel in it.

The two sides of a comparison differ by what each of their channels is off. Around the slope and the delay that fit
best, a small cause ``theta`` in a channel changes the difference by ``theta`` times a column of its own, so that the
difference is regressed on the columns of all channels together: ``y = X theta + noise``. Channels that act alike have
the same column, and the comparison then determines only their sum; the directions that are determined at all are those
of the singular vectors of ``X``. Their covariance counts that the noise is coloured (Newey and West 1987), that both
sides carry it (Frisch 1934), what the relation neglects, and what needs no fault.

The column of the measured signal is taken from the computed side, whose noise is another: otherwise the noise, which
is the difference of both sides, would itself be a column.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.models.signals import SIGNALS
from harness.recordings.check.causes import DELAY, DRIFT, OFFSET, SCALE
from harness.recordings.motion.consistency import LEAST_DELAY, LEAST_OFFSET, LEAST_SCALE, SmoothedSignals
from harness.recordings.motion.kinematics import Sources
from harness.recordings.motion.pair_fit import MEMORY, SPACING, Agreement, delayed, long_run, without

KINDS = (SCALE, OFFSET, DELAY, DRIFT)

_TOLERATED = 3.0
"""Share of the least deviation that is reported, as its standard deviation where nothing is wrong."""
_SMALL = 0.1
"""Share of that variance that any comparison has: what even an exact relation neglects."""
_CALIBRATION = np.log(2.5)
"""Logarithm of the largest factor that is a calibration; what is further off has another reason."""
_LOOSE = 2.0
"""Factor by which a slope may be off beyond which the relation has no scale of its own."""
_SMALL_STEP = {SCALE: 1e-3, DELAY: 1e-3, OFFSET: 1e-3}
_UNSEEN = 1e-3
"""Share of the strongest direction below which a direction is none."""
_ROUNDING = 1e-6
"""Share of the comparison below which what a usual cause changes of it is none: differences of rounded numbers."""
_ALIGNED = np.radians(1.5)
"""rad by which the course differs from the heading without any fault."""
_SPREAD = {SCALE: 0.2, DELAY: 0.1, DRIFT: 0.1}
_OFFSETS = {"rad/s": 0.01, "m/s^2": 0.5, "m/s": 0.2, "rad": 0.05, "rad/s^2": 0.1}


def usual_size(kind: str, signal: str) -> float:
    """Return the usual size of a cause: relative, in s, in s over the recording, or in SI units."""
    return _SPREAD[kind] if kind in _SPREAD else _OFFSETS.get(SIGNALS[signal].unit, 0.1)


@dataclass(frozen=True)
class Response:
    """Response of one comparison, in the directions that it determines.

    Attributes:
        value: ``(directions,)``.
        design: How a cause of unit size shows, ``(directions, kinds, channels)``, kinds in the order of ``KINDS``.
        noise: Covariance of ``value`` by what the signals and the relation leave open, ``(directions, directions)``.
        covariance: That with what every channel may be off without a fault.
    """

    value: Floats
    design: Floats
    noise: Floats
    covariance: Floats


def tells(fit: Agreement) -> bool:
    """Return whether a comparison is informative: it has a scale of its own, and the two are correlated."""
    if fit.relation.circular:
        return bool(np.isfinite(fit.offset))
    return fit.scaled and fit.relation.slope[1] <= _LOOSE


def response(
    fit: Agreement, smoothed: SmoothedSignals, channels: Sequence[tuple[str, ...]], drifts: bool
) -> Response | None:
    """Return the response of an informative comparison to scale, offset, delay and drift of every channel.

    Args:
        fit: The comparison.
        smoothed: The signals that it compares.
        channels: The signals of every channel.
        drifts: Whether channels may drift against each other, as there are several clocks.

    Returns:
        None if too few samples of both sides are known.
    """
    if fit.relation.circular:
        design = np.zeros((1, len(KINDS), len(channels)))
        design[0, KINDS.index(OFFSET)] = [fit.relation.signal in names for names in channels]
        covariance = np.array([[fit.offset_std**2 + _ALIGNED**2]])
        return Response(np.array([fit.offset]), design, covariance, covariance)
    sides = _Sides(fit, smoothed.sources(fit.relation, fit.window), channels, drifts)
    return sides.response() if sides.enough else None


class _Moved:
    """The signals with those of one channel changed a little: what relations take."""

    def __init__(self, sources: Sources, kind: str, names: Collection[str], by: float) -> None:
        self.signals, self._sources, self._kind, self._names, self._by = sources.signals, sources, kind, names, by

    def __getitem__(self, name: str) -> Floats:
        return self.rate(name, 0)

    def rate(self, name: str, derivative: int = 1) -> Floats:
        """Return a signal smoothed, or a derivative of it."""
        values = self._sources.rate(name, derivative)
        if name not in self._names:
            return values
        if self._kind == SCALE:
            return values * (1 + self._by)
        if self._kind == OFFSET:
            return values + self._by if derivative == 0 else values
        return values - self._by * np.gradient(values, self._sources.step)  # late, as smoothed as it is


class _Sides:
    """Both sides of a comparison, aligned, and how every channel shows in their difference."""

    def __init__(self, fit: Agreement, sources: Sources, channels: Sequence[tuple[str, ...]], drifts: bool) -> None:
        self.fit, self.channels, self.drifts = fit, channels, drifts
        relation, self._step = fit.relation, sources.step
        self._every = max(int(SPACING / self._step), 1)
        self._take = np.arange(0, len(fit.measured), self._every)
        self._delayed = bool(np.isfinite(fit.delay) and np.isfinite(relation.lag))
        self._late = fit.delay if np.isfinite(fit.delay) else 0.0
        measured, computed = sources.rate(relation.signal, relation.order), relation.compute(sources)
        self.base = fit.slope * self._aligned(computed)
        self.rate = fit.slope * self._aligned(np.gradient(computed, self._step))
        self.ones: Floats = np.ones(len(self._take))
        arm = relation.arm(sources) if relation.arm is not None else self.ones[:0]
        self.arm = [arm[self._take]] if len(arm) == len(measured) else []
        columns = self._columns(sources, computed)
        rows = np.isfinite(np.stack([measured[self._take], self.base, self.rate, *self.arm, *columns.T])).all(axis=0)
        self.measured, self.columns = measured[self._take][rows], columns[rows]
        self.base, self.rate, self.ones = self.base[rows], self.rate[rows], self.ones[rows]
        self.arm = [a[rows] for a in self.arm]
        place = self._take[rows]
        centred = (place - place.mean()) / max(np.ptp(place), 1) if len(place) else self.ones
        if drifts and relation.exact:
            self._columns_of(DRIFT)[:] = self._columns_of(DELAY) * centred[:, None]

    @property
    def enough(self) -> bool:
        """Whether there are enough rows for the columns."""
        return len(self.measured) >= 10 * (len(self.channels) + 4)

    def _columns_of(self, kind: str) -> Floats:
        """Return the columns of one kind, to be written to."""
        n = KINDS.index(kind)
        return self.columns[:, n * len(self.channels) : (n + 1) * len(self.channels)]

    def _aligned(self, values: Floats) -> Floats:
        return delayed(values, self._late, self._step, self._take)

    def _columns(self, sources: Sources, computed: Floats) -> Floats:
        """Return how the difference of both sides changes with each cause but drift, ``(rows, kinds * channels)``."""
        relation = self.fit.relation
        kinds = [SCALE, *([DELAY] if self._delayed else ())]
        kinds += [OFFSET] if relation.exact and not relation.through_zero else []
        columns = np.zeros((len(self._take), len(KINDS), len(self.channels)))
        # only what both sides have in common of their rates tells a delay: the noise of one of them does not
        share = self.fit.signal_share
        own = {SCALE: self.base, DELAY: -share * self.rate, OFFSET: self.ones * (relation.order == 0)}
        for kind in kinds:
            for m, names in enumerate(self.channels):
                column = columns[:, KINDS.index(kind), m]
                if relation.signal in names:
                    column += own[kind]
                if set(names) & set(relation.needs):
                    by = _SMALL_STEP[kind]
                    changed = relation.compute(_Moved(sources, kind, names, by)) - computed  # type: ignore[arg-type]
                    column -= (share if kind == DELAY else 1.0) * self.fit.slope * self._aligned(changed / by)
        return columns.reshape(len(self._take), -1)

    def response(self) -> Response:
        """Return the response of the difference of both sides."""
        fit, relation = self.fit, self.fit.relation
        centre, factor = relation.slope
        free = [] if relation.through_zero else [self.ones]
        residual = without(np.stack([self.base, self.rate, *free, *self.arm], 1), self.measured)
        off = float(np.log(fit.slope / centre))
        nuisance, y = [*self.arm], residual + off * self.base
        if self._delayed:
            y = y - fit.delay * fit.signal_share * self.rate
        else:
            nuisance.append(self.rate)
        if relation.exact and free:
            y = y + fit.offset * self.ones
        else:
            nuisance += free
        if abs(off) > _CALIBRATION:
            nuisance.append(self.base)
        others = np.stack(nuisance, 1) if nuisance else np.empty((len(y), 0))
        sizes = np.array([usual_size(kind, names[0]) for kind in KINDS for names in self.channels])
        columns, y, whole = (without(others, v) for v in (self.columns, y, self.base))
        shown = columns.any(axis=0)  # a relation takes few of the channels
        across, strength, _ = np.linalg.svd((columns * sizes)[:, shown], full_matrices=False)
        across = across[:, strength > max(_UNSEEN * strength[0], _ROUNDING * float(np.linalg.norm(self.base)))]
        value, design = across.T @ y, across.T @ columns
        noise = y - across @ value
        # what one channel explains has to stand out of all that is left, some of which the relation neglects
        lags = int(max(MEMORY, fit.window) / (self._every * self._step))
        covariance = long_run(across * without(others, residual)[:, None], lags)
        covariance += self._of_both_sides(design, float(noise @ noise))
        covariance += _along(across.T @ whole, float(np.hypot(np.log(factor), fit.unresolved)))
        if self._delayed:
            covariance += _along(across.T @ without(others, fit.signal_share * self.rate), relation.lag)
        tolerated = self._tolerated(design)
        if relation.exact and free:
            least = LEAST_OFFSET * float(np.nanstd(fit.measured))
            tolerated += _along(across.T @ without(others, self.ones), least / _TOLERATED)
        shaped = design.reshape(len(value), len(KINDS), len(self.channels))
        return Response(value, shaped, covariance + _SMALL * tolerated, covariance + tolerated)

    def _of_both_sides(self, design: Floats, noise: float) -> Floats:
        """Return the covariance of the scales by noise whose share on either side is unknown, from none to all."""
        covariance = np.zeros((len(design), len(design)))
        back: Floats = np.linalg.pinv(design.T).astype(float)
        for m in np.flatnonzero(design[:, : len(self.channels)].any(axis=0)):
            covariance += _along(back[:, m], noise / np.sqrt(12))
        return covariance

    def _tolerated(self, design: Floats) -> Floats:
        """Return the covariance of deviations without a fault: of two channels a third of the least reported."""
        covariance = np.zeros((len(design), len(design)))
        least = {SCALE: LEAST_SCALE[self.fit.relation.through_zero], DELAY: LEAST_DELAY, DRIFT: LEAST_DELAY}
        for kind, size in least.items():
            n = KINDS.index(kind)
            for column in design[:, n * len(self.channels) : (n + 1) * len(self.channels)].T:
                covariance += _along(column, size / _TOLERATED / np.sqrt(2))
        return covariance


def _along(direction: Floats, size: float) -> Floats:
    """Return the covariance of a disturbance of a size along a direction."""
    return size**2 * np.outer(direction, direction)
