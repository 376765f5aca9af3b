r"""Dry friction of the fifth wheel: a yaw moment against the articulation rate, constant in magnitude.

The sign of the rate is smoothed, so stick-slip of the coupling is left out. The rate of the smoothing matters as much
as the magnitude: a coupling that turns slowly most of the time acts on the slope between the signs.

Equation: $M_K = -M_R\tanh(\dot\theta/\omega_R)$.

Confused with: ``kingpin_damping`` unless articulation rates vary; process noise on the articulation.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "coupling_moment"
READS: tuple[str, ...] = ("yaw_rate_tractor", "yaw_rate_trailer")
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("kingpin_friction", "M_R", "N*m", 0.0, 5e4, "largest moment of dry friction", neutral=0.0),
    Parameter(
        "kingpin_friction_rate",
        r"\omega_R",
        "rad/s",
        1e-3,
        0.1,
        "articulation rate at which three quarters of the friction act",
        grid=(0.003, 0.01, 0.03),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Subtract the moment from that on the trailer."""
    rate = e.read("yaw_rate_trailer") - e.read("yaw_rate_tractor")
    return value - e.p("kingpin_friction") * sp.tanh(rate / e.p("kingpin_friction_rate"))
