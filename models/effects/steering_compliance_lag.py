r"""The steered wheels yield to their lateral force behind a lag, as a damped or an assisted steering does.

Equation: $\delta = \delta_0 - c_T F_c,$ $\dot F_c = (F_{y,\delta}-F_c)/T_c$.

Confused with: ``steering_compliance``, its limit at $T_c=0$, unless the driver steers at frequencies near $1/T_c$;
``tyre_relaxation`` of the steered axle. $T_c$ has no slope while $c_T$ is zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ("lateral_force_steered_axle",)
STATES: tuple[str, ...] = ("steering_force",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("lagged_compliance", "c_T", "rad/N", 0.0, 1e-5, "angle given up in the end per lateral force", 0.0),
    Parameter("compliance_lag", "T_c", "s", 0.02, 0.5, "time constant of the yielding", grid=(0.03, 0.1)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the wheels back by compliance times the force that the steering has followed."""
    force = e.state("steering_force")
    e.derivative("steering_force", (e.read("lateral_force_steered_axle") - force) / e.p("compliance_lag"))
    return value - e.p("lagged_compliance") * force
