"""Which cases a study runs: the points of each design, and the units of work they are cut into.

Levels are taken as they are. Bands are boxes, filled in one of four ways:

* ``sobol``: SALib's Sobol sequence (Joe and Kuo 2003), unscrambled and from its first point on: dropping or
  skipping points spoils the balance (Owen 2020, arXiv:2008.08051), and the first point, the origin, is the
  lower corner of every box. Where a factor's distribution has an end at infinity, the sequence is scrambled.
* ``saltelli``: SALib's cross-sampled pair of matrices for Sobol indices (Saltelli et al. 2010, doi
  10.1016/j.cpc.2009.09.018), from a scrambled sequence.
* ``population``: independent scrambled Sobol sequences, one behind the other, through the joint distribution.
* ``tolerance``: the nominal point, each factor alone at its lower and at its upper edge, and a scrambled Sobol
  sequence in the box; bands are nested boxes.

A factor with a distribution takes the values of its inverse distribution function at these points; where factors are
correlated, after their normal scores have been (Gaussian copula).

All bands of a design use the same points, scaled, so that sample ``k`` lies at the same relative place in each.

The design is paired: points, drives and seeds are fixed before any estimator is looked at, so every
estimator sees the same runs.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.cache import ARRAY, kept
from harness.config import DesignSpec, FactorSpec, StudySpec
from harness.config.marginals import SMALLEST

RUNS_PER_UNIT = 64
"""Most runs of a unit of a design that is not large."""

LARGEST_UNIT = 2048
"""Most runs of a unit of a large design, so that a million runs are not a million files."""

MANY_UNITS = 512
"""Units of a design above which units grow."""


_MOST_KEPT = 2**21
"""Numbers of points that are kept from one process to the next."""


@dataclass(frozen=True)
class DesignPoints:
    """The points of one design in SI units.

    Attributes:
        factors: Name of each factor's parameter; ``belief.<parameter>`` if only the belief varies, shape
            ``(factor,)``.
        values: Shape ``(band, sample, factor)``.
        lower: Lower edge, shape ``(band, factor)``; equal to ``upper`` for a level.
        upper: Upper edge, shape ``(band, factor)``.
        band_labels: Shape ``(band,)``.
        scores: Normal scores of the factors, ``(sample, factor)``; empty where they take no part.
    """

    factors: tuple[str, ...]
    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    band_labels: tuple[str, ...]
    scores: NDArray[np.float64]


@dataclass(frozen=True, order=True)
class Unit:
    """A piece of work: one band of one design on one drive, some of its samples, all or some of their repeats.

    Attributes:
        design: Index of the design in the study.
        band: Index of the band.
        drive: Index of the drive in the study.
        first: First sample.
        stop: One past the last sample.
        first_repeat: First repeat.
        stop_repeat: One past the last repeat; ``None`` for all that are left.
    """

    design: int
    band: int
    drive: int
    first: int
    stop: int
    first_repeat: int = 0
    stop_repeat: int | None = None

    @property
    def samples(self) -> slice:
        """The samples as a slice."""
        return slice(self.first, self.stop)

    @property
    def repeats(self) -> slice:
        """The repeats as a slice."""
        return slice(self.first_repeat, self.stop_repeat)

    def runs(self, study: StudySpec) -> int:
        """Return the number of runs, samples times repeats."""
        repeats = range(study.designs[self.design].repeats)[self.repeats]
        return (self.stop - self.first) * len(repeats)


def unit_box(samples: int, dimensions: int) -> NDArray[np.float64]:
    """Return the first points of SALib's Sobol sequence in the unit box, shape ``(samples, dimensions)``."""

    def drawn() -> NDArray[np.float64]:
        from SALib.sample import sobol_sequence

        return np.asarray(sobol_sequence.sample(samples, dimensions), dtype=np.float64)

    return _kept(drawn, "SALib", f"sobol {samples} {dimensions}", samples * dimensions)


