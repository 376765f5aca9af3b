"""Moving what a sensor measures to another point of the rigid body (Sun 2015, 3.20 to 3.30 and A.1 to A.9).

All components are in the vehicle's axes (x forward, y left), ``x, y`` lead from the sensor to the point wanted, ``yaw``
turns the vehicle's axes into the sensor's. Rigid-body kinematics correct three printed equations: (3.25) and (3.26)
exchange x and y, (3.30) has the opposite sign at ``x``. An azimuth (3.21) is turned by a channel map.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def to_vehicle_axes(forward: Any, left: Any, yaw: float) -> tuple[Any, Any]:
    """Turn the components of a vector from the axes of a sensor mounted at ``yaw`` into the vehicle's (3.29, 3.30)."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return cosine * forward - sine * left, sine * forward + cosine * left


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
