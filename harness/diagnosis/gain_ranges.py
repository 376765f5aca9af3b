"""Ranges of the gains of a gyroscope and of the speed signal, measured by positions.

A gyroscope that reads too much, or the more so the faster the vehicle goes, looks like a vehicle that turns in another
way, and a speed that is read too low like an accelerometer that leans. Positions tell them apart, whatever the vehicle:
over some seconds its course turns by as much as the vehicle, but for the change of the sideslip angle,

    int r dt = (1 + g) dchi - c int v dchi + b dt + p d(r / v) + q d(v r),

where the last two are that change in steady cornering (Mitschke and Wallentowitz 2014), and its path is as long
as the speed says. So where positions are recorded these gains are measured, and the search keeps to that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.diagnosis.criteria import PRIORS
from harness.identification.uncertainty import covariance_of
from harness.recordings.motion.consistency import SURE
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.motion.redundancy import MOVING

RATES = ("yaw_rate", "yaw_rate_tractor")
_SPEED = "speed"
_PLACE = ("position_x", "position_y")

_STRETCH = 5.0
"""s over which turns and distances are compared."""

_SMOOTHED = 0.6
"""s over which positions are smoothed."""

_FEWEST = 30
"""Stretches; of fewer the errors are not known well enough."""

Ranges = dict[str, tuple[float, float]]


def gain_ranges(recordings: Sequence[xr.Dataset]) -> Ranges:
    """Return the least and the largest value of each gain that positions have measured, by parameter.

    They are infinite where the drives do not tell: at one speed a gain and a loss by speed are the same.

    Both sides carry errors, so a gain lies between the regression of one on the other and the inverse of that of the
    other on the one (Frisch 1934).

    Args:
        recordings: Of one vehicle with the same sensors; those without positions say nothing.
    """
    ranges: Ranges = {}
    for rate in RATES:
        rows = [s for r in recordings if {rate, _SPEED, *_PLACE} <= {*r} for s in _stretches(r, rate)]
        if len(rows) < _FEWEST:
            continue
        table = np.array(rows)
        by_gyroscope, by_course, neither, (stated, driven) = (
            table[:, 0:2],
            table[:, 2:4],
            table[:, 4:7],
            table[:, 7:9].T,
        )
        (k, c), errors = _regressed(by_gyroscope[:, 0], np.column_stack([by_course, neither]))
        (k_back, c_back), errors_back = _regressed(by_course[:, 0], np.column_stack([by_gyroscope, neither]))
        (wheel,), (error,) = _regressed(stated, driven[:, None], 1)
        mean_speed = float(driven.sum() / neither[:, 0].sum())
        ranges |= {
            f"sensor_gain_error_{rate}": _range([k - 1.0, 1.0 / k_back - 1.0], [errors[0], errors_back[0]]),
            f"sensor_speed_loss_{rate}": _range([-c, c_back / k_back], [errors[1], errors_back[1]], mean_speed),
            "wheel_radius_error": _range([wheel - 1.0], [error]),
        }
    return ranges


def _range(values: Sequence[float], errors: Sequence[float], scale: float = 1.0) -> tuple[float, float]:
    reach = [SURE * float(e) + PRIORS.gain / scale for e in errors]
    ends = [(float(v) - r, float(v) + r) for v, r in zip(values, reach, strict=True)]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _regressed(measured: Floats, columns: Floats, count: int = 2) -> tuple[Floats, Floats]:
    """Return the coefficients of the first columns, and their standard errors; infinite where nothing tells."""
    values = np.asarray(np.linalg.lstsq(columns, measured, rcond=None)[0], dtype=float)
    residual = measured - columns @ values
    rounding = np.finfo(float).eps * (measured @ measured)  # all that is left where one was derived from the other
    variance = max(residual @ residual, rounding) / max(len(residual) - columns.shape[1], 1)
    return values[:count], covariance_of(columns.T @ columns / variance).errors[:count]


def _stretches(recording: xr.Dataset, rate: str) -> list[tuple[float, ...]]:
    """Return what is compared, for each stretch in which the vehicle moves and everything is known.

    It is the turn by the gyroscope and the same times speed, both by the course, duration, changes of ``r / v`` and
    ``v r``, and the distance by the speed signal and by positions.
    """
    time = recording["time"].to_numpy()
    step = float(time[-1] - time[0]) / (len(time) - 1)
    r, v = (recording[n].to_numpy().astype(float) for n in (rate, _SPEED))
    x, y = (local_polynomial(recording[place].to_numpy(), step, _SMOOTHED, 1) for place in _PLACE)
    ground = np.hypot(x, y)
    valid = np.isfinite(r) & np.isfinite(v) & (ground > MOVING) & (v > MOVING)
    each = max(2, round(_STRETCH / step))
    stretches: list[tuple[float, ...]] = []
    for begin in range(0, len(time) - each, each):
        at = slice(begin, begin + each + 1)
        if not valid[at].all():
            continue
        turns, ends, speeds = np.diff(np.unwrap(np.arctan2(y[at], x[at]))), [begin, begin + each], ground[at]
        stretches.append(
            (
                _integral(r[at], step),
                _integral(r[at] * v[at], step),
                float(turns.sum()),
                float(turns @ (0.5 * (speeds[1:] + speeds[:-1]))),
                each * step,
                float(np.diff(r[ends] / v[ends])[0]),
                float(np.diff(r[ends] * v[ends])[0]),
                _integral(v[at], step),
                _integral(speeds, step),
            )
        )
    return stretches


def _integral(values: Floats, step: float) -> float:
    return float(np.trapezoid(values, dx=step))
