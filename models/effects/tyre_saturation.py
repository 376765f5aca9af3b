r"""A tyre modelled as linear saturates: its force bends over to friction times load, as that of the brush tyre does.

Pacejka 2012, 3.2.1, with the linear force ``F`` in place of stiffness times slip and ``q = 1 / mu``: with ``s = q
|F| / (3 F_z)`` the force is ``F (1 - s + s^2 / 3)`` up to ``s = 1`` and ``F_z / q`` beyond. It makes ``linear``
equal ``brush``. A tyre that knows its capacity saturates already.

Equation: $F_y = F\big(1-s+\tfrac13s^2\big),$ $s=\frac{q\,\lvert F\rvert}{3F_z}\le1;$ $F_y=\pm F_z/q \text{ beyond}$.

Confused with: ``lateral_load_transfer`` and ``steering_compliance``, unless the drive nears the limit.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger, smaller
from harness.models.contracts import Parameter

PORT = "steady_lateral_force_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ("vertical_load_axle_{axle}",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("inverse_friction", "q", "dimensionless", 0.0, 20.0, "load over largest lateral force", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Bend the force over."""
    if e.provides(f"lateral_force_capacity_axle_{e.site.axle}"):
        raise e.refuse("its tyre saturates already; free its friction or shape instead")
    s = e.p("inverse_friction") * sp.Abs(value) / (3 * e.at_axle("vertical_load"))
    adhering = smaller(s, 1)
    return value * (1 - adhering + adhering**2 / 3) / larger(s, 1)
