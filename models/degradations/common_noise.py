r"""Sensors share a noise, which correlates theirs.

Equation: $y \to y + k \, \sigma \, n$ with one series of standard normal numbers $n$ for all sensors, and $\sigma$ the
standard deviation of each one's own noise.
"""

from __future__ import annotations

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("common_noise", "k", "dimensionless", -1e4, 1e4, "its deviation over that of own noise", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings with the shared noise."""
    return r.values + r.p("common_noise") * r.deviation * r.normal("common", shared=True)
