"""Kinematics of a rigid body: derivatives of signals, lever arms, and signals that follow from others.

Equidistant samples are smoothed and differentiated by local polynomials (Savitzky and Golay 1964): value, slope and
curvature in the middle of a window are those of the cubic that fits it best, without delay, and without bias for
signals that are cubic over the window. The noise of a slope falls with the window to the power 3/2.

Motion at another point is that of Sun 2015, 3.20 to 3.30 and A.1 to A.9. All components are in the vehicle's axes
(x forward, y left), ``x, y`` lead from the sensor to the point wanted, ``yaw`` turns the vehicle's axes into the
sensor's. Rigid-body kinematics correct three printed equations: (3.25) and (3.26) exchange x and y, (3.30) has the
opposite sign at ``x``. An azimuth (3.21) is turned by a channel map.

Signals have the shape ``(samples,)`` and SI units; NaN is passed on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy
import xarray as xr

from harness.common.arrays import Floats
from harness.models.signals import TRUTH

_DEGREE = 3


def local_polynomial(
    values: Floats, step: float, window: float, derivative: int = 0, alike: int | None = None
) -> Floats:
    """Return the signal or a derivative of it, smoothed by a local cubic.

    The polynomial's value, slope and curvature pass frequencies differently, so that the slope of an angle and the
    value of its rate are not alike. Signals and derivatives that are to be compared are smoothed ``alike``: by the
    kernel of which the highest derivative among them is that of the polynomial.

    Args:
        values: Samples of shape ``(samples,)``; NaN where missing.
        step: Time between them in s.
        window: Length of the window in s; at least five samples are taken.
        derivative: 0, 1 or 2.
        alike: Highest derivative in the comparison, at least ``derivative``; None: each as the polynomial has it.

    Returns:
        Array of the same shape in unit/s^derivative; NaN where the window holds a missing sample, and half a window
        from either end.
    """
    half = max(round(window / step / 2), 2)
    result = np.full(len(values), np.nan)
    if len(values) > 2 * half:
        order = derivative if alike is None else alike
        weights = scipy.signal.savgol_coeffs(2 * half + 1, _DEGREE, deriv=order, delta=step, use="conv")
        for _ in range(order - derivative):  # the integral of a kernel without sum, by the trapezoidal rule
            weights = step * np.convolve(np.cumsum(weights)[:-1], [0.5, 0.5])
        result[half : len(values) - half] = np.convolve(values, weights, mode="valid")
    return result


def to_vehicle_axes(longitudinal: Any, lateral: Any, yaw: float) -> tuple[Any, Any]:
    """Turn the components of a vector from the axes of a sensor mounted at ``yaw`` into the vehicle's (3.29, 3.30)."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return cosine * longitudinal - sine * lateral, sine * longitudinal + cosine * lateral


def earth_to_vehicle(east: Any, north: Any, heading: Any) -> tuple[Any, Any]:
    """Turn the components of a vector from east and north into forward and left (3.23, 3.24)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return cosine * east + sine * north, -sine * east + cosine * north


def move_velocity(v_x: Any, v_y: Any, yaw_rate: Any, x: float, y: float) -> tuple[Any, Any]:
    """Return the velocity in m/s of the point ``(x, y)`` m from where ``v_x, v_y`` is measured (3.25, 3.26; A.5)."""
    return v_x - yaw_rate * y, v_y + yaw_rate * x


def move_acceleration(a_x: Any, a_y: Any, yaw_rate: Any, yaw_acceleration: Any, x: float, y: float) -> tuple[Any, Any]:
    """Return the acceleration in m/s^2 of the point ``(x, y)`` m from where it is measured (3.29, 3.30; A.9)."""
    return (
        a_x - yaw_rate**2 * x - yaw_acceleration * y,
        a_y - yaw_rate**2 * y + yaw_acceleration * x,
    )


def move_position(east: Any, north: Any, heading: Any, x: float, y: float) -> tuple[Any, Any]:
    """Return the position in m of the point ``(x, y)`` m from where it is measured (3.27, 3.28)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return east + cosine * x - sine * y, north + sine * x + cosine * y


