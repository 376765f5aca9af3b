"""Fit parameters and noise of one hypothesis to recordings, by the likelihood of the filter's innovations.

Parameters, variances and the intensities of random processes move together by Fisher scoring
(``AugmentedModel.slopes``), judged by the likelihood itself. The search for the process noise begins far below: left
too large it hides what the model lacks, and afterwards looks like an effect.

Fits of an unfinished trace are kept in its folder: the same trace, started again, goes on from there. A fit is found
again by everything that decides it: code, model, recordings, what moves, and where it starts. Whatever differs is
fitted anew, so nothing old is ever taken for new.
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import get_args

import numpy as np

from harness.common import sources
from harness.common.arrays import Floats, Mask
from harness.common.cache import LastUsed
from harness.common.kept_arrays import KeptArrays
from harness.diagnosis.criteria import BLOCK
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.identification.candidates import Candidates
from harness.identification.coordinates import (
    Coordinate,
    Coordinates,
    Kind,
    measurement_coordinates,
    process_coordinates,
)
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun
from harness.identification.fisher_scoring import Maximum, maximise
from harness.identification.objective import Driveable, LogPosterior
from harness.identification.signal_noise import signal_noise
from harness.identification.uncertainty import covariance_of, marginal

ENOUGH = 0.3
"""Predicted gain in log-likelihood at which a fit ends; what is accepted gains dozens."""

_ROUGH = 4
"""Iterations of the parameters alone, which only prepare the search for the noise."""

_ROUGHLY = 100 * ENOUGH
"""Predicted gain at which they end."""

_SLOW = 0.01
"""Share of its gain so far below which a step of a first turn ends it: what comes near the best is fitted on, and where
a model is not right steps go on gaining little."""

TURNS = 3
"""Most turns of a fit: a turn is so many steps."""

_COARSE = (-9.0, -6.0, -4.0, -2.0, -1.0, 1.0, 3.0)
"""Steps of the logarithm of a variance, tried together; with the point itself they are the lanes of one run."""


_REMEMBERED = 256
"""Derivatives at ends of fits that are kept: of some models at all levels of the noise."""


@dataclass(frozen=True)
class ParameterPoint:
    """Parameters and noise, for each drive.

    Attributes:
        values: Parameters of the augmented model ``(np, drives)``; they differ in change times only.
        process: Logarithm of a factor on the first process-noise variances, by unit ``(groups,)``.
        measurement: Logarithm of the measurement-noise variances ``(ny,)``.
    """

    values: Floats
    process: Floats
    measurement: Floats

    def value(self, c: Coordinate) -> float:
        """Return the parameter of a coordinate, in the first drive in which it acts."""
        return float(self.values[c.rows[0], c.drives[0] if c.drives else 0])


@dataclass(frozen=True)
class FittedHypothesis:
    """A hypothesis fitted.

    Attributes:
        coordinates: What was moved, noise apart.
        point: Where the fit ended.
        log_likelihood: Of all drives there.
        objective: The same with the priors.
        ended: Whether it ended because nothing more was to be gained, or nothing that counts, and not with its turns.
    """

    coordinates: tuple[Coordinate, ...]
    point: ParameterPoint
    log_likelihood: float
    objective: float
    ended: bool = False


_Search = Callable[[LogPosterior, Floats, Mask], tuple[Maximum, bool]]
"""From a point, with the parameters that move: where it ended, and whether nothing more was to be gained."""


class Fitting:
    """The likelihood of recordings under the augmented model.

    Args:
        model: The compiled filter.
        drives: The recordings.
        variances: Initial measurement variance of each output ``(ny,)``.
        noise_held: Whether all noise stays as it starts.
        driven: Drives at whose speeds a fitted model must be stable; those that are fitted by default.
    """

    def __init__(
        self,
        model: AugmentedModel,
        drives: Sequence[DriveData],
        variances: Floats,
        noise_held: bool = False,
        driven: Sequence[DriveData] = (),
    ) -> None:
        self.augmented, self.drives, self.noise_held = model, tuple(drives), noise_held
        self.driveable = Driveable(model, drives, driven)
        spec = model.spec
        process = process_coordinates(spec)
        self._groups = len(process)
        self._noise = (*process, *measurement_coordinates(spec, variances, signal_noise(drives)))
        stated = Candidates.of(spec)
        self._first = replace(stated, values=model.stated()[:, None])
        self._first_measurement = np.log(variances)
        self._remembered = LastUsed[tuple[float, Floats, Floats]](_REMEMBERED)

    @property
    def samples(self) -> int:
        """Number of measured values."""
        return int(sum(np.isfinite(d.measurements[1:]).sum() for d in self.drives))

    def first(self) -> ParameterPoint:
        """Return the nominal model with its initial noise."""
        values = np.repeat(self._first.values, len(self.drives), axis=1)
        return ParameterPoint(values, np.zeros(self._groups), self._first_measurement.copy())

    def noise(self, points: Sequence[ParameterPoint]) -> Candidates:
        """Return the nominal model with the variances of points."""
        noise = Coordinates(self.augmented.spec, self.augmented.names, self._noise, [self._first])
        return noise.candidates(np.column_stack([np.concatenate([p.process, p.measurement]) for p in points]))

    def candidates(self, points: Sequence[ParameterPoint]) -> list[Candidates]:
        """Return what points hold, as candidates for each drive."""
        held = self.noise(points)
        return [replace(held, values=np.column_stack([p.values[:, i] for p in points])) for i in self._range]

    def runs(self, point: ParameterPoint) -> list[FilterRun]:
        """Run the filter over every drive."""
        return self.augmented.runs(self.drives, self.candidates([point]))

    @property
    def _range(self) -> range:
        return range(len(self.drives))

    def fit(
        self,
        coordinates: tuple[Coordinate, ...],
        start: ParameterPoint,
        iterations: int,
        turns: int = TURNS,
        afresh: bool = True,
        least: float = -math.inf,
    ) -> FittedHypothesis:
        """Fit parameters and noise; parameters alone where the noise is held.

        Args:
            coordinates: What moves besides the noise.
            start: Where it begins.
            iterations: Most steps in a turn.
            turns: Most turns.
            afresh: Whether the noise is sought from far away first; an earlier fit of the same goes on otherwise.
            least: Objective that counts: a fit ends where its slopes promise less than that.
        """
        if self.noise_held:
            return self.only(coordinates, start, iterations, _SLOW if turns == 1 else 0.0)
        n = len(coordinates)

        def search(objective: LogPosterior, z: Floats, parameters: Mask) -> tuple[Maximum, bool]:
            every, groups = np.ones_like(parameters), list(range(n, n + self._groups))
            if afresh:
                z = maximise(objective, z, parameters, _ROUGH, _ROUGHLY, _ROUGHLY).z
                for together in (groups, *([j] for j in range(int(parameters.sum()), n))):
                    z = _along(objective, z, together)
            most = turns * iterations
            share = _SLOW if turns == 1 else 0.0
            maximum = maximise(objective, z, every, most, ENOUGH, 3 * ENOUGH, share, least, variances=~parameters)
            ended = maximum.hopeless or maximum.stuck or maximum.predicted < 10 * ENOUGH
            return maximum, ended

        return self._driveable(coordinates, start, search)

    def only(
        self, coordinates: tuple[Coordinate, ...], start: ParameterPoint, iterations: int, share: float = 0.0
    ) -> FittedHypothesis:
        """Fit some parameters and leave the noise as it is; to where a step gains but a share of all before it."""

        def search(objective: LogPosterior, z: Floats, parameters: Mask) -> tuple[Maximum, bool]:
            moved = parameters | objective.coordinates.kind("intensity")  # which is no noise of a sensor
            maximum = maximise(objective, z, moved, iterations, ENOUGH, ENOUGH, share, variances=~parameters)
            return maximum, maximum.predicted < ENOUGH

        return self._driveable(coordinates, start, search)

    def _driveable(
        self, coordinates: tuple[Coordinate, ...], start: ParameterPoint, search: _Search
    ) -> FittedHypothesis:
        """Return where a search ends; from a model that can be driven none leads to one that cannot.

        Most never come near one, so that is looked at where the search ends, and at every step only if it has to be.
        """
        objective, z, parameters = self._objective(coordinates, start)
        fitted = self._fitted(coordinates, objective, *search(objective, z, parameters))
        if self.admits(fitted.point) or not self.admits(start):
            return fitted
        objective.driveable = self.driveable
        return self._fitted(coordinates, objective, *search(objective, z, parameters))

    def _fitted(
        self, coordinates: tuple[Coordinate, ...], objective: LogPosterior, maximum: Maximum, ended: bool
    ) -> FittedHypothesis:
        space, n = objective.coordinates, len(coordinates)
        values = np.column_stack([space.candidates(maximum.z, i).values for i in self._range])
        process, measurement = np.split(maximum.z[n:].copy(), [self._groups])
        likelihood = maximum.value + float(space.penalty(maximum.z))
        return FittedHypothesis(
            coordinates, ParameterPoint(values, process, measurement), likelihood, maximum.value, ended
        )

    def log_likelihood(self, point: ParameterPoint) -> float:
        """Return the log-likelihood of all drives at a point."""
        return float(self.augmented.log_likelihoods(self.drives, self.candidates([point]))[0])

    def best(self, points: Sequence[ParameterPoint]) -> ParameterPoint:
        """Return the likeliest of several points, of those that are possible and can be driven where any is."""
        points = [p for p in points if self.augmented.possible(p.values[:, 0])] or points
        points = [p for p in points if math.isinf(self.driveable.unstable_from(p.values[:, 0]))] or points
        if len(points) == 1:
            return points[0]
        return points[int(np.argmax(self.augmented.log_likelihoods(self.drives, self.candidates(points))))]

    def admits(self, point: ParameterPoint) -> bool:
        """Whether the model at a point is stable at the driven speeds and stays within its range on these drives."""
        return self.driveable.admits([*np.ascontiguousarray(point.values.T)])

    def _objective(
        self, coordinates: tuple[Coordinate, ...], start: ParameterPoint
    ) -> tuple[LogPosterior, Floats, Mask]:
        """Return what a fit maximises, its first point, and which of its coordinates are no noise."""
        moved = [
            replace(c, upper=min(c.upper, float(self.drives[c.drives[0]].time[-1]))) if c.drives else c
            for c in coordinates
        ]  # a change time lies within its drive
        base = [replace(self._first, values=start.values[:, [i]]) for i in self._range]
        every = (*moved, *self._noise)
        space = Coordinates(self.augmented.spec, self.augmented.names, every, base, self.augmented.joint_prior(every))
        z = np.array([c.coordinate(max(start.value(c), least_of(c))) for c in coordinates])
        z = np.clip(np.concatenate([z, start.process, start.measurement]), space.lower, space.upper)
        return LogPosterior(self.augmented, self.drives, space), z, space.kind("parameter")

    def _slopes(
        self, coordinates: tuple[Coordinate, ...], point: ParameterPoint, *kinds: Kind
    ) -> tuple[Floats, float, Floats, Floats]:
        """Return a point as coordinates, and value, gradient and information there of those of some kinds.

        Curvature, standard errors and the record ask for the same.
        """
        objective, z, _ = self._objective(coordinates, point)
        moved = objective.coordinates.kind(*kinds)
        key = coordinates, moved.tobytes(), z.tobytes(), point.values.tobytes()
        (slopes,) = self._remembered.get([key])
        if slopes is None:
            slopes = objective.slopes(z, moved)
            self._remembered.keep([key], [slopes])
        return z, *slopes

    def standard_errors(self, fitted: FittedHypothesis) -> Floats:
        """Return the standard error of every parameter that a fit moved, in its unit ``(n,)``; infinite if unknown."""
        return self.uncertainty(fitted)[0]

    def uncertainty(self, fitted: FittedHypothesis) -> tuple[Floats, Floats]:
        """Return standard errors as ``standard_errors`` does, and the correlation of the estimates ``(n, n)``."""
        if not fitted.coordinates:
            return np.zeros(0), np.zeros((0, 0))
        z, _, _, information = self._slopes(fitted.coordinates, fitted.point, *get_args(Kind))
        slopes = np.array([c.slope(at) for c, at in zip(fitted.coordinates, z, strict=False)])
        covariance, moved = covariance_of(information), slice(0, len(slopes))
        deviations = np.sqrt(np.maximum(np.diagonal(covariance.unit), 1e-300))
        correlation = covariance.unit / np.outer(deviations, deviations)
        return covariance.errors[moved] * slopes, correlation[moved, moved]

    def information(self, fitted: FittedHypothesis) -> Floats:
        """Return the Fisher information, with that of the priors, on the parameters that a fit moved ``(n, n)``.

        Intensities of random processes, the last of its coordinates, are not among them.
        """
        return self._slopes(fitted.coordinates, fitted.point, "parameter")[-1]

    def at_process_noise(self, fitted: FittedHypothesis, process: Floats) -> tuple[float, Floats, Floats]:
        """Return the log posterior of a fit with other process noise, and what it then says of its parameters.

        Args:
            fitted: The fit; its parameters and measurement noise stay.
            process: Logarithm of a factor on the first process-noise variances, by unit ``(groups,)``.

        Returns:
            Value, gradient ``(n,)`` and information ``(n, n)`` of the parameters that all drives share, in SI units,
            with those of single drives open.
        """
        point = replace(fitted.point, process=process)
        z, value, gradient, information = self._slopes(fitted.coordinates, point, "parameter", "intensity")
        shared = [i for i, c in enumerate(fitted.coordinates) if not c.drives]
        slopes = np.array([fitted.coordinates[i].slope(z[i]) for i in shared])
        return value, gradient[shared] / slopes, marginal(information, shared) / np.outer(slopes, slopes)

    def columns(self, coordinates: Sequence[Coordinate], point: ParameterPoint) -> list[Floats]:
        """Return the derivatives of each drive's whitened innovations to the coordinates ``(samples * ny, n)``."""
        objective, z, parameters = self._objective(tuple(coordinates), point)
        kept = self.runs(point)

        def of_drive(i: int) -> Floats:
            directions = objective.coordinates.directions(z, parameters, i).values
            return in_rows(self.augmented.sensitivities(self.drives[i], point.values[:, [i]], directions, kept[i]))

        return self.augmented.share(of_drive, self._range)


