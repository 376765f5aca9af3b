r"""A sensor is slower than the samples.

Equation: of all samples those stay at which $\lfloor (t - t_0)/T \rfloor$ steps; between them readings are missing.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("sampling_period", "T", "s", 0.0, 600.0, "time between readings; 0 is every sample", neutral=0.0),
    Parameter("sampling_phase", "t_0", "s", 0.0, 600.0, "time of a reading", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with gaps between those that there are."""
    period, rounding = np.maximum(r.p("sampling_period"), 1e-9 * r.step), 1e-6
    since = (r.samples * r.step - r.p("sampling_phase")) / period
    steps = np.floor(since + rounding) > np.floor(since - r.step / period + rounding)
    return np.where(steps, r.values, np.nan)
