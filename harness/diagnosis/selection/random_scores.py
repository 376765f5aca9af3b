"""What random processes promise: they have no response to be tested, so the likelihood at a few intensities tells."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting.fit import Point
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.score_test import Score

_Values = tuple[float, ...]
"""Of what all drives share of a process."""


def random_scores(fits: CandidateFits, point: Point, tried: Sequence[Hypothesis]) -> list[Score]:
    """Return what random processes gain in likelihood at the best values of their grids, in place of a score test.

    Each process is the likeliest by itself, also where there are several at once.
    """
    if not tried:
        return []
    single = list(dict.fromkeys(one for h in tried for one in h.single))
    grids = [[_at(fits, point, one), *_grid(fits, one)] for one in single]
    alone = [_with(fits, point, {one: values}) for one, grid in zip(single, grids, strict=True) for values in grid]
    likelihoods = np.split(_log_likelihoods(fits, alone), np.cumsum([len(grid) for grid in grids[:-1]]))
    best = {one: grid[int(np.argmax(own))] for one, grid, own in zip(single, grids, likelihoods, strict=True)}
    points = [_with(fits, point, {one: best[one] for one in h.single}) for h in tried]
    gains = _log_likelihoods(fits, [point, *points])
    return [_score(fits, h, p, float(gain)) for h, p, gain in zip(tried, points, gains[1:] - gains[0], strict=True)]


def _score(fits: CandidateFits, h: Hypothesis, point: Point, gain: float) -> Score:
    """Return what a process gains at a point; no drive shows a response, and none is needed."""
    drives = fits.fitting.drives
    at = dict(zip(h.shared, _at(fits, point, h), strict=True))
    amplitudes, shapes = (np.array([at[n] for n in names]) for names in (h.amplitudes, h.shapes))
    nothing = tuple(np.zeros(d.measurements.shape, dtype=np.float32) for d in drives)
    unknown, never = np.full(len(amplitudes), np.inf), np.zeros((len(drives), 0))
    return Score(h, gain, amplitudes, unknown, float(len(amplitudes)), shapes, never, nothing, True)


def _grid(fits: CandidateFits, h: Hypothesis) -> list[_Values]:
    """Return the values at which a process is tried."""
    parameters = [fits.augmented.model.parameters[fits.augmented.row(n)] for n in h.shared]
    return list(itertools.product(*(p.grid for p in parameters)))


def _at(fits: CandidateFits, point: Point, h: Hypothesis) -> _Values:
    """Return the values of a process at a point."""
    return tuple(float(point.values[fits.augmented.row(n), 0]) for n in h.shared)


def _with(fits: CandidateFits, point: Point, processes: Mapping[Hypothesis, _Values]) -> Point:
    """Return a point with other values of some processes."""
    values = point.values.copy()
    for h, own in processes.items():
        values[[fits.augmented.row(n) for n in h.shared]] = np.array(own)[:, None]
    return replace(point, values=values)


def _log_likelihoods(fits: CandidateFits, points: Sequence[Point]) -> Floats:
    return fits.augmented.log_likelihoods(fits.fitting.drives, fits.fitting.candidates(points))
