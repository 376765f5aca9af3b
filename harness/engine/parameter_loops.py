"""What is done with parameters among the states after each step of an estimator; pasted behind the model's kernels.

A filter that corrects ``x`` and ``z`` together corrects ``x`` alone by leaving out the part of its gain that belongs to
``z``: of mean and covariance only the block of ``z`` differs then, which stays as predicted (Schmidt 1966; Jazwinski
1970, chapter 8). So any filter of the Kalman type leaves a parameter alone if that block is put back after its step.

It is put back where a parameter is considered, and where a sample says nothing of it. A measurement moves the states
by noise even on a straight road, and where the influence of a parameter depends on the states, they then feign one. A
sample is informative of such a parameter if its logarithm, off by one, would move the predicted measurements by a good
part of what they are uncertain if it is right. What is no logarithm is taken to be off by its first deviation.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    CONSIDERED,
    LANES,
    NX,
    NY,
    PARAMETERS,
    SLOPES_VARY,
    get,
    put,
    select,
    splat,
    sqrt,
    within_bounds,
)

FEIGNED = 0.1
"""Share of the variance of predicted measurements, the parameter being right, up to which its influence may be feigned.

At rest the influence that noise feigns is some hundredths at most; less than 0.1 lets an estimate drift, and of 1 a
parameter that is very uncertain is not found, because the filter then trusts its measurements more and hides it.
"""


def bound_parameters(before, u, belief, after, info):
    """Bring the states of parameters back to within their bounds."""
    bounded = np.empty((PARAMETERS, LANES))
    within_bounds(after.mean, u, belief.constants, bounded)
    for i in range(PARAMETERS):
        put(get(bounded, i), after.mean, NX - PARAMETERS + i)


def settle_parameters(before, u, belief, after, info):
    """Leave parameters alone of which nothing is learnt; the variance of a walk then grows to the first one at most."""
    first = NX - PARAMETERS
    held = np.empty((PARAMETERS, LANES))
    hold(before, belief, after, info, held)
    for i in range(PARAMETERS):
        still = get(held, i) > 0.0
        put(select(still, get(before.mean, first + i), get(after.mean, first + i)), after.mean, first + i)
        for j in range(i + 1):
            value = get(before.covariance, first + i, first + j)
            if i == j:
                value = value + get(belief.process_noise, first + i)
            both = still & (get(held, j) > 0.0)
            value = select(both, value, get(after.covariance, first + i, first + j))
            put(value, after.covariance, first + i, first + j)
            put(value, after.covariance, first + j, first + i)
    for i in range(PARAMETERS):
        limit_variance(after.covariance, first + i, select(get(held, i) > 0.0, belief.priors[i, 0], np.inf))
    bound_parameters(before, u, belief, after, info)


def hold(before, belief, after, info, held):
    """Write 1 for parameters that are considered, or of which this sample says nothing, else 0 ``(parameters, LANES)``.

    With ``s`` the slope of the predicted measurements to a parameter, ``P`` its variance and ``S`` their covariance,
    the sample takes ``P s' S^-1 s P`` away from ``P``. So ``s' S^-1 s`` is found for any filter, whatever its kernels.
    """
    first = NX - PARAMETERS
    uncertain = splat(0.0)
    for a in range(NY):
        share = 1.0 - get(belief.measurement_noise, a) / get(info.innovation_covariance, a, a)
        measured = get(info.innovation, a) == get(info.innovation, a)
        uncertain = uncertain + select(measured, share, 0.0)
    for i in range(PARAMETERS):
        predicted = get(before.covariance, first + i, first + i) + get(belief.process_noise, first + i)
        removed = (predicted - get(after.covariance, first + i, first + i)) / predicted
        uncertain = uncertain - removed
        put(belief.priors[i, 1] * removed / predicted, held, i)
    for i in range(PARAMETERS):
        feigned = (get(held, i) <= 0.0) | (get(held, i) <= FEIGNED * uncertain)
        if CONSIDERED[i]:
            put(1.0, held, i)
        elif SLOPES_VARY[i]:
            put(select(feigned, 1.0, 0.0), held, i)
        else:
            put(0.0, held, i)


def limit_variance(P, i, largest):
    """Scale row and column of a covariance so that a variance is at most ``largest``."""
    variance = get(P, i, i)
    factor = select(variance > largest, sqrt(largest / variance), 1.0)
    for j in range(NX):
        value = get(P, i, j) * factor
        put(value, P, i, j)
        put(value, P, j, i)
    put(variance * factor * factor, P, i, i)
