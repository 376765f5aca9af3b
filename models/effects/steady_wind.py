r"""A wind that blows steadily over ground: a vehicle that turns meets it from changing sides.

Side force and yaw moment of the air are ``rho A v_r^2 / 2`` times coefficients that rise with the angle ``beta_r`` of
the airflow (Mitschke and Wallentowitz 2014). While the wind is slow against the speed, ``v_r^2 beta_r = v w`` with the
wind ``w`` across the body, so that both are proportional to speed and wind. The heading tells ``w`` from the wind over
ground, along the axes from which the heading is counted; a recording has to hold it, and a trailer adds the
articulation angle. The force acts ahead of the CoG, as on any body that is longer than it is wide.

Equation: $F = v\,(b_y\cos\psi_W - b_x\sin\psi_W),$ $M = l_W F$.

Confused with: ``steering_offset`` as long as the road does not turn, ``road_bank_varying`` where it does. Drives of one
day share a wind; those of another day have their own.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = ("external_lateral_force{body}", "external_yaw_moment{body}")
PLACE = "body"
READS: tuple[str, ...] = ("heading", "articulation_angle")
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("wind_force_x", "b_x", "N*s/m", -500.0, 500.0, "side force over speed, of the wind towards +x", 0.0),
    Parameter("wind_force_y", "b_y", "N*s/m", -500.0, 500.0, "side force over speed, of the wind towards +y", 0.0),
    Parameter("wind_ahead", "l_W", "m", 0.0, 5.0, "how far ahead of the CoG it acts", grid=(0.5, 2.0)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add force or moment of the wind that blows across the body."""
    heading: sp.Expr = e.input("heading")
    if e.body is not e.leader:
        heading += e.read("articulation_angle")
    force = e.body.speed * (e.p("wind_force_y") * sp.cos(heading) - e.p("wind_force_x") * sp.sin(heading))
    return value + (force if e.site.port.startswith("external_lateral_force") else e.p("wind_ahead") * force)
