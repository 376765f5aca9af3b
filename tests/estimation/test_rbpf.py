"""The Rao-Blackwellised particle filter: against filters written out where the parameter is linear, and on a mass."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.estimation.compiled_estimator import CompiledEstimator
from support.oscillator import P0, STEP, VALUES, Q, R, compiled, drive, mass, push, run

F = np.eye(2) + STEP * np.array([[0, 1], [-4, -1.5]])
G = STEP * np.array([0, 1.0])  # what a push adds in a step


def certain(u, y, push):
    """Return means of the Kalman filter that holds a push for certain, their slope to it, and its covariances."""
    x, s, P = np.zeros(2), np.zeros(2), np.diag(P0)
    found = [(x, s, P)]
    for k in range(1, len(y)):
        x, s, P = F @ x + G * (u[k - 1, 0] + push), F @ s + G, F @ P @ F.T + np.diag(Q)
        K = P[:, 0] / (P[0, 0] + R[0])
        x, s, P = x + K * (y[k, 0] - x[0]), s - K * s[0], P - np.outer(K, P[0])
        found.append((x, s, P))
    return found


def test_a_linear_parameter_is_estimated_as_the_kalman_filter_does():
    """Whatever is left to the particles and to their filters, both together are the normal distribution."""
    u, y = drive({**VALUES, "push": 1.6})
    right, P = run("ekf", compiled(push()), u, y, [0.0])
    scale = np.sqrt(P[:, [0, 1, 2], [0, 1, 2]])
    for kernel, width in ((0.3, 0.25), (0.95, 0.05)):
        means, covariances = run("rbpf", compiled(push()), u, y, [0.0], {"particles": 300, "kernel": kernel})
        assert (np.abs(means - right) / scale)[1:].max() < width
        np.testing.assert_allclose(covariances[-1], P[-1], rtol=4 * width, atol=0.2 * width * scale[-1].min() ** 2)


def test_what_is_not_weighed_keeps_the_prior_and_spreads_the_states_with_it():
    u, y = drive({**VALUES, "push": 1.6})
    means, covariances = run("rbpf", compiled(push()), u, y, [0.0], {"particles": 300, "weighed": False})
    for k in (1, 100, 299):
        x, s, P = certain(u, y, 0.3)[k]
        np.testing.assert_allclose(means[k, :2], x, atol=0.02)
        np.testing.assert_allclose(covariances[k, :2, :2], P + 4 * np.outer(s, s), rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(means[:, 2], means[1, 2].repeat(300) * (np.arange(300) > 0), atol=1e-12)
    assert covariances[-1, 2, 2] == pytest.approx(4.0, rel=0.02)


def test_without_parameters_it_is_the_ekf():
    u, y = drive(VALUES, samples=60)
    for one, other in zip(run("rbpf", compiled(), u, y, []), run("ekf", compiled(), u, y, []), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("true", [0.6, 2.8, 4.0])
def test_it_finds_a_mass(true):
    u, y = drive({**VALUES, "mass": true}, samples=1500, excitation=4.0)
    means, covariances = run("rbpf", compiled(mass(prior=0.8)), u, y, [0.0], {"particles": 16})
    assert (means[-1, 2] - np.log(true)) ** 2 < 9 * covariances[-1, 2, 2]
    assert np.exp(means[-1, 2]) == pytest.approx(true, rel=0.1 if true > 1 else 0.2)


def test_it_follows_a_mass_that_walks():
    walk = mass(walk=0.05, prior=0.8)
    before = drive({**VALUES, "mass": 4.0}, samples=800, excitation=4.0)
    behind = drive({**VALUES, "mass": 1.5}, samples=1500, excitation=4.0, seed=6)
    u, y = (np.concatenate(pair) for pair in zip(before, behind, strict=True))
    means, covariances = run("rbpf", compiled(walk), u, y, [walk.walk_variance * STEP], {"particles": 16})
    for k, true in ((799, 4.0), (-1, 1.5)):
        assert abs(means[k, 2] - np.log(true)) < 2.5 * covariances[k, 2, 2] ** 0.5 < 0.6


@pytest.mark.parametrize("settings", [{"particles": 1}, {"kernel": 1.0}, {"threshold": 2}])
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(UserError, match="settings of estimator 'rbpf'"):
        CompiledEstimator("rbpf", compiled(push()), settings)
