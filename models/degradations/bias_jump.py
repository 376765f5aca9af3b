r"""The bias of a sensor jumps.

Equation: $y \to y + b$ from the time $t_b$ on.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("bias_jump", "b", "{signal}", -3.0, 3.0, "bias behind the jump", neutral=0.0),
    Parameter("bias_jump_time", "t_b", "s", 0.0, 1e5, "when it jumps", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with the jump."""
    return r.values + np.where(r.samples * r.step >= r.p("bias_jump_time"), r.p("bias_jump"), 0.0)
