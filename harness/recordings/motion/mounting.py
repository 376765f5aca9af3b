"""Mounting of an inertial unit that stands or lies otherwise: its axes from gravity and from the motion over ground.

Turned by roll, then pitch, then yaw, components in the axes of the unit become those in the axes of the vehicle.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.effects._gravity import GRAVITY

_ROUNDS = 3
"""Of the regression, whose yaw rate takes the upright axis of the one before."""
_NEAR = 0.15
"""Share of gravity by which the median specific force may be off it."""


def rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the matrix ``(3, 3)`` that turns components in the unit's axes into the vehicle's; angles in rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, dtype=float)


def angles(turn: Floats) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in rad of a matrix ``(3, 3)``."""
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    return float(roll), float(-np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))), float(yaw)


def axes(force: Floats, turning: Floats, speed: Floats, rate: Floats) -> tuple[Floats, float] | None:
    """Return the turn of a unit by a drive, and how well its horizontal force follows the motion.

    The specific force is regressed on ``dv/dt``, on ``v r``, with the turning about the upright axis as the yaw rate,
    and on one: the coefficients are the vehicle's axes in those of the unit, the last times gravity. The turn is the
    rotation nearest to them, each weighed by how much it is excited (orthogonal Procrustes problem, Schoenemann 1966).

    Args:
        force: Specific force in m/s^2 in the unit's axes ``(3, samples)``.
        turning: Angular velocity in rad/s in the same ones.
        speed: m/s, shape ``(samples,)``.
        rate: Its rate in m/s^2.

    Returns:
        Matrix ``(3, 3)`` and correlation; None if the force is none that holds gravity.
    """
    there = np.isfinite(force).all(axis=0) & np.isfinite(turning).all(axis=0) & np.isfinite(speed) & np.isfinite(rate)
    if there.sum() < 2:
        return None
    force, turning, speed, rate = force[:, there], turning[:, there], speed[there], rate[there]
    up = np.median(force, axis=1)
    size = float(np.linalg.norm(up))
    if abs(size / GRAVITY - 1.0) > _NEAR:
        return None
    up = up / size
    for _ in range(_ROUNDS):
        motion = np.array([rate, speed * (up @ turning), np.ones(len(rate))])
        seen = np.linalg.lstsq(motion.T, force.T, rcond=None)[0]
        up = seen[2] / np.linalg.norm(seen[2])
    motion = motion[:2] - motion[:2].mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(seen * np.array([*motion.std(axis=1), 1.0])[:, None])
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    across = (turn @ force)[:2]
    across = across - across.mean(axis=1, keepdims=True)
    sizes = float(np.linalg.norm(across) * np.linalg.norm(motion))
    return (np.asarray(turn), float(np.sum(across * motion)) / sizes) if sizes > 0.0 else None