def _along(objective: LogPosterior, z: Floats, together: list[int]) -> Floats:
    """Return the best of a point and points with some coordinates moved by one of several steps."""
    many = np.repeat(z[:, None], len(_COARSE) + 1, axis=1)
    many[together, 1:] += np.array(_COARSE)
    many = np.clip(many, objective.lower[:, None], objective.upper[:, None])
    return many[:, int(np.argmax(objective.values(many, keep_first=True)))]


def least_of(c: Coordinate) -> float:
    """Return the least value at which a fit of a coordinate begins: an intensity is sought by its logarithm."""
    return math.exp(c.lower) if c.kind == "intensity" else -math.inf


def in_rows(columns: Floats) -> Floats:
    """Return columns ``(samples, ny, n)`` as ``(samples * ny, n)``."""
    samples, ny, n = columns.shape
    return columns.reshape(samples * ny, n)


def block_sums(values: Floats, time: Floats) -> Floats:
    """Return sums over blocks ``(blocks, n)`` of values at samples ``(samples, n)``; a short rest goes to the last."""
    count = max(1, round((time[-1] - time[0]) / BLOCK))
    number = np.minimum(((time - time[0]) / BLOCK).astype(int), count - 1)
    sums = np.zeros((count, values.shape[1]))
    np.add.at(sums, number, values)
    return sums


