"""Pose of the vehicle: position from latitude and longitude, heading across gaps, and driving backwards.

Latitude and longitude become positions east and north in the plane that touches the ellipsoid at the first fix, in
closed form: geodetic to earth-centred coordinates, and their turning into east and north (Farrell 2008, Aided
Navigation, 2.3). A library of map projections would be a heavy dependency for that. The height is taken as zero: 100 m
of it scale the distances by 16 millionths. A heading is measured within a turn; what the vehicle turned in a gap nobody
recorded. A vehicle drives backwards where its course over ground is against its heading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.recordings.motion.kinematics import earth_to_vehicle, local_polynomial

_SEMI_MAJOR = 6_378_137.0
_FLATTENING = 1 / 298.257223563
_SQUARED_ECCENTRICITY = _FLATTENING * (2 - _FLATTENING)


def earth_centred(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats, Floats]:
    """Return earth-centred coordinates in m of points on the ellipsoid WGS 84; angles in rad (2.9 to 2.11)."""
    normal = _SEMI_MAJOR / np.sqrt(1 - _SQUARED_ECCENTRICITY * np.sin(latitude) ** 2)
    return (
        normal * np.cos(latitude) * np.cos(longitude),
        normal * np.cos(latitude) * np.sin(longitude),
        normal * (1 - _SQUARED_ECCENTRICITY) * np.sin(latitude),
    )


def tangent_plane(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """Return positions east and north of the first known fix.

    Args:
        latitude: rad, shape ``(samples,)``; NaN where missing.
        longitude: rad, east positive.

    Returns:
        East and north in m, each ``(samples,)``. All NaN if there is no fix.
    """
    there = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    if not there.size:
        return np.full(len(latitude), np.nan), np.full(len(latitude), np.nan)
    phi, lam = latitude[there[0]], longitude[there[0]]
    x, y, z = earth_centred(latitude, longitude)
    x0, y0, z0 = earth_centred(phi, lam)
    dx, dy, dz = x - x0, y - y0, z - z0
    east = -np.sin(lam) * dx + np.cos(lam) * dy
    north = -np.sin(phi) * (np.cos(lam) * dx + np.sin(lam) * dy) + np.cos(phi) * dz
    return east, north


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


COURSE = "course"
"""Value of ``reverse`` in a channel map where the course over ground determines it."""
UNSIGNED = ("speed", "speed_tractor", "longitudinal_velocity")
"""Signals that devices often record without a sign."""
NEEDS = ("position_x", "position_y", "heading")
_WINDOW = 2.4
"""s over which positions are smoothed."""
_CRAWL = 0.3
"""m/s below which the course is that of the noise."""
_SHORTEST = 2.0
"""s that a vehicle drives backwards at least."""
_ALIGNED = np.radians(60.0)
_CLEAR = 0.9
"""Share of the samples in motion in which the course must be along the heading or against it."""


def backwards(signals: Mapping[str, Floats], step: float) -> Mask:
    """Return where a vehicle drives backwards ``(samples,)``.

    Args:
        signals: Positions in m and heading in rad, ``(samples,)``.
        step: s between samples.
    """
    along, across = _velocity(signals, step)
    return np.asarray((along < 0) & (np.hypot(along, across) > _CRAWL))


def unsigned_stretches(signals: Mapping[str, Floats], step: float) -> dict[str, list[tuple[float, float]]]:
    """Return from when to when in s a speed is positive while the vehicle drives backwards, by its signal.

    Nothing is returned where the course is neither along nor against the heading, as that of a heading in another
    convention.
    """
    if not set(NEEDS) <= set(signals):
        return {}
    along, across = _velocity(signals, step)
    angle = np.abs(np.arctan2(across, along))
    moves = np.hypot(along, across) > _CRAWL
    back, ahead = moves & (angle > np.pi - _ALIGNED), moves & (angle < _ALIGNED)
    if not moves.any() or (back | ahead).sum() < _CLEAR * moves.sum() or back.sum() > ahead.sum():
        return {}
    parts = [(a, b) for a, b in _runs(back) if (b - a) * step >= _SHORTEST]
    times = [(a * step, b * step) for a, b in parts]
    positive = {
        name: [t for t, (a, b) in zip(times, parts, strict=True) if np.nanmedian(signals[name][a:b]) > _CRAWL]
        for name in UNSIGNED
        if name in signals
    }
    return {name: there for name, there in positive.items() if there}


def _velocity(signals: Mapping[str, Floats], step: float) -> tuple[Floats, Floats]:
    """Return the velocity along and across the heading in m/s; 0 where it is not known."""
    east, north = (local_polynomial(signals[f"position_{axis}"], step, _WINDOW, 1) for axis in "xy")
    along, across = earth_to_vehicle(east, north, signals["heading"])
    return np.nan_to_num(along), np.nan_to_num(across)


def _runs(there: Mask) -> list[tuple[int, int]]:
    """Return first and last (excluded) sample of every stretch."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
