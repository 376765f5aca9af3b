r"""A sensor dies: it gives no more readings, or its last one for ever.

Equation: from the time $t_f$ on readings are missing or, where it sticks, that of $t_f$.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("failure_time", "t_f", "s", 0.0, 1e5, "when it dies", neutral=1e5),
    Parameter("failure_sticks", "a", "dimensionless", 0.0, 1.0, "1 if the last reading stays", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings up to the failure."""
    dead = r.samples * r.step >= r.p("failure_time")
    last = np.broadcast_to(np.maximum((~dead).sum(axis=-2, keepdims=True) - 1, 0), (*r.values.shape[:-2], 1, r.lanes))
    stuck = np.take_along_axis(r.values, last, axis=-2)
    return np.where(dead, np.where(r.p("failure_sticks") > 0.5, stuck, np.nan), r.values)
