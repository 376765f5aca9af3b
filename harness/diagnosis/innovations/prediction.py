"""Predict a recording at several horizons, each with the covariance that the whole model gives it.

The filter of a fit has gains of the nominal model. Where an effect feeds back (an axle that steers itself, a body whose
roll steers), the nominal part alone may be unstable, and its covariance says nothing about what the model with the
effect predicts. Here the covariance runs through the whole model, linearised along the pass of that filter, and behind
each of its corrections it is that of an estimate with these gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.diagnosis.innovations import prediction_loops
from harness.diagnosis.innovations.innovation_model import Linearised, ModelTangents
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.noise_slopes import nonzero_columns
from harness.engine.compile import load_source, paste
from harness.engine.simd.lanes import LANES
from harness.identification.candidates import Candidates
from harness.identification.data import DriveData

_FAR = 1.0
"""s; horizon from which the errors of the inputs count as what they do to a free run: they last about as long."""


@dataclass(frozen=True)
class Ahead:
    """How a model predicts a recording at several horizons; one row per sample behind the first.

    Attributes:
        densities: Logarithm of the density of each sample's measurements ``(samples, horizons)``; minus infinity where
            the prediction left its range.
        squares: Their squared distance from the prediction over its covariance ``(samples, horizons)``.
        seen: How many were measured ``(samples,)``.
    """

    densities: Floats
    squares: Floats
    seen: NDArray[np.int_]


class Prediction:
    """The compiled prediction of an augmented model, loaded before threads share it."""

    def __init__(self, augmented: AugmentedModel) -> None:
        self.augmented, self._linearisation = augmented, ModelTangents(augmented)
        source = paste(augmented.compiled, "predict_ahead", [prediction_loops.predict_ahead])
        self._loop = load_source("predict_ahead", source).predict_ahead

    def of(self, drive: DriveData, point: Candidates, horizons: Sequence[float]) -> Ahead:
        """Predict the measurements of a recording.

        From every restart a prediction runs as many samples as its horizon, without their measurements, and then
        begins again from the filter. An infinite horizon is that of the free run.

        Args:
            drive: The recording.
            point: One candidate.
            horizons: Samples, at most ``LANES`` of them; the first one is 1, that of the filter.
        """
        model, kept = self.augmented, self.augmented.run(drive, point)
        drive, values = model.read_ahead(drive, point.values)
        point = replace(point, values=values)
        linear = Linearised(self._linearisation, drive, values[:, 0], kept)
        noise = model.process_variances(point)
        n, corrected, vehicle = len(linear.active), len(noise), len(model.nominal.states)
        first, Q = np.zeros(n), np.zeros(n)  # what an effect of its own begins with, and does, is no noise
        first[:corrected], Q[:corrected] = drive.first_variance[:corrected], noise
        errors = np.zeros((len(drive.inputs), n + model.compiled.ny, drive.effects.shape[2]))
        errors[:, :corrected], errors[:, n:] = drive.effects[:, :corrected], drive.effects[:, -model.compiled.ny :]
        lanes = np.ones((1, LANES))
        lanes[0, : len(horizons)] = horizons
        densities, squares = (np.zeros((len(drive.inputs), LANES)) for _ in range(2))
        self._loop(
            (drive.inputs, drive.between),
            drive.measurements,
            model.compiled.constants(point.in_lanes().values),
            (linear.transition, linear.output, linear.gain, *map(nonzero_columns, (linear.transition, linear.output))),
            (first, Q, np.ascontiguousarray(point.measurement[:, 0]), errors, drive.spread),
            linear.states,
            (vehicle, corrected),
            lanes,
            (lanes * model.spec.step >= _FAR).astype(float),
            densities,
            squares,
        )
        densities, squares = (part[1:, : len(horizons)] for part in (densities, squares))
        return Ahead(
            np.where(np.isfinite(densities), densities, -np.inf),
            np.where(np.isfinite(squares), squares, np.inf),
            np.isfinite(drive.measurements[1:]).sum(axis=1),
        )
