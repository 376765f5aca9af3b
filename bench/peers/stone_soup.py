"""Stone Soup's UKF, which takes one run at a time, on the compiled equations of the problem."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.nonlinear import GaussianTransitionModel
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

from bench.peers.problem import UNSCENTED, Problem, compiled_step
from harness.common.arrays import Floats

STEP = datetime.timedelta(seconds=0.01)
START = datetime.datetime(2026, 1, 1)


class _Transition(GaussianTransitionModel):
    """The compiled step as a transition model; time stands for the sample."""

    ahead: Any = Property()
    noise: Any = Property()
    ndim_state: int = Property()

    def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
        k = round((state.timestamp - START) / STEP)
        vectors = np.asarray(state.state_vector, dtype=float)
        return type(state.state_vector)(np.stack([self.ahead(column, k) for column in vectors.T], axis=1))

    def covar(self, **_: Any) -> Any:
        return self.noise


def unscented(given: Problem) -> Callable[[], Floats]:
    """Return Stone Soup's UKF with its update for linear outputs."""
    nx, seen = len(given.mean), given.measured_state
    transition = _Transition(ahead=compiled_step(given), noise=np.diag(given.process), ndim_state=nx)
    predictor = UnscentedKalmanPredictor(transition, **UNSCENTED)
    updater = KalmanUpdater(LinearGaussian(nx, (seen,), np.diag(given.measurement)))

    def run() -> Floats:
        state = GaussianState(given.mean[:, None], np.diag(given.variance), timestamp=START)
        kept = np.empty((given.steps, nx))
        for k in range(1, given.steps + 1):
            now = START + k * STEP
            predicted = predictor.predict(state, timestamp=now)
            measured = Detection(given.measurements[k, :, :1], timestamp=now)
            state = updater.update(SingleHypothesis(predicted, measured))
            kept[k - 1] = np.asarray(state.state_vector, dtype=float)[:, 0]
        return kept

    return run
