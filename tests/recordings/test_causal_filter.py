"""A signal and its rate from the past alone: how large their errors are, what is stated of them, and no foresight."""

import numpy as np
import pytest

from harness.recordings.smooth import kinematic_smoother
from harness.recordings.smooth.kinematic_smoother import BANDWIDTH, filtered

STEP, NOISE = 0.01, 0.02
TIME = np.arange(3000) * STEP


def steered(seed=0):
    """Return a signal that rests, swings and jumps, and its rate."""
    true = np.where(TIME < 8, 0.0, 0.6 * np.sin(2 * np.pi * 0.4 * (TIME - 8))) + 0.5 / (1 + np.exp(-(TIME - 20) / 0.1))
    noise = NOISE * np.random.default_rng(seed).normal(size=len(TIME))
    return true, np.gradient(true, STEP), true + noise


def wandering(count, seed):
    """Return random walks of the rate with the middle intensity ``(count, samples)``, their rates and readings."""
    rng, samples = np.random.default_rng(seed), 400
    intensity = NOISE**2 * STEP * (2 * np.pi * BANDWIDTH) ** 4
    Q = intensity * np.array([[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, STEP]])
    x = np.zeros((count, 2))
    path = np.empty((count, samples, 2))
    for k in range(samples):
        path[:, k] = x
        x = x @ np.array([[1.0, STEP], [0.0, 1.0]]).T + rng.multivariate_normal(np.zeros(2), Q, count)
    return path[:, :, 0], path[:, :, 1], path[:, :, 0] + NOISE * rng.normal(size=(count, samples))


def test_no_later_sample_matters():
    _, _, y = steered()
    other = y.copy()
    other[2000:] += 5.0
    one, two = filtered(y, STEP, NOISE), filtered(other, STEP, NOISE)
    for name in ("value", "rate", "covariance", "lagged"):
        np.testing.assert_array_equal(getattr(one, name)[:2000], getattr(two, name)[:2000])
    assert np.abs(one.value[2100:] - two.value[2100:]).min() > 1.0


def test_the_errors_are_as_small_as_stated_and_the_rate_is_no_difference():
    true, rate, y = steered()
    found = filtered(y, STEP, NOISE)
    errors = np.stack([found.value - true, found.rate - rate], axis=1)[50:]
    spread = np.sqrt(np.stack([found.covariance[50:, i, i] for i in (0, 1)], axis=1))
    assert errors[:, 0].std() < 0.7 * NOISE
    assert errors[:, 1].std() < 0.1 * np.diff(y).std() / STEP
    inside = (np.abs(errors) < 2 * spread).mean(axis=0)
    assert (inside > 0.9).all(), inside


def test_missing_samples_are_bridged_with_growing_uncertainty():
    true, _, y = steered()
    y[1000:1040] = np.nan
    found = filtered(y, STEP, NOISE)
    assert np.isfinite(found.value).all()
    assert (np.diff(found.covariance[1001:1040, 0, 0]) > 0).all()
    assert abs(found.value[1060] - true[1060]) < 4 * np.sqrt(found.covariance[1060, 0, 0])
    held = np.ones(len(y), dtype=bool)
    held[1000:1040] = False
    repeated = np.where(held, y, 7.0)
    np.testing.assert_array_equal(filtered(repeated, STEP, NOISE, held).value, found.value)


def test_the_stated_covariances_are_those_of_drawn_signals(monkeypatch):
    """Of the errors, of those with the sample before, and of the noise of a sample with the error of its rate.

    The intensity is known here: where it may change, the mixture is as cautious as the fastest change asks for.
    """
    monkeypatch.setattr(kinematic_smoother, "MODES", np.ones(2))
    values, rates, readings = wandering(600, 3)
    runs = [filtered(y, STEP, NOISE) for y in readings]
    errors = np.stack(
        [np.stack([f.value - v, f.rate - r], axis=1) for f, v, r in zip(runs, values, rates, strict=True)]
    )[:, -100:]
    stated = np.mean([f.covariance[-100:] for f in runs], axis=(0, 1))
    drawn = np.einsum("nki,nkj->ij", errors, errors) / errors[..., 0].size
    np.testing.assert_allclose(np.diag(stated), np.diag(drawn), rtol=0.1)
    assert stated[0, 1] == pytest.approx(drawn[0, 1], rel=0.15)
    lagged = np.mean([f.lagged[-99:] for f in runs], axis=(0, 1))
    before = np.einsum("nki,nkj->ij", errors[:, 1:], errors[:, :-1]) / errors[:, 1:, 0].size
    np.testing.assert_allclose(lagged, before, rtol=0.15)
    noise = (readings - values)[:, -100:]
    with_rate = np.mean(noise * errors[:, :, 1])
    of_the_sample = np.mean([f.of_the_sample[-100:] for f in runs], axis=(0, 1))
    assert of_the_sample[0, 0] == pytest.approx(NOISE**2)
    assert of_the_sample[0, 1] == pytest.approx(with_rate, rel=0.15)
    assert (np.linalg.eigvalsh(runs[0].of_the_sample) > 0).all()
