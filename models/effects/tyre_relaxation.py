r"""A tyre's lateral force builds up over a distance rolled (Pacejka 2012, 7.1; Ziaukas 2023, 4.7).

It is for vehicles whose tyre force follows at once from the slip. A vehicle that has relaxing forces as states has
their lengths as parameters, and this effect does not fit it.

Equation: $F_y = \frac{1+(B-T)s}{1+Bs}F_{0y},$ $T=\ell_R/v_x$.

Confused with: ``steering_lag`` for the steered axle.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.effects._lag import lag

SLOWEST = 0.3
"""m/s; the tyre rolls at least this fast, so that its lag stays finite."""

CONSTANTS: dict[str, str] = {"SLOWEST": "m/s"}

PORT = "steady_lateral_force_axle_{axle}"
PLACE = "axle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("relaxed_force_axle",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("tyre_relaxation", r"\ell_R", "m", 0.0, 3.0, "relaxation length", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the force behind a lag of relaxation length over speed."""
    if e.provides(f"lateral_force_axle_{e.site.axle}"):
        raise e.refuse("its tyre forces relax already; free their relaxation lengths instead")
    time_constant = e.p("tyre_relaxation") / larger(e.body.speed, SLOWEST)
    relaxed, rate = lag(value, e.state("relaxed_force_axle"), time_constant)
    e.derivative("relaxed_force_axle", rate)
    return relaxed
