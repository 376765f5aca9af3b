"""Fit parameters and noise of one hypothesis to recordings, by the likelihood of the filter's innovations.

Parameters move by Gauss-Newton steps with the gains held as they are (``Whole.sensitivities``), variances by steps of
their own (``variances``). Process noise is first looked for far down: left too large it hides what the model lacks, and
afterwards looks like an effect. Both take turns until neither gains, judged by the likelihood itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.config import ModelSpec
from harness.config.bounds import broken_relations
from harness.diagnosis.fitting.noise_search import along, climb
from harness.diagnosis.model.augmented_model import Noise, Pass, Whole
from harness.diagnosis.model.hypotheses import Coordinate
from harness.identification.coordinates import NOISE_RANGE, PROCESS_PRIOR
from harness.identification.data import Drive
from harness.identification.fisher_scoring import Found, Objective, maximise
from harness.models.signals import SIGNALS

ENOUGH = 0.3
"""Predicted gain in log-likelihood at which a fit ends; what is accepted gains dozens."""

_ROUGH = 4
"""Iterations of a stage that only prepares the next one."""

TURNS = 3
"""Most turns of noise and parameters at the end of a fit."""

_COARSE = (-9.0, -6.0, -4.0, -2.0, -1.0, 1.0, 3.0)
"""Steps of the logarithm of a variance, tried together; with the point itself they are the lanes of one run."""


@dataclass(frozen=True)
class Point:
    """Values of everything, for each drive.

    Attributes:
        values: Parameters of the whole model ``(np, drives)``; they differ in moments only.
        process: Logarithm of a factor on the first process-noise variances, by unit ``(groups,)``.
        measurement: Logarithm of the measurement-noise variances ``(ny,)``.
    """

    values: Floats
    process: Floats
    measurement: Floats


@dataclass(frozen=True)
class Fitted:
    """A hypothesis fitted.

    Attributes:
        coordinates: What was moved, noise apart.
        point: Where the fit ended.
        log_likelihood: Of all drives there.
        objective: The same with the priors.
    """

    coordinates: tuple[Coordinate, ...]
    point: Point
    log_likelihood: float
    objective: float


class Fitting:
    """The likelihood of recordings under the whole model.

    Args:
        whole: The compiled filter.
        drives: The recordings.
        variances: First measurement variance of each output ``(ny,)``.
        noise_held: Whether all noise stays as it starts.
    """

    def __init__(self, whole: Whole, drives: Sequence[Drive], variances: Floats, noise_held: bool = False) -> None:
        self.whole, self.drives, self.noise_held = whole, tuple(drives), noise_held
        self._groups, self._first_process = process_groups(whole.spec)
        self._prior = PROCESS_PRIOR**-2
        self._centre = np.log(variances)

    @property
    def samples(self) -> int:
        """Number of measured values."""
        return int(sum(np.isfinite(d.measurements[1:]).sum() for d in self.drives))

    def first(self) -> Point:
        """Return the nominal model with its first noise."""
        values = np.repeat(self.whole.neutral()[:, None], len(self.drives), axis=1)
        return Point(values, np.zeros(len(self._groups)), self._centre.copy())

    def noise(self, process: Floats, measurement: Floats) -> Noise:
        """Return the variances of candidates ``(groups, n)`` and ``(ny, n)``."""
        return noise_of(self._groups, self._first_process, process, measurement)

    def noise_at(self, point: Point) -> Noise:
        """Return the variances of a point."""
        return self.noise(point.process[:, None], point.measurement[:, None])

    def passes(self, point: Point) -> list[Pass]:
        """Run the filter over every drive."""
        noise = self.noise_at(point)
        return self.whole.share(lambda i: self.whole.run(self.drives[i], point.values[:, i], noise), self._range)

    @property
    def _range(self) -> range:
        return range(len(self.drives))

    def fit(self, coordinates: tuple[Coordinate, ...], start: Point, iterations: int, turns: int = TURNS) -> Fitted:
        """Fit parameters and noise in turns; parameters alone where the noise is held."""
        if self.noise_held:
            return self.only(coordinates, start, iterations)
        objective, z, parameters = self._objective(coordinates, start)
        n, groups = len(coordinates), len(self._groups)
        z = maximise(objective, z, parameters, _ROUGH, 10 * ENOUGH).z
        for together in (list(range(n, n + groups)), *([j] for j in range(n, n + groups))):
            z = along(objective, z, together, _COARSE)
        found, curvature = maximise(objective, z, parameters, _ROUGH, 10 * ENOUGH), None
        for _ in range(turns):
            before = found.value
            z, curvature = climb(objective, found.z, before, n, _ROUGH, 3 * ENOUGH, curvature)
            found = maximise(objective, z, parameters, iterations, ENOUGH)
            if found.value - before < 10 * ENOUGH:
                break
        return self._fitted(coordinates, start, found)

    def only(self, coordinates: tuple[Coordinate, ...], start: Point, iterations: int) -> Fitted:
        """Fit some parameters and leave the noise as it is."""
        objective, z, parameters = self._objective(coordinates, start)
        found = maximise(objective, z, parameters, iterations, ENOUGH)
        return self._fitted(coordinates, start, found)

    def _fitted(self, coordinates: tuple[Coordinate, ...], start: Point, found: Found) -> Fitted:
        penalty = float(self._penalty(coordinates, found.z[:, None])[0])
        return Fitted(coordinates, self._point(coordinates, start, found.z), found.value + penalty, found.value)

    def log_likelihood(self, point: Point) -> float:
        """Return the log-likelihood of all drives at a point."""
        noise = self.noise_at(point)
        found = self.whole.share(
            lambda i: self.whole.likelihoods(self.drives[i], point.values[:, [i]], noise), self._range
        )
        return float(sum(f[0] for f in found))

    def best(self, points: Sequence[Point]) -> Point:
        """Return the likeliest of several points."""
        if len(points) == 1:
            return points[0]
        noise = self.noise(
            np.column_stack([p.process for p in points]), np.column_stack([p.measurement for p in points])
        )
        found = self.whole.share(
            lambda i: self.whole.likelihoods(self.drives[i], np.column_stack([p.values[:, i] for p in points]), noise),
            self._range,
        )
        return points[int(np.argmax(sum(found)))]

    def _penalty(self, coordinates: tuple[Coordinate, ...], z: Floats) -> Floats:
        """Return what the priors take from candidates ``(coordinates + noise, n)``."""
        n = len(coordinates)
        away = z[:n] - np.array([c.centre for c in coordinates]).reshape(-1, 1)
        weight = np.array([c.prior**-2 for c in coordinates])
        return 0.5 * (weight @ away**2 + self._prior * np.sum(z[n : n + len(self._groups)] ** 2, axis=0))

    def _objective(self, coordinates: tuple[Coordinate, ...], start: Point) -> tuple[Objective, Floats, Mask]:
        n, groups = len(coordinates), len(self._groups)
        z = np.concatenate(
            [
                [c.coordinate(start.values[c.row, c.drives[0]]) for c in coordinates],
                start.process,
                start.measurement,
            ]
        )
        reach = np.log(NOISE_RANGE)
        bounds = np.array([c.bounds for c in coordinates]).reshape(-1, 2)
        noise_bounds = np.concatenate([np.zeros(groups), self._centre])
        lower = np.concatenate([bounds[:, 0], noise_bounds - reach])
        upper = np.concatenate([bounds[:, 1], noise_bounds + reach])
        for j, c in enumerate(coordinates):  # a moment lies within its drive
            if c.parameter.per_drive:
                upper[j] = min(upper[j], self.drives[c.drives[0]].time[-1])
        z = np.clip(z, lower, upper)
        objective = Objective(
            lambda many: self._values(coordinates, start, many),
            lambda at, moved: self._slopes(coordinates, start, at, moved),
            lower,
            upper,
        )
        return objective, z, np.arange(len(z)) < n

    def _table(self, coordinates: tuple[Coordinate, ...], start: Point, z: Floats, drive: int) -> Floats:
        """Return the parameters of candidates ``(coordinates, n)`` for one drive ``(np, n)``."""
        values = np.repeat(start.values[:, [drive]], z.shape[1], axis=1)
        for c, row in zip(coordinates, z, strict=False):
            if drive in c.drives:
                values[c.row] = c.value(row)
        return values

    def _point(self, coordinates: tuple[Coordinate, ...], start: Point, z: Floats) -> Point:
        n, groups = len(coordinates), len(self._groups)
        values = np.column_stack([self._table(coordinates, start, z[:, None], i)[:, 0] for i in self._range])
        return Point(values, z[n : n + groups].copy(), z[n + groups :].copy())

    def _values(self, coordinates: tuple[Coordinate, ...], start: Point, z: Floats) -> Floats:
        n, groups = len(coordinates), len(self._groups)
        noise = self.noise(z[n : n + groups], z[n + groups :])
        found = np.sum(
            self.whole.share(
                lambda i: self.whole.likelihoods(self.drives[i], self._table(coordinates, start, z, i), noise),
                self._range,
            ),
            axis=0,
        )
        possible = np.array([self._possible(coordinates, start, column) for column in z.T])
        return np.where(possible, found - self._penalty(coordinates, z), -np.inf)

    def _possible(self, coordinates: tuple[Coordinate, ...], start: Point, z: Floats) -> bool:
        values = self._table(coordinates, start, z[:, None], 0)[:, 0]
        known = {n: float(values[self.whole.row(n)]) for n in self.whole.nominal.parameter_names}
        return not broken_relations(self.whole.spec.vehicle, known)

    def _slopes(
        self, coordinates: tuple[Coordinate, ...], start: Point, z: Floats, moved: Mask
    ) -> tuple[float, Floats, Floats]:
        """Return value, gradient and information of the parameters that move; the noise does not."""
        point = self._point(coordinates, start, z)
        kept = self.passes(point)

        def of_drive(i: int) -> tuple[Floats, Floats]:
            columns = self.columns(coordinates, point, i, kept[i])
            residual = np.nan_to_num(kept[i].whitened)
            return -np.einsum("kan,ka->n", columns, residual), np.tensordot(columns, columns, ((0, 1), (0, 1)))

        found = self.whole.share(of_drive, self._range)
        value = sum(k.log_likelihood for k in kept) - float(self._penalty(coordinates, z[:, None])[0])
        weight = np.array([c.prior**-2 for c in coordinates])
        away = z[: len(coordinates)] - np.array([c.centre for c in coordinates])
        gradient = np.sum([g for g, _ in found], axis=0) - weight * away
        information = np.sum([f for _, f in found], axis=0) + np.diag(weight)
        chosen = moved[: len(coordinates)]
        return value, gradient[chosen], information[np.ix_(chosen, chosen)]

    def columns(self, coordinates: Sequence[Coordinate], point: Point, drive: int, kept: Pass) -> Floats:
        """Return the derivatives of a drive's whitened innovations to the coordinates ``(samples, ny, n)``."""
        directions = np.zeros((len(self.whole.names), len(coordinates)))
        for j, c in enumerate(coordinates):
            if drive in c.drives:
                directions[c.row, j] = c.slope(c.coordinate(point.values[c.row, drive]))
        values = np.repeat(point.values[:, [drive]], len(coordinates), axis=1)
        return self.whole.sensitivities(self.drives[drive], values, directions, kept)


def process_groups(spec: ModelSpec) -> tuple[list[list[int]], Floats]:
    """Return the states whose process noise shares a factor, by unit, and the first variances ``(nx,)``."""
    states = spec.model().states
    first = np.array([spec.process_noise[s] for s in states])
    groups: dict[str, list[int]] = {}
    for i, state in enumerate(states):
        if first[i] > 0:
            groups.setdefault(SIGNALS[state].unit if state in SIGNALS else state, []).append(i)
    return list(groups.values()), first


def noise_of(groups: list[list[int]], first: Floats, process: Floats, measurement: Floats) -> Noise:
    """Return the variances of candidates from logarithms of factors by group and of measurement variances."""
    variances = np.repeat(first[:, None], process.shape[1], axis=1)
    for rows, factors in zip(groups, process, strict=True):
        variances[rows] *= np.exp(factors)
    return Noise(variances, np.exp(measurement))


def moved_to(point: Point, drives: int) -> Point:
    """Return a point of some drives for others: what drives share, with the moments of the first."""
    return replace(point, values=np.repeat(point.values[:, [0]], drives, axis=1))
