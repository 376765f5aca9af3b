r"""The steering gear turns the wheels more, or less, at large angles than on centre (variable ratio, joint angles).

``delta (1 + kappa x^2 / (1 + x^2))`` with ``x = delta / delta_c``: cubic on centre, a constant change of the ratio far
from it, and monotonic for every ``kappa`` within bounds.

Equation: $\delta = \delta_0\Big(1+\kappa_L\frac{x^2}{1+x^2}\Big),$ $x=\delta_0/\delta_c$.

Confused with: the shape of the front tyre and ``steering_compliance``: all bend the response at large angles. Slow
tight turns tell them apart.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("steering_progression", r"\kappa_L", "dimensionless", -0.8, 3.0, "gain far from centre, less 1", 0.0),
    Parameter(
        "steering_centre_width",
        r"\delta_c",
        "rad",
        0.005,
        1.0,
        "road-wheel angle at which half of the change is reached",
        grid=(0.02, 0.05, 0.15, 0.4),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the angle through the gear."""
    x = (value / e.p("steering_centre_width")) ** 2
    return value * (1 + e.p("steering_progression") * x / (1 + x))
