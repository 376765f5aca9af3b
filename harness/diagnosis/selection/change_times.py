"""When did something change? Choices of change times for a hypothesis that begins, and may end, once in every drive.

A second time ends what the first one began, so its response is that of the beginning, taken back. With the responses
``X_k`` to changes at the times of a grid, ``b_k = -X_k'r`` and ``G_km = X_k'X_m``, every pair of times is scored
without another run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats

_RIDGE = 1e-6
"""Added to the unit diagonal, so that amplitudes with the same response share it."""

_BEAM = 60
"""Choices kept while drives are joined one after the other."""


@dataclass(frozen=True)
class Choices:
    """Choices of change times for some drives.

    Attributes:
        b: Sum over the drives ``(choices, amplitudes)``.
        G: Sum over the drives ``(choices, amplitudes, amplitudes)``.
        change_times: Indices into the grid of each drive, of the beginning and the end; -1 for never
            ``(choices, drives, 2)``.
    """

    b: Floats
    G: Floats
    change_times: NDArray[np.intp]

    def gains(self) -> Floats:
        """Return the gains in log-likelihood without bounds ``(choices,)``."""
        scale = np.sqrt(np.maximum(np.diagonal(self.G, axis1=1, axis2=2), 1e-300))
        unit = self.G / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(self.b.shape[1])
        b = self.b / scale
        return 0.5 * np.einsum("ni,ni->n", b, np.linalg.solve(unit, b[:, :, None])[:, :, 0])

    def best(self) -> Choices:
        """Return those of largest gain, best first, and the first of all (no change) in any case."""
        order = list(dict.fromkeys([*np.argsort(-self.gains())[:_BEAM].tolist(), 0]))
        return Choices(self.b[order], self.G[order], self.change_times[order])


def choices(b: Floats, G: Floats, ends: bool) -> Choices:
    """Return all choices in one drive; the first is that of no change.

    Args:
        b: ``(amplitudes, change_times)``.
        G: ``(amplitudes, amplitudes, change_times, change_times)``.
        ends: Whether a change may end.
    """
    d, n = b.shape
    each = np.arange(n)
    at = G[:, :, each, each]
    parts_b, parts_G = [np.zeros((1, d)), b.T], [np.zeros((1, d, d)), at.transpose(2, 0, 1)]
    change_times = [np.full((1, 2), -1), np.column_stack([each, np.full(n, -1)])]
    if ends:
        k, m = np.triu_indices(n, 1)
        parts_b.append((b[:, k] - b[:, m]).T)
        parts_G.append((at[:, :, k] + at[:, :, m] - G[:, :, k, m] - G[:, :, m, k]).transpose(2, 0, 1))
        change_times.append(np.column_stack([k, m]))
    return Choices(np.concatenate(parts_b), np.concatenate(parts_G), np.concatenate(change_times)[:, None, :])


def join(by_drive: Sequence[Choices]) -> tuple[tuple[int, int], ...]:
    """Return the change times for all drives with amplitudes in common, the best few of each drive at a time."""
    beam = by_drive[0].best()
    for found in by_drive[1:]:
        ranked = found.best()
        first, second = (i.ravel() for i in np.indices((len(beam.b), len(ranked.b))))
        beam = Choices(
            beam.b[first] + ranked.b[second],
            beam.G[first] + ranked.G[second],
            np.concatenate([beam.change_times[first], ranked.change_times[second]], axis=1),
        ).best()
    return tuple((int(k), int(m)) for k, m in beam.change_times[0])
