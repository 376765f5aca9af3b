r"""The steered wheels yield to their lateral force (Pacejka 2012, 1.2.2: steer compliance through the pneumatic trail).

The steering yields within ``YIELDING``, so that a tyre whose force follows at once from its slip makes no algebraic
loop.

Equation: $\delta = \delta_0 - c_L F_c,$ $\dot F_c = (F_{y,\delta}-F_c)/30\,\mathrm{ms}$.

Confused with: stiffness and shape of the front tyre: on one axle a compliance *is* a smaller stiffness, but for its
lag.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

YIELDING = 0.03
"""s; time constant of the steering against the tyres' force."""

CONSTANTS: dict[str, str] = {"YIELDING": "s"}

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ("lateral_force_steered_axle",)
STATES: tuple[str, ...] = ("steering_force",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("steering_compliance", "c_L", "rad/N", 0.0, 1e-5, "angle given up per lateral force", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the wheels back by compliance times force."""
    force = e.state("steering_force")
    e.derivative("steering_force", (e.read("lateral_force_steered_axle") - force) / YIELDING)
    return value - e.p("steering_compliance") * force
