"""filterpy's UKF, which takes one run at a time, on the compiled equations of the problem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from bench.peers.problem import UNSCENTED, Problem, compiled_step
from harness.common.arrays import Floats


def unscented(given: Problem) -> Callable[[], Floats]:
    """Return filterpy's UKF."""
    ahead, nx, seen = compiled_step(given), len(given.mean), given.measured_state
    points = MerweScaledSigmaPoints(nx, **UNSCENTED)

    def run() -> Floats:
        ukf = UnscentedKalmanFilter(nx, 1, 0.01, lambda s: s[seen : seen + 1], lambda s, dt, k: ahead(s, k), points)
        ukf.Q, ukf.R = np.diag(given.process), np.diag(given.measurement)
        ukf.x, ukf.P = given.mean.copy(), np.diag(given.variance)
        kept = np.empty((given.steps, nx))
        for k in range(1, given.steps + 1):
            ukf.predict(k=k - 1)
            ukf.update(given.measurements[k, :, 0])
            kept[k - 1] = ukf.x
        return kept

    return run
