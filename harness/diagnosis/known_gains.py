"""What positions say about the gains of a gyroscope and of the speed signal.

A gyroscope that reads too much, or the more so the faster the vehicle goes, looks like a vehicle that turns in another
way, and a speed that is read too low like an accelerometer that leans. Positions tell them apart, whatever the vehicle:
over some seconds its course turns by as much as the vehicle, but for the change of the sideslip angle,

    int r dt = (1 + g) dchi - c int v dchi + b dt + p d(r / v) + q d(v r),

where the last two are that change in steady cornering (Mitschke and Wallentowitz 2014, 16.3), and its path is as long
as the speed says. So where positions are recorded these gains are measured, and the search keeps to that.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.diagnosis.criteria import PRIORS
from harness.recordings.consistency import SURE
from harness.recordings.differentiate import local_polynomial
from harness.recordings.redundancy import MOVING

RATES = ("yaw_rate", "yaw_rate_tractor")
SPEEDS = ("speed", "speed_tractor")

_STRETCH = 5.0
"""s over which turns and distances are compared."""

_SMOOTHED = 0.6
"""s over which positions are smoothed."""

_FEWEST = 30
"""Stretches; of fewer the errors are not known well enough."""

Ranges = dict[str, tuple[float, float]]


def known_ranges(recordings: Sequence[xr.Dataset]) -> Ranges:
    """Return the least and the largest value of each gain that positions have measured, by parameter; zero is in it.

    Args:
        recordings: Of one vehicle with the same sensors; those without positions say nothing.
    """
    found: Ranges = {}
    for rate, speed in product(RATES, SPEEDS):
        rows = _of_all(recordings, rate, speed)
        if len(rows) < _FEWEST:
            continue
        turned, travelled = rows[:, :-2], rows[:, -2:]
        values, errors = _regressed(turned)
        (ratio,), (error,) = _regressed(travelled)
        mean_speed = float(np.sum(travelled[:, 1]) / np.sum(turned[:, 3]))
        found |= {
            f"sensor_gain_error_{rate}": _range(values[0] - 1.0, errors[0], PRIORS.gain),
            f"sensor_speed_loss_{rate}": _range(-values[1], errors[1], PRIORS.gain / mean_speed),
            "wheel_radius_error": _range(ratio - 1.0, error, PRIORS.gain),
        }
    return found


def _range(value: float, error: float, neglected: float) -> tuple[float, float]:
    reach = SURE * float(error) + neglected
    return min(0.0, float(value) - reach), max(0.0, float(value) + reach)


def _regressed(rows: Floats) -> tuple[Floats, Floats]:
    """Return the coefficients of the columns behind the first one, and their standard errors."""
    measured, columns = rows[:, 0], rows[:, 1:]
    values = np.asarray(np.linalg.lstsq(columns, measured, rcond=None)[0], dtype=float)
    left = measured - columns @ values
    variance = left @ left / max(len(left) - columns.shape[1], 1)
    return values, np.sqrt(variance * np.diagonal(np.linalg.pinv(columns.T @ columns)))


def _of_all(recordings: Sequence[xr.Dataset], rate: str, speed: str) -> Floats:
    needed = {rate, speed, "position_x", "position_y"}
    return np.concatenate([np.empty((0, 8)), *(_stretches(r, rate, speed) for r in recordings if needed <= {*r})])


def _stretches(recording: xr.Dataset, rate: str, speed: str) -> Floats:
    """Return what is compared, a row per stretch in which the vehicle moves and everything is known ``(n, 8)``.

    It is turn by the gyroscope, turn of the course, that times speed, duration, changes of ``r / v`` and ``v r``, and
    distance by the speed signal and by positions.
    """
    time = recording["time"].to_numpy()
    step = float(time[-1] - time[0]) / (len(time) - 1)
    r, v = (recording[n].to_numpy().astype(float) for n in (rate, speed))
    x, y = (local_polynomial(recording[f"position_{a}"].to_numpy(), step, _SMOOTHED, 1) for a in "xy")
    ground = np.hypot(x, y)
    known = np.isfinite(r) & np.isfinite(v) & (ground > MOVING) & (v > MOVING)
    each = max(2, round(_STRETCH / step))
    rows = []
    for begin in range(0, len(time) - each, each):
        at = slice(begin, begin + each + 1)
        if not known[at].all():
            continue
        course = np.unwrap(np.arctan2(y[at], x[at]))
        ends = np.array([begin, begin + each])
        speeds, turns = ground[at], np.diff(course)
        rows.append(
            (
                np.trapezoid(r[at], dx=step),
                course[-1] - course[0],
                float(turns @ (0.5 * (speeds[1:] + speeds[:-1]))),
                each * step,
                np.diff(r[ends] / v[ends])[0],
                np.diff(r[ends] * v[ends])[0],
                np.trapezoid(v[at], dx=step),
                np.trapezoid(speeds, dx=step),
            )
        )
    return np.array(rows).reshape(-1, 8)
