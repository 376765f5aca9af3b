r"""The steering ratio is not what the parameters say.

Equation: $\delta = \frac{\delta_L/i_L}{1+\varepsilon_L}$.

Confused with: the parameter ``steering_ratio``, ``sensor_gain`` of all yaw rates together, stiffness of the steered
axle at one speed.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "steering_ratio_error", r"\varepsilon_L", "dimensionless", -0.5, 1.0, "true ratio over stated one, less 1", 0.0
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Divide by ``1 + error``."""
    return value / (1 + e.p("steering_ratio_error"))
