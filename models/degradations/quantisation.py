r"""Readings come in steps.

Equation: $y \to q \, \mathrm{round}(y/q)$.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter, Readings

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("quantisation_step", "q", "{signal}", 0.0, 3.0, "step of the readings", neutral=0.0),
)


def degrade(r: Readings) -> Floats:
    """Return the readings rounded."""
    step = r.p("quantisation_step")
    return np.where(step > 0.0, step * np.round(r.values / np.where(step > 0.0, step, 1.0)), r.values)
