r"""Force and moment on a body that no equation holds, as a random process: how wrong a model is anyway.

``b`` is white noise of unit intensity behind a lag, so that ``n = b sqrt(2 / T_u)`` has variance 1 in the long run.
What a model leaves out (rolling bodies, load transfer, the tyres' curvature, crowned roads) acts at the frequencies at
which the vehicle is driven and is larger the harder it corners. So the force is a share of the lateral force ``m
sqrt(a_0^2 + (v r)^2)``, where ``a_0`` is left on a straight road, and the moment that force at a lever. Their means are
zero, so at the neutral value the likelihood's slope says nothing and the search starts from the grid.

Equation: $\dot b_i = -b_i/T_u + w_i,$ $F_y = m\sqrt{a_0^2+(v_x\dot\psi)^2},$ $F = \epsilon_u F_y\sqrt{2/T_u}\,b_1,$
$M = l_u F_y\sqrt{2/T_u}\,b_2$.

Confused with: any effect, of which it takes up a part. A trace has it in every model at once, where the drives need it,
so that sizes and probabilities allow for a model that is not quite right.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

STRAIGHT = 0.3
"""m/s^2; lateral acceleration that a crowned road of 3 % gives without any steering."""

CONSTANTS: dict[str, str] = {"STRAIGHT": "m/s^2"}

PORT = ("external_lateral_force{body}", "external_yaw_moment{body}")
PLACE = "body"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("unmodelled_force_walk", "unmodelled_moment_walk")
NOISE: dict[str, float] = dict.fromkeys(STATES, 1.0)
START_VARIANCE: dict[str, float] = dict.fromkeys(STATES, 0.25)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "unmodelled_force",
        r"\epsilon_u",
        "dimensionless",
        0.0,
        2.0,
        "standard deviation of the force as a share of the lateral force",
        0.0,
        grid=(0.003, 0.01, 0.03),
    ),
    Parameter(
        "unmodelled_lever",
        "l_u",
        "m",
        0.0,
        5.0,
        "standard deviation of the lever at which the lateral force acts",
        0.0,
        grid=(0.003, 0.01, 0.03),
    ),
    Parameter("unmodelled_memory", "T_u", "s", 0.05, 10.0, "correlation time", grid=(0.5,), shared=True),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the force or the moment."""
    force = e.site.port.startswith("external_lateral_force")
    name, state = ("unmodelled_force", STATES[0]) if force else ("unmodelled_lever", STATES[1])
    walk, memory = e.state(state), e.p("unmodelled_memory")
    e.derivative(state, -walk / memory)
    acceleration = sp.sqrt(STRAIGHT**2 + e.body.centripetal_acceleration**2)
    return value + e.p(name) * e.mass * acceleration * sp.sqrt(2.0 / memory) * walk
