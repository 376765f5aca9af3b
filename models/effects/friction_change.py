r"""The road's friction changes at a given time, as when a car drives onto ice; all axles at once.

The rate of the change rises and falls as a raised cosine. It is zero where the change begins and ends, so it does not
matter on which side of these times a sample or a stage of the integrator falls, and a sum over samples gives the
whole change exactly if it lasts a whole number of them, two or more. A vehicle whose friction is a state gets the rate,
one whose friction is a parameter the change itself.

Equation: $\mu(t) = \mu + \Delta\mu\,\Big(\tau - \frac{\sin 2\pi\tau}{2\pi}\Big),$ $\tau =
\frac{t-t_\mu}{T_\mu}\in[0,1]$.

Confused with: ``tyre_stiffness_drift`` and load, as long as the tyres are far from their limit: at small slip the force
does not depend on friction.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.effects._timing import progress

PORT = ("friction_rate", "friction_coefficient")
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

LOWEST_FRICTION = 0.05
"""The road never has less, so that no tyre reverses its force."""

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "friction_change",
        r"\Delta\mu",
        "dimensionless",
        -1.5,
        1.5,
        "change of the friction",
        neutral=0.0,
        natural=(-0.5, 0.5),
    ),
    Parameter("friction_change_time", r"t_\mu", "s", 0.0, 1e4, "when the change begins", per_drive=True),
    Parameter("friction_change_duration", r"T_\mu", "s", 0.02, 1e3, "how long it takes", grid=(0.5,)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Return the friction, or its rate ``change / duration (1 - cos(2 pi (t - begin) / duration))`` in between."""
    begin, duration = e.p("friction_change_time"), e.p("friction_change_duration")
    if e.site.port == "friction_coefficient":
        return larger(value + e.p("friction_change") * progress(e.time, begin, duration), LOWEST_FRICTION)
    during = sp.Heaviside(e.time - begin, 1) * (1 - sp.Heaviside(e.time - begin - duration, 1))
    shape = 1 - sp.cos(2 * sp.pi * (e.time - begin) / duration)
    return value + e.p("friction_change") / duration * shape * during
