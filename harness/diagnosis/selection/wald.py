"""Wald test: loss of likelihood without an addition, by the curvature of the likelihood (Wald 1943).

With its amplitudes where it is absent, all else that the fit moved goes where it is likeliest by the Fisher information
``F``, within its bounds, and the loss in log-likelihood is ``d'F d / 2`` of the whole step ``d``, with the noise as it
is; noise that is fitted again may take up half of it. Without bounds that is Wald's statistic. They matter where
several together do the same: channels that are late against the steering wheel cannot be early instead.

What loses a gain that is beyond doubt need not be fitted again without it; a fit without it begins behind the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting import FittedHypothesis, ParameterPoint
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.identification.coordinates import Coordinate
from harness.identification.fisher_scoring import bounded_step


@dataclass(frozen=True)
class Without:
    """A model without some of its additions, as the curvature predicts it.

    Attributes:
        loss: In BIC; none of random processes.
        points: Where a fit without them may begin: with all else as it is, and where that is predicted to go.
    """

    loss: float
    points: tuple[ParameterPoint, ...]


class Curvature:
    """The curvature of the likelihood where a model with additions was fitted.

    Args:
        fits: Of the drives.
        fitted: The fit.
    """

    def __init__(self, fits: CandidateFits, fitted: FittedHypothesis) -> None:
        self._fits, self._point = fits, fitted.point
        self._moved = [c for c in fitted.coordinates if c.kind == "parameter"]
        self._information = fits.fitting.information(fitted)
        self._z = np.array([c.coordinate(fitted.point.value(c)) for c in self._moved])
        self._lower, self._upper = (
            np.array([getattr(c, name) for c in self._moved]) - self._z for name in ("lower", "upper")
        )

    def without(self, gone: Added, rest: Added) -> Without:
        """Return what is predicted of a fit without some additions, and with the rest of them."""
        fits, moved, F = self._fits, self._moved, self._information
        amplitudes = {n for h in gone if not h.random for n in h.amplitudes}
        rows = [i for i, c in enumerate(moved) if c.name in amplitudes]
        others = [i for i in range(len(moved)) if i not in rows]
        stated, step = fits.augmented.stated(), np.zeros(len(moved))
        step[rows] = [moved[i].coordinate(float(stated[moved[i].rows[0]])) - self._z[i] for i in rows]
        with np.errstate(over="ignore", invalid="ignore"):
            pull = -(F @ step)[others]
            if np.isfinite(pull).all():
                bounds = self._lower[others], self._upper[others]
                step[others] = bounded_step(pull, F[np.ix_(others, others)], 0.0, *bounds)
            loss = 0.5 * float(step @ F @ step)
        point = fits.without(self._point, gone, rest)
        if not math.isfinite(loss):
            return Without(0.0, (point,))
        own = {n for h in gone for n in (*h.shared, *h.change_times)}
        kept = [i for i in others if moved[i].name not in own]
        there = _moved(point, [moved[i] for i in kept], (self._z + step)[kept])
        count = sum(h.count(len(fits.fitting.drives)) for h in gone)
        return Without(fits.bic(loss, count), (point, there))


def _moved(point: ParameterPoint, coordinates: Sequence[Coordinate], z: Floats) -> ParameterPoint:
    """Return a point with other values of coordinates."""
    values = point.values.copy()
    for c, at in zip(coordinates, z, strict=True):
        values[np.ix_(c.rows, c.drives or range(values.shape[1]))] = c.value(float(at))
    return replace(point, values=values)
