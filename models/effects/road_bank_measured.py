r"""A road whose bank is known over time, from a map along the driven path or from a survey: an input of the model.

A recording has to hold it; the road of a simulated drive is flat.

``bank_share`` is 1 where the stated bank acts and 0 where it does not; its estimate says whether the recording shows
that bank at all.

Equation: $\dot v_y = \dots - g\sin(\lambda_B\,\varphi_B(t))$.

Confused with: nothing, if the map was made on other laps. A map made from the same recording explains whatever is
missing there.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

PORT = "lateral_gravity{body}"
READS: tuple[str, ...] = ("bank_angle",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("bank_share", r"\lambda_B", "dimensionless", -2.0, 2.0, "share of the stated bank", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add ``-g sin(lambda_B bank)``."""
    return value - _gravity.GRAVITY * sp.sin(e.p("bank_share") * e.input("bank_angle", otherwise=0.0))
