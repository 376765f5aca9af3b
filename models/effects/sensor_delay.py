r"""A sensor's reading arrives late (second order, ``_lag.delay``).

Its states start at zero: a reading that does not has a transient of a few delays at the start of a drive.

Equation: $y \to e^{-\tau_y s}\,y \text{ (second order)}$.

Confused with: ``steering_delay`` and ``steering_lag``, if all sensors are late alike.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._lag import delay
from harness.models.signals import SIGNALS

PORT = "sensor_{output}"
PLACE = "output"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("delayed", "delayed_rate")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("sensor_delay", r"\tau_y", "s", 0.0, 0.5, "delay of the reading", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the delayed reading."""
    if f"delayed_{e.site.output}" not in SIGNALS:
        raise e.refuse(f"models/signals.py has no state 'delayed_{e.site.output}'")
    first, second = (e.state(name) for name in STATES)
    delayed, first_rate, second_rate = delay(value, first, second, e.p("sensor_delay"))
    e.derivative(STATES[0], first_rate)
    e.derivative(STATES[1], second_rate)
    return delayed
