r"""A road whose bank changes along the way, as a Gauss-Markov process that an estimator can follow.

``b`` is white noise of unit intensity behind a lag, ``db/dt = -b / T + w``, and the bank is ``sigma_B b``: its standard
deviation is ``sigma_B sqrt(T / 2)``. The mean of ``b`` is zero, so at the neutral value the likelihood's slope says
nothing and the search starts from the grid.

Equation: $\dot b = -b/T_B + w,$ $\dot v_y = \dots - g\sin(\sigma_B b)$.

Confused with: a gust, and any slow lateral disturbance: it takes up all of them. The mean of $b$ is zero, so the score
at $\sigma_B=0$ has no mean to see; start from the grid.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

PORT = "lateral_gravity{body}"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ("bank_walk",)
NOISE: dict[str, float] = {"bank_walk": 1.0}
START_VARIANCE: dict[str, float] = {"bank_walk": 1.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "bank_wander",
        r"\sigma_B",
        "rad/s**0.5",
        0.0,
        0.3,
        "intensity of the noise that drives the bank",
        0.0,
        grid=(0.003, 0.01, 0.03),
    ),
    Parameter("bank_memory", "T_B", "s", 0.2, 1e3, "correlation time of the bank", grid=(2.0, 10.0)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add ``-g sin(sigma_B b)``; all bodies stand on the same road."""
    walk = e.state("bank_walk", shared=True)
    e.derivative("bank_walk", -walk / e.p("bank_memory"), shared=True)
    return value - _gravity.GRAVITY * sp.sin(e.p("bank_wander") * walk)
