"""Signals that follow from others by kinematics alone: velocities and accelerations from positions and heading.

The window of the local polynomials trades noise against bandwidth; every function takes and returns arrays of shape
``(samples,)`` in SI units and passes NaN on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from harness.common.arrays import Floats
from harness.recordings.differentiate import local_polynomial
from harness.recordings.kinematics import acceleration_of_velocity, earth_to_vehicle


@dataclass(frozen=True)
class Sources:
    """The signals known so far, and how to smooth and differentiate them.

    Attributes:
        signals: Arrays by name.
        step: s between samples.
        window: s, length of the local polynomial.
        alike: Highest derivative of what is compared, by whose kernel all are smoothed; None: each by its own.
    """

    signals: Mapping[str, Floats]
    step: float
    window: float
    alike: int | None = None
    _known: dict[tuple[str, int], Floats] = field(default_factory=dict, repr=False, compare=False)

    def __getitem__(self, name: str) -> Floats:
        return self.rate(name, 0)

    def rate(self, name: str, derivative: int = 1) -> Floats:
        """Return a signal smoothed, or a derivative of it."""
        if (name, derivative) not in self._known:
            found = local_polynomial(self.signals[name], self.step, self.window, derivative, self.alike)
            self._known[name, derivative] = found
        return self._known[name, derivative]


def _velocity(s: Sources) -> tuple[Floats, Floats]:
    return earth_to_vehicle(s.rate("position_x"), s.rate("position_y"), s["heading"])


def _acceleration(s: Sources) -> tuple[Floats, Floats]:
    if "position_x" in s.signals:
        return earth_to_vehicle(s.rate("position_x", 2), s.rate("position_y", 2), s["heading"])
    return acceleration_of_velocity(
        s["longitudinal_velocity"],
        s["lateral_velocity"],
        s.rate("longitudinal_velocity"),
        s.rate("lateral_velocity"),
        s["yaw_rate"],
    )


def _yaw_acceleration(s: Sources) -> Floats:
    return s.rate("heading", 2) if "heading" in s.signals else s.rate("yaw_rate")


_POSE = ("position_x", "position_y", "heading")
_MOTION = ("longitudinal_velocity", "lateral_velocity", "yaw_rate")

DERIVED: dict[str, tuple[tuple[tuple[str, ...], ...], Callable[[Sources], Floats]]] = {
    "yaw_rate": ((("heading",),), lambda s: s.rate("heading")),
    "yaw_acceleration": ((("heading",), ("yaw_rate",)), _yaw_acceleration),
    "longitudinal_velocity": ((_POSE,), lambda s: _velocity(s)[0]),
    "lateral_velocity": ((_POSE,), lambda s: _velocity(s)[1]),
    "longitudinal_acceleration": ((_POSE, _MOTION), lambda s: _acceleration(s)[0]),
    "lateral_acceleration": ((_POSE, _MOTION), lambda s: _acceleration(s)[1]),
    "speed": ((_POSE, ("longitudinal_velocity",)), lambda s: _speed(s)),
    "speed_rate": ((("speed",), ("longitudinal_velocity",)), lambda s: _speed_rate(s)),
    "sideslip_angle": (
        (("longitudinal_velocity", "lateral_velocity"),),
        lambda s: np.arctan2(s["lateral_velocity"], s["longitudinal_velocity"]),
    ),
}
"""What can be derived: the sets of signals of which one suffices, and the function."""


def _speed(s: Sources) -> Floats:
    return s["longitudinal_velocity"] if "longitudinal_velocity" in s.signals else _velocity(s)[0]


def _speed_rate(s: Sources) -> Floats:
    return s.rate("speed" if "speed" in s.signals else "longitudinal_velocity")
