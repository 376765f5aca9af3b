r"""A sensor is turned about the vertical axis and reads a part of what lies across its stated direction.

Turned to the left by ``eps``, a lateral one reads ``cos(eps)`` of its own direction less ``sin(eps)`` of the
longitudinal one, and a longitudinal one the other way round. A degree of a sensor of the lateral velocity is 0.3 m/s
at 20 m/s; a degree of an accelerometer matters where the vehicle brakes. The longitudinal acceleration is that of the
speed behind ``SETTLING``.

Equation: $v_y \to v_y\cos\varepsilon_y-v_x\sin\varepsilon_y,$ $a_y \to a_y\cos\varepsilon_y-\tilde
a_x\sin\varepsilon_y,$ $a_x \to a_x\cos\varepsilon_y+a_y\sin\varepsilon_y$.

Confused with: ``sensor_bias``, for a lateral velocity in drives at one speed; nothing that an accelerometer reads while
the vehicle neither brakes nor drives.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _acceleration

SETTLING = 0.05
"""s; time constant of the speed's derivative, as short as a recorded speed's noise lets it be."""

CONSTANTS: dict[str, str] = {"SETTLING": "s"}

PORT = (
    "sensor_lateral_acceleration{body}",
    "sensor_longitudinal_acceleration{body}",
    "sensor_lateral_velocity{body}",
    "sensor_lateral_velocity_rear",
)
PLACE = "output"
READS: tuple[str, ...] = ("longitudinal_gravity{body}", "lateral_acceleration{body}")
STATES: tuple[str, ...] = ("misaligned_speed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("sensor_misalignment", r"\varepsilon_y", "rad", -0.2, 0.2, "sensor turned to the left", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the reading."""
    angle, output = e.p("sensor_misalignment"), e.site.output
    if output.startswith("longitudinal_acceleration"):
        return value * sp.cos(angle) + e.at_body("lateral_acceleration") * sp.sin(angle)
    is_acceleration = output.startswith("lateral_acceleration")
    across = _acceleration.behind(e, "misaligned_speed", SETTLING) if is_acceleration else e.body.speed
    return value * sp.cos(angle) - across * sp.sin(angle)
