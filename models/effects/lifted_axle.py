r"""An axle of a bogie is lifted, or carries less than the others: they take its load, and the bogie's middle moves.

Loads still add up to the weight and balance it, because the vehicle computes them from the axles' shares.

Equation: $F_{z2j} = \frac{s_j}{\sum s}\,F_{z2},$ $s_j = 1-\lambda_{H,j}$.

Confused with: ``self_steering_axle`` of the same axle.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "load_share_axle_{axle}"
PLACE = "axle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "axle_lift",
        r"\lambda_H",
        "dimensionless",
        -0.5,
        0.995,
        "how much less than the other axles of the bogie it carries",
        0.0,
        natural=(0.5, 0.99),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Reduce the axle's share of the load."""
    return value * (1 - e.p("axle_lift"))
