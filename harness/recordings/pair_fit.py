"""Slope, offset, lever arm, delay and drift between a measured signal and a computed one, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.recordings.redundancy import Relation

LONGEST_DELAY = 0.5
"""s; a delay near it is none: the signals are not alike at any."""
MEMORY = 1.0
"""s over which the residual is taken to be correlated."""
SPACING = 0.04
"""s between the samples of a smoothed signal that are looked at."""
RELATED = 0.5
"""Least share of the variance that must be explained for slope and delay to be meaningful."""


@dataclass(frozen=True)
class Agreement:
    """How one signal agrees with what the others make of it.

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
        """Whether the fit says anything about scale, delay and offset."""
        return bool(np.isfinite(self.slope)) and self.slope > 0 and self.explained >= RELATED


def fit_pair(fit: Agreement, arm: Floats | None, window: float) -> Agreement | None:
    """Estimate slope, offset, arm, delay and drift of one smoothed pair; None if too little of both sides is known.

    The delay starts from the peak of the cross-correlation and is refined together with the other parameters.
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
        known = table[rows]
        pair = _Pair(known[:, :-3], known[:, -3], known[:, -2], known[:, -1], take[rows])
        left = np.abs(pair.left)
        usual = np.median(left)
        away = left > 8 * 1.4826 * usual
        if usual > 0 and 0 < away.sum() < 0.03 * rows.sum():  # single samples that jump
            kept[np.flatnonzero(rows)[away]] = False
            continue
        if not aligned or pair.curvature <= 0:
            break
        change = float(np.clip(pair.later, -0.1, 0.1))
        delay = float(np.clip(delay + change, -LONGEST_DELAY, LONGEST_DELAY))
        if abs(change) < 1e-5:
            break
    aligned &= pair.curvature > 0 and abs(delay) < 0.9 * LONGEST_DELAY
    lags = int(max(MEMORY, window) / (every * step))
    found = replace(_estimates(fit, pair, lags, arm is not None), window=window)
    return replace(found, delay=delay if aligned else np.nan) if aligned else found


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
        both = np.column_stack([target, computed_rate])
        values = np.linalg.lstsq(base, both, rcond=None)[0]
        self.left, self.rate = np.ascontiguousarray((both - base @ values).T)
        self.values = values[:, 0]
        self.measured_rate = measured_rate
        self.curvature = float(self.rate @ measured_rate)
        self.centred = (rows - rows.mean()) / max(np.ptp(rows), 1)

    @property
    def later(self) -> float:
        """How much later than assumed the measured side is, in s.

        The rates of both sides have no noise in common, so their product knows how sharp the peak of the correlation
        is; the square of one of them would hold its noise, and the delay would come out too small and too sure.
        """
        return -float(self.rate @ self.left) / self.curvature


def without(others: Floats, values: Floats) -> Floats:
    """Return what is left of a column after least squares on others."""
    return values - others @ np.linalg.lstsq(others, values, rcond=None)[0] if others.shape[1] else values


def _estimates(fit: Agreement, pair: _Pair, lags: int, with_arm: bool) -> Agreement:
    """Return the fit with values and standard errors."""
    base, first = pair.base, pair.values
    spread = _robust_errors(base, pair.left, lags)
    own = [without(base[:, 1:], v) for v in (pair.target, base[:, 0])]
    total, regressor = (float((v**2).sum()) for v in own)
    explained = 0.0 if min(total, regressor) == 0 else float((own[0] @ own[1]) ** 2 / (total * regressor))
    slope = float(np.copysign(np.sqrt(total / max(regressor, 1e-300)), first[0]))
    relative = np.hypot(spread[0] / max(abs(first[0]), 1e-300), -np.log(max(explained, 1e-12)) / (2 * np.sqrt(3)))
    free = not fit.relation.through_zero
    spreads = [
        float(
            np.sqrt(max(long_run((pair.rate * weight * pair.left)[:, None], lags)[0, 0], 0.0))
            / max(pair.curvature, 1e-300)
            / (weight**2).mean()
        )
        for weight in (np.ones(len(pair.left)), pair.centred)
    ]
    weighted = pair.rate * pair.centred
    drift = -float(weighted @ pair.left) / float(weighted @ (pair.measured_rate * pair.centred))
    return replace(
        fit,
        samples=len(pair.target),
        slope=slope,
        slope_std=float(abs(slope) * relative),
        offset=float(first[1]) if free else np.nan,
        offset_std=float(spread[1]) if free else np.nan,
        arm=float(first[-1]) if with_arm else np.nan,
        arm_std=float(spread[-1]) if with_arm else np.nan,
        delay_std=spreads[0],
        drift=drift,
        drift_std=spreads[1],
        explained=float(1 - pair.left.var() / pair.target.var()) if free else explained,
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


def _robust_errors(design: Floats, left: Floats, lags: int) -> Floats:
    """Return standard errors of least squares whose residuals are correlated over ``lags`` samples."""
    meat = long_run(design * left[:, None], lags)
    bread = np.linalg.pinv(design.T @ design)
    return np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))


def long_run(values: Floats, lags: int) -> Floats:
    """Return the covariance of the sum of values ``(samples, columns)`` that are correlated over ``lags`` samples."""
    found = values.T @ values
    for lag in range(1, min(lags, len(values) - 1) + 1):
        cross = values[lag:].T @ values[:-lag]
        found += (1 - lag / (lags + 1)) * (cross + cross.T)
    return found
