r"""Readings are missing, one at a time or in bursts.

Equation: a burst of $n = T/\Delta t$ samples begins at each sample with the probability $1 - (1 - s)^{1/n}$, so that in
the mean the share $s$ of the samples is missing.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("dropout_share", "s", "dimensionless", 0.0, 1.0, "share of the samples that are missing", neutral=0.0),
    Parameter("dropout_length", "T", "s", 0.0, 600.0, "length of a burst; 0 is a single sample", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with gaps."""
    length = np.maximum(np.round(r.p("dropout_length") / r.step), 1.0)
    begins = r.uniform("bursts") < 1.0 - (1.0 - r.p("dropout_share")) ** (1.0 / length)
    latest = np.maximum.accumulate(np.where(begins, r.samples, -np.inf), axis=-2)
    return np.where(r.samples - latest < length, np.nan, r.values)
