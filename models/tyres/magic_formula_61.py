"""Magic Formula 6.1 tyre, pure lateral slip with load, camber and pressure (Pacejka 2012, 4.E19 to 4.E30).

PAC2002 and MF 5.2 are the same equations with ``pky4 = 2``, ``pky6 = pvy3``, ``pky7 = pvy4`` and a camber shift
``phy3``. The coefficients are those of one tyre under its own names, scaling factors included, for a slip angle that
makes a force to its own side; ``harness new parameters --tyre front.tir`` takes them from a property file. An axle
with n tyres has n times the force of one at 1/n of the load. Its tyres mirror each other, so what a single one has
without slip and camber (``PHY1``, ``PHY2``, ``PVY1``, ``PVY2``, ``PEY3``) is left out. The friction of the road is a
factor on the tyre's own (``LMUY``).
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import TyreContext
from harness.models.assembly.expressions import smaller
from harness.models.contracts import Parameter


def _number(name: str, symbol: str, lower: float, upper: float, meaning: str) -> Parameter:
    return Parameter(name, symbol, "dimensionless", lower, upper, meaning)


PARAMETERS: tuple[Parameter, ...] = (
    Parameter("tyres", "n", "dimensionless", 1.0, 8.0, "tyres of an axle: 2, twin tyres 4, a wheel 1", numerical=True),
    Parameter("nominal_load", "F_{z0}", "N", 1.0, 1e6, "nominal load of a tyre times LFZO", numerical=True),
    Parameter("nominal_pressure", "p_{i0}", "Pa", 1e4, 2e6, "nominal inflation pressure", numerical=True),
    Parameter("tangent", "t", "dimensionless", 0.0, 1.0, "1: slip is tan(alpha) (6.1); 0: alpha (5.2)", numerical=True),
    Parameter("pressure", "p_i", "Pa", 1e4, 2e6, "inflation pressure"),
    _number("pcy1", "p_{Cy1}", 0.1, 4.0, "shape factor"),
    _number("pdy1", "p_{Dy1}", 0.01, 5.0, "friction at nominal load"),
    _number("pdy2", "p_{Dy2}", -2.0, 2.0, "change of the friction with load"),
    _number("pdy3", "p_{Dy3}", -100.0, 100.0, "change of the friction with camber squared"),
    _number("pey1", "p_{Ey1}", -100.0, 100.0, "curvature at nominal load"),
    _number("pey2", "p_{Ey2}", -100.0, 100.0, "change of the curvature with load"),
    _number("pey4", "p_{Ey4}", -1e5, 1e5, "change of the curvature with camber and the side of the slip"),
    _number("pey5", "p_{Ey5}", -1e5, 1e5, "change of the curvature with camber squared"),
    Parameter("pky1", "p_{Ky1}", "1/rad", 0.1, 500.0, "largest cornering stiffness over nominal load"),
    _number("pky2", "p_{Ky2}", 0.05, 50.0, "load of the largest stiffness over nominal load"),
    _number("pky3", "p_{Ky3}", -20.0, 20.0, "change of the stiffness with camber"),
    _number("pky4", "p_{Ky4}", 0.1, 10.0, "curvature of the stiffness over load"),
    _number("pky5", "p_{Ky5}", -100.0, 100.0, "change of the load of the largest stiffness with camber squared"),
    _number("pky6", "p_{Ky6}", -50.0, 50.0, "camber stiffness over load"),
    _number("pky7", "p_{Ky7}", -50.0, 50.0, "change of the camber stiffness with load"),
    _number("phy3", "p_{Hy3}", -5.0, 5.0, "slip angle that one camber angle adds (5.2)"),
    _number("pvy3", "p_{Vy3}", -20.0, 20.0, "vertical shift over load by camber"),
    _number("pvy4", "p_{Vy4}", -20.0, 20.0, "change of it with load"),
    *(
        _number(f"ppy{i}", f"p_{{py{i}}}", -20.0, 20.0, f"change of {what} with pressure")
        for i, what in enumerate(
            ("the stiffness", "its load", "the friction", "the friction, squared,", "the camber stiffness"), 1
        )
    ),
)

STIFFNESS = "pky1"


def lateral_force(t: TyreContext) -> sp.Expr:
    """Return the steady lateral force ``n (D sin(C atan(B a - E (B a - atan(B a)))) + S_Vg)`` in N (4.E19)."""
    p, camber = t.p, t.inclination
    load = t.vertical_load / p("tyres")
    df, dp = load / p("nominal_load") - 1, p("pressure") / p("nominal_pressure") - 1  # (4.E2a, b)
    friction = (p("pdy1") + p("pdy2") * df) * (1 + p("ppy3") * dp + p("ppy4") * dp**2) * (1 - p("pdy3") * camber**2)
    capacity = t.port("lateral_force_capacity", t.friction * friction * t.vertical_load)  # n D (4.E22, 23)
    peak = (p("pky2") + p("pky5") * camber**2) * (1 + p("ppy2") * dp)
    over_load = sp.sin(p("pky4") * sp.atan(load / (p("nominal_load") * peak)))
    largest = p("tyres") * p("pky1") * p("nominal_load") * (1 + p("ppy1") * dp) * (1 - p("pky3") * sp.Abs(camber))
    slope = t.port("cornering_stiffness", largest * over_load)  # n K (4.E25)
    lifted = t.vertical_load * (p("pvy3") + p("pvy4") * df) * camber  # n S_Vg (4.E28), on any road
    camber_stiffness = t.vertical_load * (p("pky6") + p("pky7") * df) * (1 + p("ppy5") * dp)  # n K_g (4.E30)
    shift = p("phy3") * camber + (camber_stiffness * camber - lifted) / slope
    angle = t.slip_angle
    a = angle + p("tangent") * (sp.tan(angle) - angle) + shift  # (4.E20)
    b = slope / (p("pcy1") * capacity) * a
    curvature = (p("pey1") + p("pey2") * df) * (1 + p("pey5") * camber**2 - p("pey4") * camber * sp.sign(a))  # (4.E24)
    bent = b - smaller(curvature, 1) * (b - sp.atan(b))
    return capacity * sp.sin(p("pcy1") * sp.atan(bent)) + lifted
