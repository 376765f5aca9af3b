r"""Readings end at the range of the sensor.

Equation: $y \to \min(\max(y, -y_\mathrm{max}), y_\mathrm{max})$.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("saturation_limit", r"y_\mathrm{max}", "{signal}", 0.0, 1e4, "largest magnitude", neutral=1e4),
)


def degrade(r: Readings) -> Floats:
    """Return the readings within the range."""
    limit = r.p("saturation_limit")
    return np.clip(r.values, -limit, limit)
