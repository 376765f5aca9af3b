"""Body roll steers an axle through its suspension: a steer angle in proportion to the lateral acceleration.

Pacejka 2012, 1.2.2. Roll is taken as quasi-steady, so the angle follows yaw rate times speed. Positive steers into the
bend.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "slip_angle_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("roll_steer", r"\varepsilon_R", "rad*s^2/m", -0.02, 0.02, "steer angle per lateral acceleration", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the axle's wheels into the bend."""
    return value + e.p("roll_steer") * e.body.centripetal_acceleration
