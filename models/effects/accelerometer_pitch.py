r"""A longitudinal accelerometer pitches with its body and measures part of gravity.

The body pitches by ``k`` times its longitudinal acceleration, behind the second-order motion of its springs and
dampers: its nose rises when it is driven and dives when it brakes. The reading is ``a cos(theta) + g sin(theta)``. The
load that moves with it is ``longitudinal_load_transfer``.

Equation: $y \to a_x\cos\theta+g\sin\theta,$ $\theta=k_P a_P,$ $\ddot a_P=\omega_P^2(a_x-a_P)-0.8\,\omega_P\dot a_P$.

Confused with: ``sensor_gain`` of the accelerometer, in drives slower than the pitch; ``road_grade`` in a single stop.
$\omega_P$ has no slope while $k_P$ is zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _body_roll, _gravity

PORT = "sensor_longitudinal_acceleration{body}"
PLACE = "body"
READS: tuple[str, ...] = ("longitudinal_acceleration{body}",)
STATES: tuple[str, ...] = ("leaning_longitudinal_acceleration", "leaning_rate_longitudinal_acceleration")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("pitch_gain", "k_P", "rad*s^2/m", 0.0, 0.03, "pitch angle per acceleration, nose up", neutral=0.0),
    Parameter(
        "pitch_frequency", r"\omega_P", "rad/s", *_body_roll.FREQUENCIES, "frequency of the pitch", grid=_body_roll.GRID
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the part of gravity that the sensor measures."""
    pitch = e.p("pitch_gain") * _body_roll.leaning(
        e, STATES, e.p("pitch_frequency"), acceleration="longitudinal_acceleration"
    )
    return value * sp.cos(pitch) + _gravity.GRAVITY * sp.sin(pitch)
