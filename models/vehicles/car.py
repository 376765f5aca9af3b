"""Single-track car at a measured speed, with a reference point for the lateral velocity (Pacejka 2012, 1.3.1).

The belief for recordings of a car: steering and speed are inputs, yaw rate, lateral acceleration and lateral
velocity are what is measured. Satellite navigation gives the velocity of its own reference point,
``reference_from_cog`` ahead of the centre of gravity: ``v_yR = v_y + x_R w``. With the tyre ``linear`` it is the
textbook's bicycle model, with ``magic_formula`` or ``brush`` its tyres saturate. The bounds take scale models as
well.

The speed is that of the body's x axis, the same at the reference point and at the CoG. Recordings that state
road-wheel angles have a steering ratio of 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.models.contracts import Parameter
from harness.models.vehicles._single_track import LOWEST_SPEED, single_track

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

STATES: tuple[str, ...] = ("lateral_velocity", "yaw_rate")
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")
AXLES: dict[str, str] = {"front": "front", "rear": "rear"}
USUAL: dict[str, str] = {"parameters": "govindarajan_2018", "sensors": "car_series"}
VALID: dict[str, float] = {"lateral_velocity": 30.0, "yaw_rate": 10.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("mass", "m", "kg", 0.5, 5e3, "mass of the car"),
    Parameter("yaw_inertia", "J", "kg*m^2", 1e-3, 2e4, "yaw inertia"),
    Parameter("cog_to_front_axle", "l_f", "m", 0.02, 4.0, "CoG to the front axle"),
    Parameter("cog_to_rear_axle", "l_r", "m", 0.02, 4.0, "CoG to the rear axle"),
    Parameter("friction", r"\mu", "dimensionless", 0.05, 2.0, "largest friction of the tyres", natural=(0.3, 0.6)),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 0.5, 40.0, "steering wheel over road wheel angle"),
    Parameter("reference_from_cog", "x_R", "m", -4.0, 4.0, "reference point of the lateral velocity ahead of the CoG"),
    LOWEST_SPEED,
)


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives)."""
    return values["cog_to_front_axle"] + values["cog_to_rear_axle"]


def equations(v: Builder) -> None:
    """State the differential equations and the lateral velocity of the reference point."""
    single_track(v, v.port("friction_coefficient", v.p("friction")))
    moved = v.state("lateral_velocity") + v.p("reference_from_cog") * v.state("yaw_rate")
    v.port("lateral_velocity_reference", moved)
