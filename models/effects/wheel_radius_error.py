r"""The recorded speed counts turns of a wheel whose rolling radius is not what was assumed: it is too large by a share.

A worn or laden tyre rolls less per turn, so the recorded speed is too large. Everything that moves with the vehicle
then happens at the true, lower speed.

Equation: $v_x \to \frac{v_x}{1+\varepsilon_r},$ $\dot v_x \to \frac{\dot v_x}{1+\varepsilon_r}$.

Confused with: ``sensor_gain`` of yaw rate or lateral acceleration, because speed times yaw rate is the acceleration;
position along the path, or a speed over ground, tells them apart (``harness check``; ``harness trace`` where positions
are recorded).
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = ("speed_over_ground", "speed_over_ground_rate")
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "wheel_radius_error", r"\varepsilon_r", "dimensionless", -0.2, 0.2, "recorded speed over true one, less 1", 0.0
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Divide by ``1 + error``."""
    return value / (1 + e.p("wheel_radius_error"))
