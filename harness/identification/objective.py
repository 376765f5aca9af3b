"""Objective of a fit: log-likelihood of recordings with the priors, of models that can be driven as the vehicle was.

A fit to innovations never drives the model: the measurements hold it on its path. So a wrong model may follow a drive
best with an axle so soft that the vehicle would spin at the speeds that it was driven at. Such a model is no candidate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.common.cache import LastUsed
from harness.engine.simd.lanes import LANES
from harness.identification.coordinates import Coordinates
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilteredModel

_SPEED = "speed"
"""Input that holds the speed of the vehicle."""

_SPEEDS = 4
_OUTLIERS = 0.01
"""Share of the samples to either side that may be outliers of the recorded speed."""

_REMEMBERED = 64


class Driveable:
    """Whether parameters of a model leave it stable, and its free run within the range of its equations.

    A model without a speed among its inputs counts as stable.

    Args:
        model: The filter with the model.
        fitted: Recordings over which the free run must stay within the range.
        driven: Recordings at whose speeds the model must be stable; those that are fitted by default.
    """

    def __init__(self, model: FilteredModel, fitted: Sequence[DriveData], driven: Sequence[DriveData] = ()) -> None:
        self.model, self.drives = model, tuple(fitted)
        self.speeds = self._speeds(driven or fitted)
        self._samples = max(len(d.time) for d in driven or fitted)
        self._known = LastUsed[bool](_REMEMBERED)

    def _speeds(self, drives: Sequence[DriveData]) -> Floats:
        if _SPEED not in self.model.model.inputs:
            return np.zeros(0)
        column = self.model.model.inputs.index(_SPEED)
        driven = np.concatenate([d.inputs[:, column] for d in drives])
        slowest, fastest = np.quantile(driven, [_OUTLIERS, 1.0 - _OUTLIERS])
        return np.linspace(slowest, fastest, _SPEEDS)

    def unstable_from(self, values: Floats) -> float:
        """Return the lowest of the driven speeds, in m/s, at which a disturbance of straight-ahead driving grows.

        It grows if it would be e times as large at the end of the longest drive; the linearisation is exact.

        Args:
            values: Parameters ``(np,)``.

        Returns:
            The speed; infinite if the model is stable at all of them.
        """
        held = np.zeros((len(values), self.model.duals.lanes))
        held[:, :LANES] = values[:, None]
        constants = self.model.duals.constants(held)
        for speed in self.speeds:
            transition = self._transition(values, constants, float(speed))
            radius = np.abs(np.linalg.eigvals(transition)).max() if np.isfinite(transition).all() else math.inf
            if not radius < math.exp(1.0 / self._samples):
                return float(speed)
        return math.inf

    def _transition(self, values: Floats, constants: Floats, speed: float) -> Floats:
        """Return the derivative of the next state to the state, straight ahead at a speed ``(nx, nx)``."""
        model, compiled = self.model.model, self.model.duals
        u, x = np.zeros((len(model.inputs), compiled.lanes)), np.zeros((compiled.nx, compiled.lanes))
        u[model.inputs.index(_SPEED), :LANES] = speed
        for i, state in enumerate(model.states):
            start = model.start.get(state, 0.0)
            if isinstance(start, str):
                start = (
                    speed if start == _SPEED else values[self.model.row(start)] if start in self.model.names else 0.0
                )
            x[i, :LANES] = start
        derivative, w = np.empty((compiled.nx, compiled.nx)), np.empty((compiled.nw, compiled.lanes))
        for first in range(0, compiled.nx, LANES):
            columns = range(first, min(first + LANES, compiled.nx))
            moved, ahead = x.copy(), np.empty_like(x)
            moved[list(columns), [LANES + j for j in range(len(columns))]] = 1.0
            compiled.kernels.next_state(moved, u, constants, ahead, w)
            derivative[:, list(columns)] = ahead[:, LANES : LANES + len(columns)]
        return derivative

    def stays(self, values: Sequence[Floats]) -> bool:
        """Whether the free run stays within the range on every fitted drive, with parameters ``(np,)`` for each."""
        runs = self.model.share(lambda i: self.model.free_run(self.drives[i], values[i]), range(len(self.drives)))
        return all(len(r.states) == len(d.time) for r, d in zip(runs, self.drives, strict=True))

    def admits(self, values: Sequence[Floats]) -> bool:
        """Whether a model with parameters ``(np,)`` for each fitted drive is a candidate."""
        key = tuple(v.tobytes() for v in values)
        (admitted,) = self._known.get([key])
        if admitted is None:
            admitted = math.isinf(self.unstable_from(values[0])) and self.stays(values)
            self._known.keep([key], [admitted])
        return admitted


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
        drives: Sequence[DriveData],
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
        posterior: Floats = likelihood - self.coordinates.penalty(z)
        while self.driveable is not None and np.isfinite(posterior).any():
            best = int(np.argmax(posterior))  # a candidate that is no better than another is not taken anyway
            if self.driveable.admits([self.coordinates.candidates(z[:, best], i).values[:, 0] for i in self._numbers]):
                break
            posterior[best] = -np.inf
        return posterior

    def slopes(self, z: Floats, moved: Mask) -> tuple[float, Floats, Floats]:
        """Return value, gradient and information at a point ``(n,)`` of the coordinates that move ``(n,)``."""
        numbers, space = self._numbers, self.coordinates
        points = [space.candidates(z, i) for i in numbers]
        slopes = self.model.slopes(self.drives, points, [space.directions(z, moved, i) for i in numbers])
        value = slopes.log_likelihood - float(space.penalty(z))
        self.history.append(value)
        gradient = slopes.gradient - space.pull(z)[moved]
        return value, gradient, slopes.information + space.precision(moved)
