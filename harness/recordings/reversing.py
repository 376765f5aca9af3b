"""Where a vehicle drives backwards: its course over ground is against its heading."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.recordings.differentiate import local_polynomial
from harness.recordings.kinematics import earth_to_vehicle

COURSE = "course"
"""What ``reverse`` of a channel map says where the course over ground tells it."""
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
