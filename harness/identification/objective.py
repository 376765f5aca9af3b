"""What a fit maximises: the log-likelihood of recordings with the priors, as a function of coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.identification.coordinates import Coordinates
from harness.identification.data import Drive
from harness.identification.driveable import Driveable
from harness.identification.filtered_model import FilteredModel


class LogPosterior:
    """The log-likelihood of recordings under a filtered model, less what the priors take.

    Args:
        model: The filter.
        drives: The recordings.
        coordinates: In which it is maximised.
        driveable: What a candidate must pass besides; nothing by default.

    Attributes:
        lower: Bounds ``(n,)``.
        upper: Bounds ``(n,)``.
        diverged: Candidates so far that have no value.
        history: Value at every pass with derivatives.
    """

    def __init__(
        self,
        model: FilteredModel,
        drives: Sequence[Drive],
        coordinates: Coordinates,
        driveable: Driveable | None = None,
    ) -> None:
        self.driveable = driveable
        self.model, self.drives, self.coordinates = model, tuple(drives), coordinates
        self.lower, self.upper = coordinates.lower, coordinates.upper
        self.diverged, self._numbers = 0, range(len(drives))
        self.history: list[float] = []

    def values(self, z: Floats, keep_first: bool = False) -> Floats:
        """Return the values of candidates ``(n, candidates)``, minus infinity where one is impossible or diverges.

        Args:
            z: The candidates.
            keep_first: Whether the first is likely to be the next point of ``slopes``.
        """
        possible = np.array([self.coordinates.possible(column) for column in z.T])
        likelihood = np.full(z.shape[1], -np.inf)
        if possible.any():
            kept = z[:, possible]
            held = [self.coordinates.candidates(kept, i) for i in self._numbers]
            likelihood[possible] = self.model.log_likelihoods(self.drives, held, keep_first)
        self.diverged += int(np.isneginf(likelihood).sum())
        found: Floats = likelihood - self.coordinates.penalty(z)
        while self.driveable is not None and np.isfinite(found).any():
            best = int(np.argmax(found))  # a candidate that is no better than another is not taken anyway
            if self.driveable.admits([self.coordinates.candidates(z[:, best], i).values[:, 0] for i in self._numbers]):
                break
            found[best] = -np.inf
        return found

    def slopes(self, z: Floats, moved: Mask) -> tuple[float, Floats, Floats]:
        """Return value, gradient and information at a point ``(n,)`` of the coordinates that move ``(n,)``."""
        numbers, space = self._numbers, self.coordinates
        points = [space.candidates(z, i) for i in numbers]
        found = self.model.slopes(self.drives, points, [space.directions(z, moved, i) for i in numbers])
        value = found.log_likelihood - float(space.penalty(z))
        self.history.append(value)
        gradient = found.gradient - (space.weight * (z - space.centre))[moved]
        return value, gradient, found.information + np.diag(space.weight[moved])