def moved_to(point: ParameterPoint, drives: int) -> ParameterPoint:
    """Return a point of some drives for others: what drives share, with the change times of the first."""
    return replace(point, values=np.repeat(point.values[:, [0]], drives, axis=1))


How = tuple[int, int, bool, float]
"""The last arguments of ``Fitting.fit``."""


class KeptFits:
    """The fits of one trace.

    Args:
        folder: Where they are; nothing is kept without one.

    Attributes:
        taken: Number of fits that were there before this trace began.
        written: Number of fits that were written.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder, self.taken, self.written = folder, 0, 0
        self._arrays = KeptArrays(folder)
        self._basis: dict[Fitting, bytes] = {}
        self._met: set[str] = set()  # a search that comes by the same way again asks for the same fits
        self._counting = Lock()  # candidates are fitted in threads

    def fit(self, fitting: Fitting, moved: tuple[Coordinate, ...], start: ParameterPoint, how: How) -> FittedHypothesis:
        """Return what ``fitting.fit`` does, from the folder if it is there.

        Args:
            fitting: The recordings.
            moved: What moves.
            start: Where it starts.
            how: Iterations and turns of the fit, whether it begins afresh, and the least objective that counts.

        Raises:
            UserError: If the folder cannot be written to.
        """
        if self.folder is None:
            return fitting.fit(moved, start, *how)
        key = self._key(fitting, moved, start, how)
        kept = _fit_of(self._arrays.read(key), moved)
        fitted = kept or fitting.fit(moved, start, *how)
        if kept is None:
            point, numbers = fitted.point, [fitted.log_likelihood, fitted.objective, fitted.ended]
            self._arrays.write(key, [point.values, point.process, point.measurement, np.array(numbers)])
        with self._counting:
            self.taken += kept is not None and key not in self._met
            self.written += kept is None
            self._met.add(key)
        return fitted

    def _key(self, fitting: Fitting, moved: Sequence[Coordinate], start: ParameterPoint, how: How) -> str:
        if fitting not in self._basis:
            augmented, code = fitting.augmented, sources.digest([sys.modules[__name__]])
            equations = augmented.compiled.kernels.__name__  # which holds the digest of their source
            stated = (code, equations, augmented.model.parameters, augmented.spec, fitting.noise_held, fitting.first())
            total = hashlib.sha256(repr(stated).encode())
            for drive in fitting.drives:
                total.update(drive.inputs.tobytes() + drive.measurements.tobytes())
            total.update(fitting.driveable.speeds.tobytes())
            self._basis[fitting] = total.digest()
        total = hashlib.sha256(self._basis[fitting] + repr((tuple(moved), how)).encode())
        for part in (start.values, start.process, start.measurement):
            total.update(np.ascontiguousarray(part).tobytes())
        return total.hexdigest()[:32]

    def remove(self) -> None:
        """Remove what is kept: the trace is finished."""
        self._arrays.remove()


def _fit_of(arrays: Sequence[Floats] | None, moved: tuple[Coordinate, ...]) -> FittedHypothesis | None:
    """Return a fit that was kept; ``None`` of none."""
    if arrays is None:
        return None
    values, process, measurement, numbers = arrays
    return FittedHypothesis(
        moved, ParameterPoint(values, process, measurement), float(numbers[0]), float(numbers[1]), bool(numbers[2])
    )
