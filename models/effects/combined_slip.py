r"""Drive and brake force of an axle reduce its lateral force (friction ellipse; Pacejka 2012, ch. 4).

An axle with the share ``lambda`` of the whole force ``F_x`` keeps ``sqrt(1 - (lambda F_x / mu F_z)^2)`` of its
lateral force. Here it keeps ``1 / sqrt(1 + q (F_x / F_z)^2)`` with ``q = (lambda / mu)^2``, the same for moderate
use, but with a slope at ``q = 0`` and no end at full use. Brakes act on all axles and the engine on some, so driving
and braking each have a ``q``. ``F_x`` is mass times the acceleration of the speed
behind ``SETTLING``, which keeps the noise of a measured speed out, less gravity on a grade; resistances are left
out.

Equation: $F_{0y} \to \frac{F_{0y}}{\sqrt{1+q(F_x/F_z)^2}},$ $F_x=\textstyle\sum m\,(a_x-g_x)$.

Confused with: ``longitudinal_load_transfer``; a bias of the speed's derivative.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter

SETTLING = 0.15
"""s; time constant of the acceleration."""

CONSTANTS: dict[str, str] = {"SETTLING": "s"}

PORT = "steady_lateral_force_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ("vertical_load_axle_{axle}", "longitudinal_gravity{leader}")
STATES: tuple[str, ...] = ("drive_speed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "combined_slip_driving",
        "q_D",
        "dimensionless",
        0.0,
        10.0,
        "square of the share of a driving force over friction",
        neutral=0.0,
    ),
    Parameter(
        "combined_slip_braking",
        "q_B",
        "dimensionless",
        0.0,
        10.0,
        "square of the share of a braking force over friction",
        neutral=0.0,
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Reduce the lateral force by what the longitudinal one uses."""
    if e.provides("driving_force"):
        raise e.refuse("it computes drive and brake forces and what they take already")
    leader = e.leader
    settled = e.state("drive_speed", shared=True, start="speed")
    acceleration = (leader.speed - settled) / SETTLING
    e.derivative("drive_speed", acceleration, shared=True)
    force = e.total_mass * (acceleration - e.at_leader("longitudinal_gravity"))
    driving = larger(force, sp.Integer(0))
    used = e.p("combined_slip_driving") * driving**2 + e.p("combined_slip_braking") * (force - driving) ** 2
    return value / sp.sqrt(1 + used / e.at_axle("vertical_load") ** 2)
