r"""Readings arrive late, by a delay that may vary from sample to sample.

Equation: $y_k \to y_{k - d_k}$ with $d_k = (\tau + \tau_J u_k)/\Delta t$, rounded, and $u_k$ uniform from 0 to 1.

Readings from before the first sample are missing.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("latency_delay", r"\tau", "s", 0.0, 60.0, "least delay, rounded to samples", neutral=0.0),
    Parameter("latency_jitter", r"\tau_J", "s", 0.0, 60.0, "range of what adds to it at random", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings that have arrived at each sample."""
    late = np.round((r.p("latency_delay") + r.p("latency_jitter") * r.uniform("jitter")) / r.step)
    rows = np.broadcast_to(r.samples - late, r.values.shape).astype(int)
    return np.where(rows < 0, np.nan, np.take_along_axis(r.values, np.maximum(rows, 0), axis=-2))
