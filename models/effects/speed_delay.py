r"""The vehicle has its recorded speed a fixed time later (second order, ``_lag.delay``).

A channel that recorded the speed late, as one that comes over a bus from the brakes, is a negative delay.

Equation: $v_x \to e^{-\tau_v s}\,v_x \text{ (second order)}$.

Confused with: ``longitudinal_load_transfer``, which also grows with the acceleration, in calm drives.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._lag import delay

PORT = "speed_over_ground"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("speed_delayed", "speed_delayed_rate")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("speed_delay", r"\tau_v", "s", -0.1, 0.5, "delay; negative if recorded late", 0.0, late="speed"),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the delayed speed."""
    first, second = e.state("speed_delayed", start="speed"), e.state("speed_delayed_rate")
    delayed, first_rate, second_rate = delay(value, first, second, e.p("speed_delay"))
    e.derivative(STATES[0], first_rate)
    e.derivative(STATES[1], second_rate)
    return delayed
