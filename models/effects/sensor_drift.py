r"""The bias of a sensor wanders, as that of a gyroscope does with its temperature.

A random walk ``d`` that changes by one standard deviation in ``SPAN`` and is as uncertain when a drive begins; the
reading is off by ``sigma_d d``. The mean of ``d`` is zero, so at the neutral value the likelihood's slope says nothing
and the search starts from the grid.

Equation: $\dot d = w,$ $y \to y + \sigma_d d$.

Confused with: ``sensor_bias`` in short drives, ``road_bank_varying`` where the lateral acceleration alone shows it.
Like that one it is found by a filter that holds it as a state, and lowers no simulation error.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "sensor_{output}"
PLACE = "output"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("drift",)

SPAN = 100.0
"""s; a walk has one number, its variance per second, and this is the time in which it is stated."""

NOISE: dict[str, float] = {"drift": 1.0 / SPAN}
START_VARIANCE: dict[str, float] = {"drift": 1.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "sensor_drift",
        r"\sigma_d",
        "{signal}",
        0.0,
        3.0,
        "standard deviation by which the reading wanders in 100 s",
        0.0,
        grid=(0.003, 0.01, 0.03),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add what has drifted."""
    drift = e.state("drift")
    e.derivative("drift", sp.Integer(0))
    return value + e.p("sensor_drift") * drift
