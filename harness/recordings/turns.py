"""A heading across gaps: it is measured within a turn, and what the vehicle turned meanwhile nobody recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats

_TURN = 2 * np.pi
_FASTEST = 99.0
"""Percentile of the rates of a recording that a vehicle may have in a gap."""
_DOUBT = 0.15
"""Share of the turning in a gap by which an integral of the rate may be off; half a turn decides."""


def continued(
    time: Floats, heading: Floats, gaps: Sequence[tuple[float, float]], rate: tuple[Floats, Floats] | None
) -> tuple[Floats, list[tuple[float, float]]]:
    """Continue a heading across gaps in which the vehicle may turn by more than half a turn.

    Args:
        time: Instants of the samples in s, ``(samples,)``.
        heading: rad, ``(samples,)``; continued by the nearest turn.
        gaps: From when to when in s there are no samples.
        rate: Instants in s and yaw rate in rad/s, where one is recorded.

    Returns:
        The heading, and the gaps across which it is unknown by multiples of a turn.
    """
    values, unknown = heading.copy(), []
    slope = np.abs(np.diff(heading) / np.maximum(np.diff(time), 1e-9))
    inside = ~np.isin(time[:-1], [a for a, _ in gaps])
    fastest = float(np.percentile(slope[inside], _FASTEST)) if inside.any() else 0.0
    for begin, end in gaps:
        if fastest * (end - begin) < _TURN / 2:
            continue
        after = int(np.searchsorted(time, end))
        turned = _turned(begin, end, rate)
        if turned is None or abs(turned) * _DOUBT > _TURN / 4:
            unknown.append((begin, end))
        if turned is not None:
            away = turned - (values[after] - values[after - 1])
            values[after:] += _TURN * np.round(away / _TURN)
    return values, unknown


def _turned(begin: float, end: float, rate: tuple[Floats, Floats] | None) -> float | None:
    """Return the integral of the yaw rate over a gap in rad; None where it has a gap itself."""
    if rate is None:
        return None
    time, values = rate
    there = (time >= begin) & (time <= end)
    usual = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if there.sum() < 2 or np.diff(np.concatenate([[begin], time[there], [end]])).max() > 10 * usual:
        return None
    at = np.concatenate([[begin], time[there], [end]])
    return float(np.trapezoid(np.interp(at, time, values), at))
