r"""The road wheels turn a fixed time after the steering wheel (second order, ``_lag.delay``).

A channel that recorded the steering wheel late is a negative delay: the vehicle then seems to turn before its driver.

Equation: $\delta =
\frac{1+(\tfrac12-\rho)p+(\tfrac1{12}-\tfrac\rho2+\tfrac{\rho^2}2)p^2}{1+\tfrac12p+\tfrac1{12}p^2}\,\delta_0,$ $p=Bs,\
\rho=\tau_\delta/B,\ B=\sqrt{\tau_\delta^2+(50\,\mathrm{ms})^2}$.

Confused with: ``steering_lag`` (equal to first order; only fast steering tells them apart), and an equal delay of all
sensors with the sign reversed.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._lag import delay

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("steering_delayed", "steering_delayed_rate")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "steering_delay",
        r"\tau_\delta",
        "s",
        -0.1,
        0.5,
        "delay; negative if recorded late",
        0.0,
        late="steering_wheel_angle",
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the delayed angle."""
    first, second = (e.state(name) for name in STATES)
    delayed, first_rate, second_rate = delay(value, first, second, e.p("steering_delay"))
    e.derivative(STATES[0], first_rate)
    e.derivative(STATES[1], second_rate)
    return delayed
