"""Car whose largest tyre-road friction is a state, for estimating it from series sensors (Lex 2015, ch. 5).

Lateral velocity of the CoG and yaw rate of a single-track car on a tyre that knows its limit (``brush`` or
``magic_formula``), and the friction coefficient as a random walk: its equation says that it stays as it is, its
process noise how fast it may change. The measured speed is an input.

Friction shows in the lateral force only where a tyre is near its limit. At small slip the force is stiffness times
slip, whatever the friction, so yaw rate and lateral acceleration say nothing about it; no filter can.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.vehicles._single_track import LOWEST_SPEED, single_track

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

LOWEST_FRICTION = 0.05
"""The tyres get at least this friction, so that a random walk below zero does not reverse their force."""

STATES: tuple[str, ...] = ("lateral_velocity", "yaw_rate", "friction_coefficient")
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")
AXLES: dict[str, str] = {"front": "front", "rear": "rear"}
USUAL: dict[str, str] = {"parameters": "lex_2015", "sensors": "car_series"}
START: dict[str, float | str] = {"friction_coefficient": "friction"}
VALID: dict[str, float] = {"lateral_velocity": 30.0, "yaw_rate": 5.0, "friction_coefficient": 5.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("mass", "m", "kg", 3e2, 5e3, "mass of the car"),
    Parameter("yaw_inertia", "J", "kg*m^2", 1e2, 2e4, "yaw inertia"),
    Parameter("cog_to_front_axle", "l_f", "m", 0.3, 4.0, "CoG to the front axle"),
    Parameter("cog_to_rear_axle", "l_r", "m", 0.3, 4.0, "CoG to the rear axle"),
    Parameter("friction", r"\mu_0", "dimensionless", 0.05, 1.5, "largest friction at the start"),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 1.0, 40.0, "steering wheel over road wheel angle"),
    LOWEST_SPEED,
)


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives)."""
    return values["cog_to_front_axle"] + values["cog_to_rear_axle"]


def equations(v: Builder) -> None:
    """State the differential equations of the single-track car and the random walk of the friction."""
    single_track(v, larger(v.state("friction_coefficient"), LOWEST_FRICTION))
    v.derivative("friction_coefficient", v.port("friction_rate", 0))
