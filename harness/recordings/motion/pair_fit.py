"""Slope, offset, lever arm, delay and drift between a measured signal and a computed one, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.recordings.motion.redundancy import Relation

LONGEST_DELAY = 0.5
"""s; a delay near it is none: the signals are not alike at any."""
MEMORY = 1.0
"""s over which the residual is taken to be correlated."""
SPACING = 0.04
"""s between the samples of a smoothed signal that are used."""
RELATED = 0.5
"""Least share of the variance that must be explained for slope and delay to be meaningful."""
_SLOW = 0.3
"""s; standard deviation of the Gaussian low-pass of which half the power passes at 0.44 Hz: slip angles follow."""
_INFORMED = 4.0
"""Standard deviations by which the rates of both sides must be correlated more than two noises are by chance."""
_DETERMINED = 2.0
"""Standard errors that a slope must have to be one."""
_APART = 0.01
"""Share of what a delay does to a signal that no lever arm does, from which the two can be told apart."""
_THIRDS = 3
"""Parts of a recording in each of which a drift must show."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of one signal with the one computed from others.

    Attributes:
        relation: Which two were compared.
        verdict: ``AGREES``, ``DISAGREES`` or ``NOT_JUDGED``.
        reasons: What is off, or why it could not be judged; empty if they agree.
        samples: Samples on which both are known.
        slope, offset, arm, delay, drift: Values; offset and signal in SI units, arm in m, delay in s (positive: the
            signal is late), drift in s over the recording. NaN where nothing could be fitted, or the relation has none.
        slope_std, offset_std, arm_std, delay_std, drift_std: Standard errors.
        explained: Share of the variance explained, R squared.
        measured, computed: Both sides, smoothed, shape ``(samples of the recording,)``; computed with slope 1.
        step: s between samples.
        window: s over which both sides are smoothed where the delay is known best; NaN where nothing could be fitted.
        signal_share: Share of signal, not noise, in the square of the computed side's rate; NaN where no delay is
            determined.
        unresolved: How far off the slope may be because the measured signal changes between its samples.
        calm: What would tell the delay, where too little happens to tell it; empty otherwise.
        off: What is off, of ``sign``, ``scale``, ``offset``, ``delay``, ``drift``, ``relation`` and ``still``.
    """

    relation: Relation
    verdict: str
    reasons: tuple[str, ...]
    samples: int
    measured: Floats
    computed: Floats
    step: float
    slope: float = np.nan
    offset: float = np.nan
    arm: float = np.nan
    delay: float = np.nan
    drift: float = np.nan
    slope_std: float = np.nan
    offset_std: float = np.nan
    arm_std: float = np.nan
    delay_std: float = np.nan
    drift_std: float = np.nan
    explained: float = np.nan
    window: float = np.nan
    signal_share: float = np.nan
    unresolved: float = 0.0
    calm: str = ""
    off: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        """Which two were compared, in words."""
        formula = self.relation.formula
        joint = " " if formula.startswith(("in ", "its ")) else " against "
        return f"{self.relation.signal}{joint}{formula}"

    @property
    def evidence(self) -> str:
        """Slope and share explained, or why there are none."""
        if not np.isfinite(self.slope):
            return ", ".join(self.reasons)
        return f"slope {self.slope:.4g} ± {self.slope_std:.2g}, R² {self.explained:.3f}"

    @property
    def scaled(self) -> bool:
        """Whether the fit determines scale, delay and offset."""
        return self.determined and self.slope > 0 and self.explained >= RELATED

    @property
    def determined(self) -> bool:
        """Whether the slope differs from zero."""
        return bool(abs(self.slope) > _DETERMINED * self.slope_std)


def fit_pair(fit: Agreement, arm: Floats | None, window: float) -> Agreement | None:
    """Estimate slope, offset, arm, delay and drift of one smoothed pair; None if too little of both sides is known.

    The delay starts from the peak of the cross-correlation and is refined together with the other parameters.
    Where a lever arm acts like a delay, as at a steady speed, there is none.
    """
    step, measured = fit.step, fit.measured
    every = max(int(SPACING / step), 1)
    take = np.arange(0, len(measured), every)
    delay = correlation_peak(measured, fit.computed, step)
    aligned = abs(delay) < 0.9 * LONGEST_DELAY
    delay = delay if aligned else 0.0
    rate, computed_rate = np.gradient(measured, step)[take], np.gradient(fit.computed, step)
    columns = [np.ones(len(take))] * (not fit.relation.through_zero) + ([] if arm is None else [arm[take]])
    kept = np.ones(len(take), dtype=bool)
    for _ in range(8):
        late, late_rate = (delayed(v, delay, step, take) for v in (fit.computed, computed_rate))
        table = np.stack([late, *columns, late_rate, rate, measured[take]], 1)
        rows = np.isfinite(table).all(axis=1) & kept
        if rows.sum() < 10 * (len(columns) + 1):
            return None
        complete = table[rows]
        pair = _Pair(complete[:, :-3], complete[:, -3], complete[:, -2], complete[:, -1], take[rows])
        residual = np.abs(pair.residual)
        usual = np.median(residual)
        away = residual > 8 * 1.4826 * usual
        if usual > 0 and 0 < away.sum() < 0.03 * rows.sum():  # single samples that jump
            kept[np.flatnonzero(rows)[away]] = False
            continue
        if not aligned or pair.curvature <= 0:
            break
        change = float(np.clip(pair.later, -0.1, 0.1))
        delay = float(np.clip(delay + change, -LONGEST_DELAY, LONGEST_DELAY))
        if abs(change) < 1e-5:
            break
    lags = int(max(MEMORY, window) / (every * step))
    aligned &= pair.determines_delay(lags) and abs(delay) < 0.9 * LONGEST_DELAY
    fitted = replace(_estimates(fit, pair, lags, arm is not None), window=window)
    if arm is not None:
        table = np.stack([fit.computed[take], *columns, computed_rate[take], rate, measured[take]], 1)
        rows &= np.isfinite(table).all(axis=1)
        complete = table[rows]
        at_once = _Pair(complete[:, :-3], complete[:, -3], complete[:, -2], complete[:, -1], take[rows])
        if at_once.apart(lags) < _APART:
            fitted = replace(_estimates(fit, at_once, lags, with_arm=True), window=window)
            return replace(fitted, calm="too steady in speed to tell a delay from the lever arm")
    if not aligned:
        return fitted
    drift, drift_std = pair.drift(lags)
    share = pair.curvature / (abs(fitted.slope) * float(pair.rate @ pair.rate))
    return replace(
        fitted, delay=delay, delay_std=pair.delay_std(lags), drift=drift, drift_std=drift_std,
        signal_share=float(np.clip(share, 0.0, 1.0)),
    )  # fmt: skip


class _Pair:
    """Both sides at the rows that count, and least squares of one on the other.

    Args:
        base: The computed side as late as it is, then offset and lever arm, ``(rows, columns)``.
        computed_rate, measured_rate: Derivatives of both sides.
        target: The measured side.
        rows: Samples of the recording.
    """

    def __init__(
        self, base: Floats, computed_rate: Floats, measured_rate: Floats, target: Floats, rows: Floats
    ) -> None:
        self.base, self.target = base, target
        self._rates, self._rows = (computed_rate, measured_rate), rows
        both = np.column_stack([target, computed_rate])
        values = np.linalg.lstsq(base, both, rcond=None)[0]
        self.residual, self.rate = np.ascontiguousarray((both - base @ values).T)
        self.values = values[:, 0]
        self.measured_rate = without(base[:, 1:], measured_rate)
        self.curvature = float(self.rate @ measured_rate)
        self._place = (rows - rows[0]) / max(np.ptp(rows), 1)

    @property
    def later(self) -> float:
        """How much later than assumed the measured side is, in s.

        The rates of both sides have no noise in common, so their product knows how sharp the peak of the correlation
        is; the square of one of them would hold its noise, and the delay would come out too small and too sure.
        """
        return -float(self.rate @ self.residual) / self.curvature

    def determines_delay(self, lags: int, rows: Mask | slice = slice(None), least: float = _INFORMED) -> bool:
        """Return whether the rates of both sides are correlated more than two independent noises by chance."""
        rate, other = self.rate[rows], self.measured_rate[rows]
        size = float(np.linalg.norm(rate) * np.linalg.norm(other))
        return size > 0 and float(rate @ other) / size > least / np.sqrt(max(len(rate) / max(lags, 1), 1.0))

    def apart(self, lags: int) -> float:
        """Return the share of what a delay adds that the last column of the base does not; 1 where there is nothing."""
        alone = _Pair(self.base[:, :-1], *self._rates, self.target, self._rows)
        if not alone.determines_delay(lags):
            return 1.0
        return float(self.rate @ self.measured_rate) / float(alone.rate @ alone.measured_rate)

    def delay_std(self, lags: int, rows: Mask | slice = slice(None)) -> float:
        """Return the standard error of the delay, in s."""
        rate = self.rate[rows]
        noise = long_run((rate * self.residual[rows])[:, None], lags)[0, 0]
        return float(np.sqrt(max(noise, 0.0)) / max(rate @ self.measured_rate[rows], 1e-300))

    def drift(self, lags: int) -> tuple[float, float]:
        """Return how much later the measured side is at the end than at the beginning, with its standard error, in s.

        It is the line through the delays of the thirds of the recording; NaN where one of them has none. That the
        middle third is off the line counts as error.
        """
        parts = [(self._place >= k / _THIRDS) & (self._place <= (k + 1) / _THIRDS) for k in range(_THIRDS)]
        if any(p.sum() < 10 or not self.determines_delay(lags, p, _INFORMED / 2) for p in parts):
            return np.nan, np.nan
        late = np.array([-(self.rate[p] @ self.residual[p]) / (self.rate[p] @ self.measured_rate[p]) for p in parts])
        spread = np.array([self.delay_std(lags, p) for p in parts])
        design = np.column_stack([np.ones(_THIRDS), [self._place[p].mean() for p in parts]]) / spread[:, None]
        values, residual = np.linalg.lstsq(design, late / spread, rcond=None)[:2]
        std = float(np.sqrt(np.linalg.inv(design.T @ design)[1, 1] * max(1.0, residual.sum())))
        return float(values[1]), std


def slow(values: Floats, step: float) -> Floats:
    """Return a signal behind a low-pass without delay, NaN where it is not known."""
    there = np.isfinite(values)
    mean = values[there].mean() if there.any() else 0.0
    weight, passed = (
        scipy.ndimage.gaussian_filter1d(v, _SLOW / step, mode="constant")
        for v in (there.astype(float), np.where(there, values - mean, 0.0))
    )
    return np.where(there, mean + passed / np.maximum(weight, 1e-12), np.nan)


def is_slow(sides: tuple[Floats, Floats], step: float) -> bool:
    """Return whether the low-pass leaves half of the power of either side: a static relation may hold of these."""
    return any(float(np.nanvar(slow(side, step))) >= 0.5 * float(np.nanvar(side)) for side in sides)


def without(others: Floats, values: Floats) -> Floats:
    """Return the residual of a column after least squares on others."""
    return values - others @ np.linalg.lstsq(others, values, rcond=None)[0] if others.shape[1] else values


def _estimates(fit: Agreement, pair: _Pair, lags: int, with_arm: bool) -> Agreement:
    """Return the fit with values and standard errors."""
    base, first = pair.base, pair.values
    spread = _robust_errors(base, pair.residual, lags)
    own = [without(base[:, 1:], v) for v in (pair.target, base[:, 0])]
    total, regressor = (float((v**2).sum()) for v in own)
    explained = 0.0 if min(total, regressor) == 0 else float((own[0] @ own[1]) ** 2 / (total * regressor))
    slope = float(np.copysign(np.sqrt(total / max(regressor, 1e-300)), first[0]))
    noisy = -np.log(max(explained, 1e-12)) / (2 * np.sqrt(3))
    relative = np.linalg.norm([spread[0] / max(abs(first[0]), 1e-300), noisy, fit.unresolved])
    free = not fit.relation.through_zero
    return replace(
        fit,
        samples=len(pair.target),
        slope=slope,
        slope_std=float(abs(slope) * relative),
        offset=float(first[1]) if free else np.nan,
        offset_std=float(spread[1]) if free else np.nan,
        arm=float(first[-1]) if with_arm else np.nan,
        arm_std=float(spread[-1]) if with_arm else np.nan,
        explained=float(1 - pair.residual.var() / pair.target.var()) if free else explained,
    )


def correlation_peak(measured: Floats, computed: Floats, step: float) -> float:
    """Return the delay in s at which both are most alike, turned round or not, on the grid of samples."""
    reach = min(int(LONGEST_DELAY / step), len(measured) - 1)
    m, c = (np.where(np.isfinite(x), x - np.nanmean(x), 0.0) for x in (measured, computed))
    likeness = np.abs(scipy.signal.correlate(m, c, mode="full", method="fft")[len(c) - 1 - reach : len(c) + reach])
    return (int(np.argmax(likeness)) - reach) * step


def delayed(values: Floats, delay: float, step: float, take: NDArray[np.intp]) -> Floats:
    """Return a signal as it would be with a delay, at some samples."""
    return np.interp(take - delay / step, np.arange(len(values)), values, left=np.nan, right=np.nan)


def _robust_errors(design: Floats, residual: Floats, lags: int) -> Floats:
    """Return standard errors of least squares whose residuals are correlated over ``lags`` samples."""
    meat = long_run(design * residual[:, None], lags)
    bread = np.linalg.pinv(design.T @ design)
    return np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))


def long_run(values: Floats, lags: int) -> Floats:
    """Return the covariance of the sum of values ``(samples, columns)`` that are correlated over ``lags`` samples.

    It is that of Newey and West (1987): the mean of the products of all sums over ``lags + 1`` samples. Where the
    values remember longer, as many lags are taken as fit their memory (Andrews 1991), up to an eighth of the samples.
    """
    lags = min(max(lags, _memory(values)), max(lags, len(values) // 8), max(len(values) - 1, 0))
    edges = np.zeros((lags + 1, values.shape[1]))
    total = np.cumsum(np.concatenate([edges, values, edges]), axis=0)
    sums = total[lags + 1 :] - total[: -lags - 1]
    return sums.T @ sums / (lags + 1)


def _memory(values: Floats) -> int:
    """Return the bandwidth in samples that suits the slowest of some columns, taken as a process of first order."""
    power = (values**2).sum(axis=0)
    alike = (values[1:] * values[:-1]).sum(axis=0) / np.where(power > 0, power, 1.0)
    slowest = float(np.clip(alike.max(initial=0.0), 0.0, 1 - 1e-4))
    return int(1.1447 * (4 * slowest**2 / (1 - slowest**2) ** 2 * len(values)) ** (1 / 3))
