"""Roll of a body in bends: the second-order motion of its springs and dampers, for the effects of a body that rolls.

What leans is the lateral acceleration, in m/s^2, as the springs have followed it; what it does (an angle that a sensor
reads, one that steers an axle) is an effect's own parameter times that.

With the mass ``m_s`` at ``h`` above the roll axis, the inertia ``J`` about that axis and the stiffness ``K``, less that
of the weight, the angle is ``m_s h / K`` times what leans. The square of the frequency is ``K / (J - (m_s h)^2 / m)``,
that of the roll about the CoG, because the acceleration of the CoG drives it.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

ROLL_DAMPING = 0.4
"""Damping ratio of the roll where an effect has none of its own."""

CONSTANTS: dict[str, str] = {"ROLL_DAMPING": "1"}

FREQUENCIES = (2.0, 40.0)
"""rad/s; bounds of the frequency of the roll."""

GRID = (4.5, 9.0, 18.0, 36.0)
"""rad/s; octaves: a tall load on soft springs, a truck, a car, a body that hardly leans."""


def roll_frequency(name: str) -> Parameter:
    """Return the frequency of the roll as a parameter of an effect."""
    return Parameter(name, r"\omega_R", "rad/s", *FREQUENCIES, "frequency of the roll", grid=GRID)


def leaning(
    e: EffectContext,
    states: tuple[str, ...],
    frequency: sp.Expr | float,
    damping: sp.Expr | float = ROLL_DAMPING,
    acceleration: str = "lateral_acceleration",
) -> sp.Symbol:
    """Return an acceleration of the site's body as its roll, or its pitch, has followed it.

    Args:
        e: Of the effect.
        states: The effect's two states for it: what leans, and its rate.
        frequency: In rad/s.
        damping: Damping ratio.
        acceleration: The port, by its stem.
    """
    leant, rate = (e.state(name) for name in states)
    e.derivative(states[0], rate)
    e.derivative(states[1], second_derivative(e, states, frequency, damping, acceleration))
    return leant


def second_derivative(
    e: EffectContext,
    states: tuple[str, ...],
    frequency: sp.Expr | float,
    damping: sp.Expr | float,
    acceleration: str = "lateral_acceleration",
) -> sp.Expr:
    """Return the second derivative of what leans, in m/s^4; arguments as of ``leaning``."""
    leant, rate = (e.state(name) for name in states)
    return frequency**2 * (e.at_body(acceleration) - leant) - 2 * damping * frequency * rate