def acceleration_of_velocity(v_x: Any, v_y: Any, v_x_dot: Any, v_y_dot: Any, yaw_rate: Any) -> tuple[Any, Any]:
    """Return the acceleration in m/s^2 that belongs to a velocity in turning axes (A.8 without lever arm)."""
    return v_x_dot - v_y * yaw_rate, v_y_dot + v_x * yaw_rate


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
    _smoothed: dict[tuple[str, int], Floats] = field(default_factory=dict, repr=False, compare=False)

    def __getitem__(self, name: str) -> Floats:
        return self.rate(name, 0)

    def rate(self, name: str, derivative: int = 1) -> Floats:
        """Return a signal smoothed, or a derivative of it."""
        if (name, derivative) not in self._smoothed:
            values = local_polynomial(self.signals[name], self.step, self.window, derivative, self.alike)
            self._smoothed[name, derivative] = values
        return self._smoothed[name, derivative]


def velocity_of_pose(s: Sources) -> tuple[Floats, Floats]:
    """Return longitudinal and lateral velocity from position and heading."""
    return earth_to_vehicle(s.rate("position_x"), s.rate("position_y"), s["heading"])


def _acceleration(s: Sources) -> tuple[Floats, Floats]:
    if all(name in s.signals for name in _POSE):
        return earth_to_vehicle(s.rate("position_x", 2), s.rate("position_y", 2), s["heading"])
    return acceleration_of_velocity(
        s["longitudinal_velocity"],
        s["lateral_velocity"],
        s.rate("longitudinal_velocity"),
        s.rate("lateral_velocity"),
        s["yaw_rate"],
    )


_POSE = ("position_x", "position_y", "heading")
_MOTION = ("longitudinal_velocity", "lateral_velocity", "yaw_rate")

DERIVED: dict[str, tuple[tuple[tuple[str, ...], ...], Callable[[Sources], Floats]]] = {
    "yaw_rate": ((("heading",),), lambda s: s.rate("heading")),
    "yaw_acceleration": (
        (("heading",), ("yaw_rate",)),
        lambda s: s.rate("heading", 2) if "heading" in s.signals else s.rate("yaw_rate"),
    ),
    "longitudinal_velocity": ((_POSE,), lambda s: velocity_of_pose(s)[0]),
    "lateral_velocity": ((_POSE,), lambda s: velocity_of_pose(s)[1]),
    "longitudinal_acceleration": ((_POSE, _MOTION), lambda s: _acceleration(s)[0]),
    "lateral_acceleration": ((_POSE, _MOTION), lambda s: _acceleration(s)[1]),
    "speed": (
        (_POSE, ("longitudinal_velocity",)),
        lambda s: s["longitudinal_velocity"] if "longitudinal_velocity" in s.signals else velocity_of_pose(s)[0],
    ),
    "speed_rate": (
        (("speed",), ("longitudinal_velocity",)),
        lambda s: s.rate("speed" if "speed" in s.signals else "longitudinal_velocity"),
    ),
    "sideslip_angle": (
        (("longitudinal_velocity", "lateral_velocity"), ("speed", "lateral_velocity")),
        lambda s: np.arctan2(
            s["lateral_velocity"],
            s["longitudinal_velocity" if "longitudinal_velocity" in s.signals else "speed"],
        ),
    ),
}
"""Signals that can be derived: the sets of signals of which one suffices, and the function."""

_SPEEDS = {"": ("longitudinal_velocity", "speed"), "_trailer": ("speed",), "_tractor": ("speed_tractor",)}
"""Speeds along the x axis of a body, by what is appended to the names of its signals."""


def with_sideslip(recording: xr.Dataset, measured: Collection[str]) -> xr.Dataset:
    """Return a recording with the sideslip angle of each body whose lateral velocity and speed are known, and of truth.

    Args:
        recording: Signals over time, SI units.
        measured: What estimators get; a lateral velocity among it makes no reference.
    """
    angles = {}
    for body, speeds in _SPEEDS.items():
        for prefix in ("", TRUTH):
            angle, lateral = f"{prefix}sideslip_angle{body}", f"{prefix}lateral_velocity{body}"
            along = next((p + s for s in speeds for p in (prefix, "") if p + s in recording), None)
            if angle not in recording and lateral in recording and lateral not in measured and along is not None:
                angles[angle] = np.arctan2(recording[lateral], recording[along])
    return recording.assign(angles)