def saltelli_points(samples: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Return SALib's Saltelli design in the unit box, ``(samples * (dimensions + 2), dimensions)``.

    Args:
        samples: Points of the scrambled sequence, a power of two.
        dimensions: Number of factors.
        seed: Seed of the scrambling.
    """

    def made() -> NDArray[np.float64]:
        from SALib.sample import sobol

        names = [str(i) for i in range(dimensions)]
        box = {"num_vars": dimensions, "names": names, "bounds": [[0.0, 1.0]] * dimensions}
        drawn = sobol.sample(box, samples, calc_second_order=False, scramble=True, seed=np.random.default_rng(seed))
        return np.asarray(drawn, dtype=np.float64)

    return _kept(made, "SALib", f"saltelli {samples} {dimensions} {seed}", samples * (dimensions + 2) * dimensions)


def scrambled_points(samples: int, dimensions: int, seed: int | tuple[int, int]) -> NDArray[np.float64]:
    """Return a Sobol sequence with Owen's scrambling in the unit box, ``(samples, dimensions)``.

    Scrambled, every point is uniform in the box, so that shares of points estimate shares of the box.
    """

    def drawn() -> NDArray[np.float64]:
        from scipy.stats import qmc

        generator = qmc.Sobol(d=dimensions, scramble=True, seed=np.random.default_rng(seed))
        return np.asarray(generator.random(samples), dtype=np.float64)

    return _kept(drawn, "scipy", f"scrambled {samples} {dimensions} {seed}", samples * dimensions)


def _kept(drawn: Callable[[], NDArray[np.float64]], package: str, which: str, numbers: int) -> NDArray[np.float64]:
    """Return points ``(points, dimensions)`` from an earlier process: the package's import takes longer than they do.

    Args:
        drawn: Makes them.
        package: That makes them.
        which: All that they depend on besides its version and NumPy's and SciPy's.
        numbers: How many numbers that may be; of many none is kept.
    """
    if numbers > _MOST_KEPT:
        return drawn()
    versions = [f"{name} {importlib.metadata.version(name)}" for name in dict.fromkeys((package, "numpy", "scipy"))]

    points: NDArray[np.float64] = kept("points", f"{which} {versions}", drawn, ARRAY)
    return points


def _scaled(factor: FactorSpec, band: int, unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of one factor at places in the unit interval; of a nested box between the nominal and those."""
    if factor.marginal is not None:
        share = (band + 1) / len(factor.levels)
        values = factor.marginal.at(unit)
        return values if share == 1.0 else factor.nominal + share * (values - factor.nominal)
    lower, upper = factor.lower[band], factor.upper[band]
    if factor.log:
        return lower * np.exp(unit * np.log(upper / lower))
    # As SALib.util.scale_samples: the same operations in the same order give the same bits.
    return unit * (upper - lower) + lower


def points(study: StudySpec, design: DesignSpec) -> DesignPoints:
    """Return all points of a design; nothing in them depends on an estimator or a worker.

    Args:
        study: The study.
        design: One of its designs.

    Raises:
        ValueError: If the design is not of this study.
    """
    if design not in study.designs:
        raise ValueError(f"design '{design.name}' is not one of study '{study.name}'")
    factors, shape = design.factors, (design.bands, len(design.factors))
    lower = np.array([f.lower for f in factors]).T.reshape(shape)
    upper = np.array([f.upper for f in factors]).T.reshape(shape)
    values = np.repeat(lower[:, None, :], design.samples, axis=1)
    banded = [i for i, f in enumerate(factors) if f.banded]
    unit = _unit_points(study, design, len(banded))
    scores = np.empty((0, 0))
    if design.correlation or design.sampling == "population":
        scores, unit = _joint(unit, np.array(design.correlation or np.eye(len(factors)))[np.ix_(banded, banded)])
    for band in range(design.bands):
        for column, i in enumerate(banded):
            values[band, -len(unit) :, i] = _scaled(factors[i], band, unit[:, column])
    if design.sampling == "tolerance":
        values[:, : 1 + 2 * len(factors)] = _nominal_and_edges(lower, upper, np.array([f.nominal for f in factors]))
    names = tuple(f.written for f in factors)
    return DesignPoints(names, values, lower, upper, design.band_labels, scores)


def _unit_points(study: StudySpec, design: DesignSpec, dimensions: int) -> NDArray[np.float64]:
    """Return the points of a design in the unit box before its factors are correlated."""
    if design.sampling == "saltelli":
        return saltelli_points(design.base_samples, dimensions, study.seed)
    if design.sampling == "population":
        each = [scrambled_points(design.base_samples, dimensions, (study.seed, k)) for k in range(design.scramblings)]
        return np.concatenate(each)
    has_open_end = any(f.marginal and f.marginal.is_unbounded for f in design.factors)
    if design.sampling == "tolerance" or has_open_end or design.correlation:
        return scrambled_points(design.base_samples, dimensions, study.seed)
    return unit_box(design.samples, dimensions) if dimensions else np.empty((design.samples, 0))


def _joint(
    unit: NDArray[np.float64], correlation: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the normal scores of a Gaussian copula, and where they lie in the unit box; of the independent unmoved.

    Args:
        unit: Independent points, ``(sample, factor)``.
        correlation: Of the scores.
    """
    from scipy.special import ndtr, ndtri

    scores = ndtri(np.clip(unit, SMALLEST, 1.0 - SMALLEST))
    dependent = (correlation != np.eye(len(correlation))).any(axis=0)
    scores[:, dependent] = scores[:, dependent] @ np.linalg.cholesky(correlation[np.ix_(dependent, dependent)]).T
    return scores, np.where(dependent, ndtr(scores), unit)


def values_of(design: DesignSpec, normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of the factors of a population at independent standard normal numbers, ``(sample, factor)``."""
    from scipy.special import ndtr

    _, unit = _joint(ndtr(normal), np.array(design.correlation or np.eye(len(design.factors))))
    return np.stack([_scaled(factor, 0, unit[:, i]) for i, factor in enumerate(design.factors)], axis=-1)


def _nominal_and_edges(
    lower: NDArray[np.float64], upper: NDArray[np.float64], nominal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the nominal point, then each factor alone at its lower and at its upper edge, ``(band, 1 + 2 D, D)``."""
    bands, count = lower.shape
    values = np.tile(nominal, (bands, 1 + 2 * count, 1))
    for i in range(count):
        values[:, 1 + 2 * i, i], values[:, 2 + 2 * i, i] = lower[:, i], upper[:, i]
    return values


def units(study: StudySpec, design: DesignSpec) -> list[Unit]:
    """Cut a design into units, in an order that depends on the study alone, not on the number of workers.

    Args:
        study: The study.
        design: One of its designs.
    """
    index = study.designs.index(design)
    samples, repeats = unit_shape(study, design)
    return [
        Unit(index, band, drive, first, min(first + samples, design.samples), each, min(each + repeats, design.repeats))
        for band in range(design.bands)
        for drive in range(len(study.drives))
        for first in range(0, design.samples, samples)
        for each in range(0, design.repeats, repeats)
    ]


def unit_shape(study: StudySpec, design: DesignSpec) -> tuple[int, int]:
    """Return how many samples and repeats a unit has; the last one along either may have fewer.

    A unit has at most ``RUNS_PER_UNIT`` runs, in a design that would have more than ``MANY_UNITS`` units up to
    ``LARGEST_UNIT``. The repeats of a sample stay together unless they alone are more than that. Pieces are as few as
    that allows, and then as even as equal chunks of the store allow.
    """
    runs, most = planned_runs(study, design), RUNS_PER_UNIT
    while most < LARGEST_UNIT and runs > MANY_UNITS * most:
        most *= 2
    repeats = _even(design.repeats, most)
    return _even(design.samples, max(most // design.repeats, 1)), repeats


def unit_counts(study: StudySpec, design: DesignSpec) -> tuple[int, int]:
    """Return into how many pieces samples and repeats are cut."""
    samples, repeats = unit_shape(study, design)
    return -(-design.samples // samples), -(-design.repeats // repeats)


def planned_runs(study: StudySpec, design: DesignSpec) -> int:
    """Return the number of runs of a design: bands times drives times samples times repeats."""
    return design.bands * len(study.drives) * design.samples * design.repeats


def _even(count: int, most: int) -> int:
    """Return the length of even pieces of at most ``most``, as few as possible."""
    return -(-count // -(-count // most))
