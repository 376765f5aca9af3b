"""Extended Kalman filter: linearised at every sample by the exact sparse Jacobian (Ziaukas 2.12 to 2.18)."""

from __future__ import annotations

from harness.engine.kernel_names import put, splat
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import linear_workspace, predict

KALMAN_TYPE = True
DEVICES = ("cuda",)
IN_TRACE = 1


def workspace():
    """Return the scratch arrays of a run."""
    return linear_workspace()


def step(before, u_before, u, y, belief, work, after, info):
    """Predict one sample ahead (2.12, 2.13) and correct with the measurement (2.14 to 2.16)."""
    predict(before, u_before, u, belief, work)
    _, x_prior, P_prior, predicted, H, scratch = work
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)
