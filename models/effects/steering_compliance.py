r"""The steered wheels yield to their lateral force (Pacejka 2012, 1.2.2: steer compliance through the pneumatic trail).

They yield at once. Where the tyre's force follows at once from the slip as well, angle and force are solved together
(``models/assembly/algebraic_loops.py``).

Equation: $\delta = \delta_0 - c_L F_{y,\delta}(\delta)$.

Confused with: stiffness and shape of the front tyre: on one axle a compliance *is* a smaller stiffness, but where the
tyre saturates. ``steering_compliance_lag`` has a time in which it yields.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ("lateral_force_steered_axle",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("steering_compliance", "c_L", "rad/N", 0.0, 1e-5, "angle given up per lateral force", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the wheels back by compliance times force."""
    return value - e.solved("steering_yield", e.p("steering_compliance") * e.read("lateral_force_steered_axle"))
