"""Which samples a figure needs: as many as its pixels show, with every extreme kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats

BINS = 400
"""Parts of the time axis of which each figure shows the extremes: about one for three pixels of a wide screen."""


def kept(columns: Sequence[Floats], first: int, stop: int, bins: int = BINS) -> NDArray[np.int64]:
    """Return the samples from ``first`` to before ``stop`` that stand for all of them in a line over time.

    Of each part of the axis these are its first sample and, of every column, that with the smallest and that with the
    largest value; of few samples all.

    Args:
        columns: Over all samples, each ``(samples,)``; a line through what is kept has their extremes.
        first: First sample that is shown.
        stop: One past the last.
        bins: Parts.
    """
    count = stop - first
    width = -(-count // bins)
    if width <= 2 * (1 + len(columns)):
        return np.arange(first, stop)
    begins = np.arange(first, stop, width)
    found = [begins, np.array([stop - 1])]
    for column in columns:
        padded = np.full(len(begins) * width, np.nan)
        padded[:count] = column[first:stop]
        parts = padded.reshape(len(begins), width)
        for end, pick in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            found.append(begins + pick(np.where(np.isnan(parts), end, parts), axis=1))
    return np.unique(np.concatenate(found))


def largest(column: Floats, begins: NDArray[np.int64]) -> Floats:
    """Return the largest value of each part of a column; NaN where it has none.

    Args:
        column: ``(samples,)``.
        begins: First sample of each part, ascending from 0.
    """
    found: Floats = np.maximum.reduceat(np.where(np.isnan(column), -np.inf, column), begins)
    return np.where(np.isfinite(found), found, np.nan)
