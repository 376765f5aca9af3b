"""What random processes promise: they have no response to be tested, so the likelihood at a few intensities tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting.fit import Point
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.score_test import Score


def random_scores(fits: CandidateFits, point: Point, tried: Sequence[Hypothesis]) -> list[Score]:
    """Return what random processes gain in likelihood at the best intensities of their grids, in place of a score test.

    Each intensity is the likeliest by itself, also where there are several at once.
    """
    if not tried:
        return []
    drives, row = fits.fitting.drives, fits.augmented.row
    sizes = {}
    alone = fits.on_grids(point, list(dict.fromkeys(n for h in tried for n in h.amplitudes)))
    likelihoods = _log_likelihoods(fits, alone)
    for name in (n for h in tried for n in h.amplitudes):
        own = [i for i, p in enumerate(alone) if (p.values[row(name)] != point.values[row(name)]).any()]
        sizes[name] = alone[max([0, *own], key=lambda i: likelihoods[i])].values[row(name), 0]
    points = []
    for h in tried:
        values = point.values.copy()
        for name in h.amplitudes:
            values[row(name)] = sizes[name]
        points.append(replace(point, values=values))
    gains = _log_likelihoods(fits, [point, *points])
    nothing = tuple(np.zeros(d.measurements.shape, dtype=np.float32) for d in drives)
    never = np.zeros((len(drives), 0))
    found = []
    for h, gain in zip(tried, gains[1:] - gains[0], strict=True):
        size = np.array([sizes[n] for n in h.amplitudes])
        unknown = np.full(len(size), np.inf)
        found.append(Score(h, float(gain), size, unknown, float(len(size)), np.zeros(0), never, nothing, True))
    return found


def _log_likelihoods(fits: CandidateFits, points: Sequence[Point]) -> Floats:
    return fits.augmented.log_likelihoods(fits.fitting.drives, fits.fitting.candidates(points))
