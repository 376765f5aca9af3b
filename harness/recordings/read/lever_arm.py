"""Moving the signals of a recording from their sensors to the reference point of the recording."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.recordings.motion import kinematics
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.read.channel_map import ChannelMap, SensorPoint

Move = Callable[[Floats, Floats], tuple[Floats, Floats]]

_BODIES = ("", "_tractor", "_trailer")
_WINDOW = 0.1
"""s, window over which heading and yaw rate are differentiated."""


def to_reference_point(signals: dict[str, Floats], channels: ChannelMap, step: float) -> None:
    """Move velocities, accelerations and positions to the reference point, in place.

    Signals measured at a point of unknown lever arm stay as they are.

    Args:
        signals: Arrays of shape ``(samples,)`` in SI units by name.
        channels: The map, with the point where each signal is measured.
        step: s between samples.

    Raises:
        UserError: If the yaw rate or the heading that moving takes is not known.
    """
    point_of = {c.signal: c.point for c in channels.channels}
    for name, point in channels.points.items():
        if not point.has_lever_arm:
            continue
        if point_of.get("heading") == name:
            signals["heading"] = signals["heading"] - point.yaw
        for body in _BODIES:
            mover = _Mover(signals, point, body, step)
            for kind, move in (("velocity", mover.velocity), ("acceleration", mover.acceleration)):
                pair = [f"{side}_{kind}{body}" for side in ("longitudinal", "lateral")]
                here = [s for s in pair if point_of.get(s) == name]
                if here:
                    _move(signals, pair, here, point, move)
        if "position_x" in signals and point_of.get("position_x") == point_of.get("position_y") == name:
            if "heading" not in signals:
                raise UserError(f"points.{name}: moving positions takes the heading; map it, or take the point out")
            east, north, heading = signals["position_x"], signals["position_y"], signals["heading"]
            moved = kinematics.move_position(east, north, heading, -point.x, -point.y)
            signals["position_x"], signals["position_y"] = moved


def _move(signals: dict[str, Floats], pair: list[str], here: list[str], point: SensorPoint, move: Move) -> None:
    """Turn and move one pair of components, of which one may be missing if the axes are parallel."""
    if len(here) < 2 and point.yaw != 0:
        raise UserError(f"points: '{here[0]}' alone cannot be turned by {point.yaw:.4g} rad; map {' and '.join(pair)}")
    zero = np.zeros(len(signals[here[0]]))
    longitudinal, lateral = (signals[s] if s in here else zero for s in pair)
    longitudinal, lateral = kinematics.to_vehicle_axes(longitudinal, lateral, point.yaw)
    for name, values in zip(pair, move(longitudinal, lateral), strict=True):
        if name in here:
            signals[name] = values


class _Mover:
    """Moves vectors of one body by ``-x, -y``; asks for the yaw rate only if there is a way to go."""

    def __init__(self, signals: dict[str, Floats], point: SensorPoint, body: str, step: float) -> None:
        self._signals, self._body, self._step = signals, body, step
        self._x, self._y = -point.x, -point.y

    def velocity(self, v_x: Floats, v_y: Floats) -> tuple[Floats, Floats]:
        if self._x == self._y == 0:
            return v_x, v_y
        return kinematics.move_velocity(v_x, v_y, self._yaw_rate(), self._x, self._y)

    def acceleration(self, a_x: Floats, a_y: Floats) -> tuple[Floats, Floats]:
        if self._x == self._y == 0:
            return a_x, a_y
        rate = self._yaw_rate()
        measured = self._signals.get(f"yaw_acceleration{self._body}")
        turning = measured if measured is not None else local_polynomial(rate, self._step, _WINDOW, 1)
        return kinematics.move_acceleration(a_x, a_y, rate, turning, self._x, self._y)

    def _yaw_rate(self) -> Floats:
        name = f"yaw_rate{self._body}"
        if name in self._signals:
            return self._signals[name]
        if not self._body and "heading" in self._signals:
            return local_polynomial(self._signals["heading"], self._step, _WINDOW, 1)
        raise UserError(f"points: moving a signal to the reference point takes '{name}'; map it, or take the point out")
