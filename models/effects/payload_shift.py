r"""Load slides forward or back at a given time and moves the CoG of the body that carries it.

Loads and lever arms follow the CoG while it moves, and the lateral velocity stays that of the CoG; what the sliding
itself does to it (Coriolis, yaw inertia) is left out. ``SLIDING`` is how long it takes.

Equation: $x_\mathrm{CoG} \to x_\mathrm{CoG} + \Delta x\,\Big(\tau-\frac{\sin2\pi\tau}{2\pi}\Big),$
$\tau=\frac{t-t_L}{1\,\mathrm{s}}$.

Confused with: ``friction_change`` and ``tyre_stiffness_drift`` of the trailer: all change the understeer at some time
or gradually.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._timing import progress

SLIDING = 1.0
"""s; duration of the shift."""

CONSTANTS: dict[str, str] = {"SLIDING": "s"}

STAYS = True
PORT = "cog_shift{body}"
PLACE = "body"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("payload_shift", r"\Delta x", "m", -3.0, 3.0, "shift of the body's CoG, forward positive", neutral=0.0),
    Parameter("payload_shift_time", "t_L", "s", 0.0, 1e5, "when the load begins to slide", shared=True, per_drive=True),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Move the CoG."""
    return value + e.p("payload_shift") * progress(e.time, e.p("payload_shift_time"), SLIDING)
