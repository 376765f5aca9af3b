r"""Noise of a sensor that is alike from sample to sample adds to its white one.

Equation: $y \to y + k \, \sigma \, c$, where $c$ is a Gauss-Markov process of unit variance and time constant $T$, and
$\sigma$ the standard deviation of the white noise.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("coloured_noise", "k", "dimensionless", 0.0, 1e4, "its deviation over that of white noise", neutral=0.0),
    Parameter("coloured_noise_time", "T", "s", 1e-3, 1e4, "time constant", neutral=1.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with the coloured noise."""
    decay = np.exp(-r.step / r.p("coloured_noise_time"))
    process = r.normal("process")
    process[..., 1:, :] *= np.sqrt(1.0 - decay**2)
    for k in range(1, process.shape[-2]):
        process[..., k, :] += decay[..., 0, :] * process[..., k - 1, :]
    return r.values + r.p("coloured_noise") * r.deviation * process
