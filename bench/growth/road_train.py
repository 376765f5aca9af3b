"""A tractor with any number of trailers behind it: a model whose number of states is chosen, two for each body.

The tractor is Pacejka's linear single track (2012, 1.3.2). A trailer turns about its hitch: with the distance ``l``
from hitch to axle, yaw inertia ``J`` about the hitch and cornering stiffness ``C``, the moment ``-l C alpha`` of its
tyres gives ``w' = (C l^2 / (J v)) (w_rolling - w)``. With ``w_rolling = (v sin(theta) - h w_ahead cos(theta)) / l`` its
wheels would roll without slip, its hitch ``h`` behind the axle ahead (the general n-trailer of Altafini 2001). What a
trailer does to the body ahead is left out: the equations of a body read those of the one ahead only, as in a chain of
light trailers.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import sympy as sp

from harness.models.assembly.assemble import Model, assemble
from harness.models.contracts import Parameter
from harness.models.signals import Signal

PARAMETERS = (
    Parameter("tractor_mass", "m", "kg", 2e3, 3e4, "mass of the tractor"),
    Parameter("tractor_yaw_inertia", "J_1", "kg*m^2", 2e3, 3e5, "yaw inertia of the tractor"),
    Parameter("stiffness", "C", "N/rad", 1e4, 1e6, "cornering stiffness of each axle"),
    Parameter("wheelbase", "L", "m", 1.0, 8.0, "wheelbase of the tractor, its CoG in the middle"),
    Parameter("hitch", "h", "m", 0.0, 3.0, "hitch behind the axle ahead"),
    Parameter("length", "l", "m", 1.0, 12.0, "hitch to axle of a trailer"),
    Parameter("inertia", "J", "kg*m^2", 2e3, 3e5, "yaw inertia of a trailer about its hitch"),
)
VALUES = {
    "tractor_mass": 8e3, "tractor_yaw_inertia": 2e4, "stiffness": 2e5, "wheelbase": 3.6, "hitch": 0.5, "length": 5.0,
    "inertia": 8e4,
}  # fmt: skip


def road_train(states: int) -> Model:
    """Return a tractor with as many trailers as make that many states.

    Args:
        states: Even, at least 4: lateral velocity and yaw rate of the tractor, angle and yaw rate of each trailer.
    """
    bodies = range(1, states // 2)
    angles, rates = [f"angle_{i}" for i in bodies], [f"rate_{i}" for i in bodies]

    def equations(v: Any) -> None:
        speed, delta = v.input("speed"), v.input("steering_angle")
        m, stiffness, half = v.p("tractor_mass"), v.p("stiffness"), v.p("wheelbase") / 2
        v_y, ahead = v.state("lateral_velocity"), v.state("rate_0")
        front = stiffness * (delta - (v_y + half * ahead) / speed)
        rear = -stiffness * (v_y - half * ahead) / speed
        v.derivative("lateral_velocity", (front + rear) / m - speed * ahead)
        v.derivative("rate_0", half * (front - rear) / v.p("tractor_yaw_inertia"))
        length, hitch = v.p("length"), v.p("hitch")
        for angle, rate in zip(angles, rates, strict=True):
            theta, own = v.state(angle), v.state(rate)
            rolling = (speed * sp.sin(theta) - hitch * ahead * sp.cos(theta)) / length
            v.derivative(angle, ahead - own)
            v.derivative(rate, stiffness * length**2 / (v.p("inertia") * speed) * (rolling - own))
            ahead = own

    names = ("lateral_velocity", "rate_0", *(n for pair in zip(angles, rates, strict=True) for n in pair))
    vehicle, sensors = ModuleType(f"road_train_{states}"), ModuleType("road_train_sensors")
    vehicle.__dict__.update(
        STATES=names,
        INPUTS=("steering_angle", "speed"),
        PARAMETERS=PARAMETERS,
        AXLES={},
        VALID={},
        SIGNALS=tuple(Signal(n, n, "1", "1", "", "a state of the chain") for n in (*names[1:], "steering_angle")),
        equations=equations,
    )
    sensors.__dict__.update(OUTPUTS={"rate_0": "rate_0", "angle_1": "angle_1"})
    return assemble(vehicle, sensors=sensors)
