r"""The noise of a sensor has heavy tails.

Equation: in place of the normal noise $\sigma n$ stands $\sigma n / \sqrt{\chi^2_\nu / \nu}$, Student's t of $\nu$
degrees of freedom.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("noise_tail", r"1/\nu", "dimensionless", 0.0, 1.0, "one over the degrees of freedom", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with Student's t in place of normal noise."""
    tail = np.maximum(r.p("noise_tail"), 1e-6)
    scale = np.sqrt(0.5 / (tail * r.gamma("chi", 0.5 / tail)))
    return np.where(r.p("noise_tail") > 0.0, r.values + r.noise * (scale - 1.0), r.values)
