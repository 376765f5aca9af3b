"""What must agree in a recording, whatever the vehicle: the kinematics between its signals.

Each relation computes a measured signal from others. ``exact`` relations hold for any rigid body, so that slope 1 and
delay 0 are expected; the others hold for calm driving, and show no more than a wrong sign or unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.recordings.derived_signals import Sources
from harness.recordings.kinematics import earth_to_vehicle


@dataclass(frozen=True)
class Relation:
    """One signal computed from others.

    Attributes:
        signal: The signal that is checked.
        needs: The signals it is computed from.
        formula: How, in words for the report.
        compute: The function; takes smoothed signals and their derivatives.
        exact: Whether it holds for any motion in the plane.
        arm: What a lever arm between the sensors, m ahead, would add per metre; None if nothing.
        sign_only: Whether the scale is left open (a steering ratio, a wheelbase).
        scale: Whether slope 1 is to be expected.
        order: Derivative of the signal that is compared.
    """

    signal: str
    needs: tuple[str, ...]
    formula: str
    compute: Callable[[Sources], Floats]
    exact: bool = True
    arm: Callable[[Sources], Floats] | None = None
    sign_only: bool = False
    scale: bool = True
    order: int = 0


def _course_velocity(s: Sources) -> tuple[Floats, Floats]:
    return earth_to_vehicle(s.rate("position_x"), s.rate("position_y"), s["heading"])


_POSE = ("position_x", "position_y", "heading")

RELATIONS: tuple[Relation, ...] = (
    Relation("yaw_rate", ("heading",), "rate of the heading", lambda s: s.rate("heading")),
    Relation(
        "lateral_acceleration",
        ("longitudinal_velocity", "lateral_velocity", "yaw_rate"),
        "dv_y/dt + v_x r",
        lambda s: s.rate("lateral_velocity") + s["longitudinal_velocity"] * s["yaw_rate"],
        arm=lambda s: s.rate("yaw_rate"),
    ),
    Relation(
        "longitudinal_acceleration",
        ("longitudinal_velocity", "lateral_velocity", "yaw_rate"),
        "dv_x/dt - v_y r",
        lambda s: s.rate("longitudinal_velocity") - s["lateral_velocity"] * s["yaw_rate"],
        arm=lambda s: -(s["yaw_rate"] ** 2),
    ),
    Relation(
        "longitudinal_velocity", _POSE, "rate of the position along the heading", lambda s: _course_velocity(s)[0]
    ),
    Relation(
        "lateral_velocity",
        _POSE,
        "rate of the position across the heading",
        lambda s: _course_velocity(s)[1],
        arm=lambda s: s.rate("heading"),
        scale=False,  # it is small, and a heading that is off by a degree or two looks like a scale
    ),
    Relation("speed", _POSE, "rate of the position along the heading", lambda s: _course_velocity(s)[0]),
    Relation("speed", ("longitudinal_velocity",), "longitudinal velocity", lambda s: s["longitudinal_velocity"]),
    Relation("yaw_acceleration", ("yaw_rate",), "rate of the yaw rate", lambda s: s.rate("yaw_rate")),
    Relation(
        "sideslip_angle",
        ("longitudinal_velocity", "lateral_velocity"),
        "arctan(v_y / v_x)",
        lambda s: np.arctan2(s["lateral_velocity"], s["longitudinal_velocity"]),
    ),
    Relation(
        "articulation_angle",
        ("yaw_rate_tractor", "yaw_rate_trailer"),
        "its rate from the difference of the yaw rates",
        lambda s: s["yaw_rate_trailer"] - s["yaw_rate_tractor"],
        order=1,
    ),
    *(
        Relation(
            f"lateral_acceleration{body}",
            (speed, f"yaw_rate{body}"),
            "v_x r",
            lambda s, speed=speed, body=body: s[speed] * s[f"yaw_rate{body}"],  # type: ignore[misc]
            exact=False,
        )
        for body, speed in (
            ("", "longitudinal_velocity"),
            ("", "speed"),
            ("_tractor", "speed_tractor"),
            ("_tractor", "speed"),
            ("_trailer", "speed"),
        )
    ),
    *(
        Relation(
            rate,
            (speed, angle),
            f"in proportion to v_x times {angle.replace('_', ' ')}",
            lambda s, speed=speed, angle=angle: s[speed] * s[angle],  # type: ignore[misc]
            exact=False,
            sign_only=True,
        )
        for angle in ("road_wheel_angle", "steering_wheel_angle")
        for rate, speed in (("yaw_rate", "longitudinal_velocity"), ("yaw_rate", "speed"), ("yaw_rate_tractor", "speed"))
    ),
)
"""Every relation; of those with the same signal and formula the first whose signals are recorded counts."""
