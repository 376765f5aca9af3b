r"""An axle whose wheels trail behind their kingpins and turn where the axle goes: part of its slip angle is lost.

Jujnovich and Cebon 2002: a self-steering axle of a trailer generates little lateral force; its steering damper and
return spring leave it the rest. With trail ``t``, damper ``c`` and spring ``k`` the wheels turn by ``phi`` as ``c
dphi/dt + k phi = t C (alpha - phi)``: the share ``t C / (t C + k)`` of the slip angle is lost, behind a lag of ``c / (t
C + k)`` (``_lag.lag`` for short ones).

Equation: $\alpha \to \Big(1-\frac{\sigma_S}{1+T_S s}\Big)\,\alpha$.

Confused with: ``lifted_axle``; a smaller stiffness of that axle, where it has a tyre of its own (exactly the same for
``linear``).
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._lag import lag

PORT = "slip_angle_axle_{axle}"
PLACE = "axle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("swivelled",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("self_steering", r"\sigma_S", "dimensionless", 0.0, 1.0, "share of the slip angle that is lost", 0.0),
    Parameter("self_steering_lag", "T_S", "s", 0.0, 0.5, "time constant of the wheels that turn", grid=(0.05,)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Take the share off the slip angle."""
    turned, rate = lag(value, e.state("swivelled"), e.p("self_steering_lag"))
    e.derivative("swivelled", rate)
    return value - e.p("self_steering") * turned
