r"""The road wheels follow the steering wheel behind a first-order lag (``_lag.lag`` for short time constants).

Equation: $\delta = \frac{1+(B-T_\delta)s}{1+Bs}\,\delta_0,$ $B=\sqrt{T_\delta^2+(10\,\mathrm{ms})^2}$.

Confused with: ``steering_delay``, the relaxation length of the steered axle, and discretisation error: integrate
finely.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._lag import lag

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("steering_lagged",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("steering_lag", r"T_\delta", "s", 0.0, 1.0, "time constant of the steering", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the angle behind the lag."""
    lagged, rate = lag(value, e.state("steering_lagged"), e.p("steering_lag"))
    e.derivative("steering_lagged", rate)
    return lagged
