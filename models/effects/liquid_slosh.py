r"""Part of a body's mass is liquid that swings from side to side, as a pendulum at the CoG (Ranganathan et al. 1993).

The liquid's share of the mass does not move with the body; spring and damper of the pendulum hand its force over.
In a steady bend it leans on the wall and weighs as if it were solid; in a quick one it stays behind. What it does
to roll and loads is left out.

Equation: $(1-\mu_s)\,m\,a_y = Y + \mu_s m\,p,$ $\ddot y_s = -a_y - p,$ $p=\omega_s^2y_s+2\zeta_s\omega_s\dot y_s$.

Confused with: yaw inertia and mass at frequencies well above $\omega_s$. Frequency and damping have no slope while the
share is zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = ("inertial_mass{body}", "external_lateral_force{body}")
PLACE = "body"
READS: tuple[str, ...] = ("lateral_acceleration{body}", "inertial_mass{body}")
STATES: tuple[str, ...] = ("slosh_displacement", "slosh_velocity")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("slosh_share", r"\mu_s", "dimensionless", 0.0, 0.9, "share of the body's mass that sloshes", 0.0),
    Parameter(
        "slosh_frequency", r"\omega_s", "rad/s", 0.5, 20.0, "frequency of the liquid", grid=(2.0, 2.8, 4.0, 5.6, 8.0)
    ),
    Parameter("slosh_damping", r"\zeta_s", "dimensionless", 0.005, 1.0, "damping ratio of the liquid", grid=(0.05,)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Take the liquid off the rigid mass, or add its force."""
    share, omega, zeta = e.p("slosh_share"), e.p("slosh_frequency"), e.p("slosh_damping")
    if e.site.port.startswith("inertial_mass"):
        return value * (1 - share)
    y, y_dot = e.state("slosh_displacement"), e.state("slosh_velocity")
    pull = omega**2 * y + 2 * zeta * omega * y_dot
    e.derivative("slosh_displacement", y_dot)
    e.derivative("slosh_velocity", -pull - e.at_body("lateral_acceleration"))
    liquid = share / (1 - share) * e.at_body("inertial_mass")
    return value + liquid * pull
