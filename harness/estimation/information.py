"""What a drive tells of parameters: the Fisher information along it, with process noise (Tichavsky et al. 1998).

Along a simulated drive the model is linearised at the true states. The information that measurements up to a sample
hold of the state and the parameters among it then follows the recursion of Tichavsky, Muravchik and Nehorai (1998, 21),
which for additive normal noise is that of the inverse covariance of the Kalman filter: the smallest that is possible
with the noise that the belief states.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.estimation.observability import linearise
from harness.models.contracts import Profile

TOLD_APART = 0.95
"""Correlation above which a drive does not tell two parameters apart."""


def parameter_information(spec: ModelSpec, profile: Profile) -> xr.Dataset:
    """Return how well parameters can be known at best along a drive.

    Args:
        spec: The belief, with its parameters among the states; its values are taken for true.
        profile: The drive; its sample time is the step.

    Returns:
        Over ``time`` (s) and ``parameter``: ``std`` (time, parameter), the smallest standard deviation possible in the
        unit of the parameter, to first order, and ``correlation`` (parameter, other) at the end of the drive.

    Raises:
        UserError: As ``linearise``.
    """
    model = spec.model()
    linear = linearise(model, spec.values, profile)
    step = float(profile.time[1] - profile.time[0])
    stretch = step / spec.step
    walk = np.diag([spec.process_noise[s] * stretch for s in model.states])
    noise = np.diag([spec.measurement_noise[o] for o in model.outputs])
    first = [model.start_variance.get(s, spec.process_noise[s]) for s in model.states]
    transitions = np.eye(len(first)) + step * linear.a[:-1]
    covariance = smallest_covariance(transitions, linear.c, walk, noise, np.diag(first))
    behind = len(model.states) - len(model.within)
    blocks = covariance[:, behind:, behind:]
    scale = np.array([s.believed if s.logarithmic else 1.0 for s in spec.parameter_states])
    deviation = np.sqrt(np.einsum("kii->ki", blocks))
    last = blocks[-1] / np.outer(deviation[-1], deviation[-1])
    names = [s.name for s in spec.parameter_states]
    return xr.Dataset(
        {
            "std": (("time", "parameter"), deviation * np.abs(scale), {"long_name": "smallest standard deviation"}),
            "correlation": (("parameter", "other"), last, {"long_name": "correlation at the end of the drive"}),
        },
        coords={"time": ("time", profile.time, {"units": "s"}), "parameter": names, "other": names},
        attrs={"model": model.name, "source": "Tichavsky, Muravchik and Nehorai 1998"},
    )


def smallest_covariance(transitions: Floats, slopes: Floats, walk: Floats, noise: Floats, first: Floats) -> Floats:
    """Return the inverse of the information that measurements up to each sample hold of the state.

    The recursion of Tichavsky, Muravchik and Nehorai (1998, 21) for additive normal noise, in the form of the inverse,
    so that states without process noise are allowed. On a linear model it is the covariance of the Kalman filter.

    Args:
        transitions: Slopes of the next state at each sample but the last ``(samples - 1, ..., nx, nx)``.
        slopes: Slopes of the outputs ``(samples, ..., ny, nx)``; that of the first is not read.
        walk: Covariance of the process noise per step ``(..., nx, nx)``.
        noise: Covariance of the measurement noise ``(..., ny, ny)``.
        first: Covariance at the first sample ``(..., nx, nx)``.

    Returns:
        ``(samples, ..., nx, nx)``.
    """
    covariances = np.empty((len(slopes), *first.shape))
    covariances[0] = covariance = first
    unit = np.eye(first.shape[-1])
    for k in range(1, len(slopes)):
        ahead, seen = transitions[k - 1], slopes[k]
        covariance = ahead @ covariance @ ahead.swapaxes(-1, -2) + walk
        gain = np.linalg.solve(seen @ covariance @ seen.swapaxes(-1, -2) + noise, seen @ covariance).swapaxes(-1, -2)
        remainder = unit - gain @ seen
        covariance = remainder @ covariance @ remainder.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)
        covariances[k] = covariance
    return covariances
