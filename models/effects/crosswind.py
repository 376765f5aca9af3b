r"""A gust from the side: a lateral force and a yaw moment on each body, from an onset to an end.

Mitschke and Wallentowitz 2014: the wind's force acts ahead of the CoG, so force and moment are separate. Both
rise and fall within ``EDGE``. Positive pushes to the left.

Equation: $F = F_W\,w(t),\ M = M_W\,w(t)$.

Confused with: ``road_bank_varying``; force on one body with moment on the other, if only yaw rates are measured. The
times $t_1,t_2$ have no slope while force and moment are zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects._timing import progress

EDGE = 0.2
"""s; time in which the gust rises and falls."""

CONSTANTS: dict[str, str] = {"EDGE": "s"}

PORT = ("external_lateral_force{body}", "external_yaw_moment{body}")
PLACE = "body"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("crosswind_force", "F_W", "N", -5e4, 5e4, "lateral force of the gust, left positive", neutral=0.0),
    Parameter("crosswind_moment", "M_W", "N*m", -2e5, 2e5, "yaw moment of the gust about the CoG", neutral=0.0),
    Parameter("crosswind_onset", "t_1", "s", 0.0, 1e5, "when the gust begins", shared=True, per_drive=True),
    Parameter("crosswind_end", "t_2", "s", 0.0, 1e5, "when the gust begins to fade", shared=True, per_drive=True),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the force or the moment while the gust lasts."""
    blowing = progress(e.time, e.p("crosswind_onset"), EDGE) - progress(e.time, e.p("crosswind_end"), EDGE)
    part = "crosswind_force" if e.site.port.startswith("external_lateral_force") else "crosswind_moment"
    return value + e.p(part) * blowing
