"""Longitudinal acceleration of vehicles whose speed is an input, for effects: that of the speed behind a lag.

The lag keeps the noise of a measured speed out of what is made of it.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext


def behind(e: EffectContext, state: str, time: float) -> sp.Expr:
    """Return the acceleration that the road and the air give a body, without what a grade adds, in m/s^2.

    Args:
        e: Of the effect; it reads ``longitudinal_gravity{body}``.
        state: The effect's state for it: the speed as it has followed.
        time: Time constant of the lag in s.
    """
    followed = e.state(state, start="speed")
    acceleration = (e.body.speed - followed) / time
    e.derivative(state, acceleration)
    return acceleration - e.at_body("longitudinal_gravity")
