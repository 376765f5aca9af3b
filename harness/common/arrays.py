"""Types of arrays in annotations; shapes are stated in the docstrings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def batches(values: Floats, dimensions: int) -> Floats:
    """Return an array of one batch, which has so many dimensions, with an axis in front; one that has it as it is."""
    return values[None] if values.ndim == dimensions else values
