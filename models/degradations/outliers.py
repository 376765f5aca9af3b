r"""Some readings are far off.

Equation: $y \to y + b \, k \, \sigma \, n$ with $b$ 1 in a share $s$ of the samples, $n$ standard normal and $\sigma$
the standard deviation of the sensor's noise.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("outlier_share", "s", "dimensionless", 0.0, 1.0, "share of the samples that are outliers", neutral=0.0),
    Parameter("outlier_size", "k", "dimensionless", 0.0, 1e6, "deviation of outliers over that of noise", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with outliers."""
    off = r.uniform("which") < r.p("outlier_share")
    return np.where(off, r.values + r.p("outlier_size") * r.deviation * r.normal("size"), r.values)
