r"""Play in the steering: on every reversal the wheels wait until the play is crossed.

The middle of the play, a state, stays where it is while the steering moves within the play and is pushed along
beyond it (the play operator of Visintin 1994, with ``PUSHING`` as its time constant). The wheels stand at the angle
less half the play times where in the play the steering is, from -1 to 1. Below ``NARROWEST`` the play stays as wide,
so that the slope at no play exists.

Equation: $\delta = \delta_0 - b_L\,\sigma(x),$ $x=\frac{\delta_0-\delta_b}{\beta},$
$\dot\delta_b=\frac{\beta\,(x-\sigma(x))}{10\,\mathrm{ms}},$ $\sigma=\max(-1,\min(1,x)),$
$\beta=\sqrt{b_L^2+(0.2\,\mathrm{mrad})^2}$.

Confused with: ``steering_lag`` in quick steering and ``steering_offset`` in one-sided drives. The slope at zero is that
of a very narrow play; ``grid`` has wider ones to start from.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger, smaller
from harness.models.contracts import Parameter

PUSHING = 0.01
"""s; time in which the play follows the steering that pushes it."""

NARROWEST = 0.0002
"""rad; the play that the state crosses is never narrower."""

CONSTANTS: dict[str, str] = {"PUSHING": "s"}

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("steering_followed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "steering_backlash",
        "b_L",
        "rad",
        0.0,
        0.05,
        "half the play, at the road wheels",
        neutral=0.0,
        grid=(0.001, 0.003, 0.01),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the angle less the play."""
    half, followed = e.p("steering_backlash"), e.state("steering_followed")
    edge = sp.sqrt(half**2 + NARROWEST**2)
    x = (value - followed) / edge
    within = larger(-1, smaller(1, x))
    e.derivative("steering_followed", edge * (x - within) / PUSHING)
    return value - half * within
