"""Signals and rates given all noisy samples: against a dense solution, and against truths that no random walk made."""

import numpy as np
import pytest
from scipy import stats

from harness.recordings.smooth import kinematic_smoother
from harness.recordings.smooth.kinematic_smoother import resolution_of, run_lengths, smoothed

STEP = 0.01
TIME = np.arange(6000) * STEP


def dense(y, noise, intensities, first):
    """Return mean and covariance of all states, that with the sample before, and the log-density after the third."""
    n, samples = len(first), len(y)
    F = np.eye(n)
    if n == 2:
        F[0, 1] = STEP
        Q = np.array([[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, STEP]])
    else:
        F[0, 1] = F[1, 2] = STEP
        F[0, 2] = STEP**2 / 2
        h = STEP
        Q = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    covariance = np.zeros((samples * n, samples * n))
    block = np.diag(first)
    for k in range(samples):
        if k > 0:
            block = F @ block @ F.T + intensities[k] * Q
        covariance[k * n : (k + 1) * n, k * n : (k + 1) * n] = block
        ahead = block
        for m in range(k + 1, samples):
            ahead = F @ ahead
            covariance[m * n : (m + 1) * n, k * n : (k + 1) * n] = ahead
            covariance[k * n : (k + 1) * n, m * n : (m + 1) * n] = ahead.T
    seen = np.flatnonzero(np.isfinite(y))
    H = np.zeros((len(seen), samples * n))
    H[np.arange(len(seen)), seen * n] = 1.0
    mean = np.tile(np.eye(n)[0] * y[seen[0]], samples)
    S = H @ covariance @ H.T + np.diag(noise[seen])
    gain = np.linalg.solve(S, H @ covariance).T
    found = mean + gain @ (y[seen] - H @ mean)
    left = covariance - gain @ H @ covariance
    whole = stats.multivariate_normal(H @ mean, S).logpdf(y[seen])
    begun = stats.multivariate_normal((H @ mean)[:3], S[:3, :3]).logpdf(y[seen][:3])
    blocks = np.stack([left[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(samples)])
    lagged = np.stack([left[k * n : (k + 1) * n, (k - 1) * n : k * n] for k in range(1, samples)])
    return found.reshape(samples, n), blocks, lagged, whole - begun


@pytest.mark.parametrize("n", [2, 3])
def test_filter_and_smoother_are_the_dense_solution(n):
    rng = np.random.default_rng(3)
    samples = 40
    y = np.cumsum(rng.normal(size=samples)) * 0.1 + rng.normal(size=samples)
    y[[11, 12, 13, 30]] = np.nan
    noise = rng.uniform(0.5, 1.5, samples)
    intensities = rng.uniform(1.0, 1e3, samples)
    first = np.array([25.0, 100.0, 400.0])[:n]
    exact, spread, lagged, density = dense(y, noise, intensities, first)
    loops = kinematic_smoother.kinematic_loops()
    means, covariances = np.empty((samples, n)), np.empty((samples, n, n))
    squares, logarithms, count = loops.run_filter(y, noise, intensities, STEP, first, means, covariances)
    assert count == np.isfinite(y).sum() - 3
    assert -0.5 * (squares + logarithms + count * np.log(2 * np.pi)) == pytest.approx(density, rel=1e-9)
    before = np.empty((samples, n, n))
    loops.run_smoother(intensities, STEP, means, covariances, before)
    scale = np.sqrt(np.einsum("kii->ki", spread))
    np.testing.assert_allclose((means - exact) / scale, 0.0, atol=1e-6)
    unit = scale[:, :, None] * scale[:, None, :]
    np.testing.assert_allclose(covariances / unit, spread / unit, atol=1e-6)
    np.testing.assert_allclose(before[1:] / unit[1:], lagged / unit[1:], atol=1e-6)


def walk(rng, intensity, rates):
    """Return an integrated random walk and its first rate."""
    fine = 20
    x = np.cumsum(rng.normal(size=len(TIME) * fine)) * np.sqrt(intensity * STEP / fine)
    for _ in range(rates):
        rate, x = x, np.cumsum(x) * STEP / fine
    return x[::fine], rate[::fine]


@pytest.mark.parametrize(("rates", "intensity"), [(1, 0.5), (2, 30.0)])
def test_noise_intensity_and_order_are_found(rates, intensity):
    rng = np.random.default_rng(8)
    u, rate = walk(rng, intensity, rates)
    found = smoothed(u + 0.02 * rng.normal(size=len(u)), STEP)
    assert found.order == rates
    assert found.noise == pytest.approx(0.02, rel=0.04)
    for truth, value, row in ((u, found.value, 0), (rate, found.rate, 1)):
        errors = (value - truth) / np.sqrt(found.covariance[:, row, row])
        assert np.mean(np.abs(errors) < 2) == pytest.approx(0.954, abs=0.03)
        assert np.mean(errors**2) == pytest.approx(1.0, abs=0.25)


def test_the_likelihood_is_largest_where_it_says():
    rng = np.random.default_rng(2)
    u, _ = walk(rng, 0.5, 1)
    y = u + 0.02 * rng.normal(size=len(u))
    search = kinematic_smoother._IntensitySearch(y, STEP, 1)
    noise, intensity, likelihood = search._likeliest(*search.bounds, 7)
    loops = kinematic_smoother.kinematic_loops()

    def at(noise, intensity):
        parts = np.full(len(y), noise), np.full(len(y), intensity), STEP, search.first
        squares, logarithms, count = loops.run_filter(y, *parts, np.empty((0, 0)), np.empty((0, 0, 0)))
        return -0.5 * (squares + logarithms + count * np.log(2 * np.pi))

    assert at(noise, intensity) == pytest.approx(likelihood, abs=0.1)
    for factor in (0.8, 1.25):
        assert at(factor * noise, intensity) < likelihood
        assert at(noise, factor**4 * intensity) < likelihood


def weave(rng):
    """Return sines of a driver who steers and rests by turns, with a quick ramp, and the exact rate."""
    phase = rng.uniform(0, 2 * np.pi)
    busy = np.clip(np.sin(2 * np.pi * TIME / 30.0 + phase) * 4.0, 0.0, 1.0)
    u = busy * np.sin(2 * np.pi * 0.7 * TIME) + np.clip((TIME - 20.0) / 0.4, 0.0, 1.0)
    return u, np.gradient(u, STEP)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["white", "quantised", "held"])
def test_intervals_hold_the_truth_of_other_generators(kind, seed):
    rng = np.random.default_rng(100 + seed)
    u, rate = weave(rng)
    y, measured = u + 0.02 * rng.normal(size=len(u)), None
    if kind == "quantised":
        y = np.round(y / 0.05) * 0.05
    if kind == "held":
        measured = np.arange(len(u)) % 3 == 0
        y = np.repeat(y[::3], 3)[: len(u)]
    found = smoothed(y, STEP, measured)
    inside = [
        np.mean(np.abs(value - truth) < 2 * np.sqrt(found.covariance[:, row, row]))
        for row, (value, truth) in enumerate(((found.value, u), (found.rate, rate)))
    ]
    assert min(inside) > 0.90, inside
    error = np.std(found.value - u)
    assert error < 0.5 * np.std(y - u)
    assert np.std(found.rate - rate) < 0.15 * np.std(np.gradient(y, STEP) - rate)
    assert np.sqrt(found.covariance[:, 0, 0].mean()) < 2.5 * error  # not by intervals that are too wide


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_step_in_one_sample_does_not_ring(noise):
    rng = np.random.default_rng(4)
    u = np.where(TIME > 30.0, 1.0, 0.0)
    error = smoothed(u + noise * rng.normal(size=len(u)), STEP).value - u
    away = np.abs(TIME - 30.0) > 0.1
    assert np.abs(error[away]).max() < max(1e-6, 1.5 * noise)
    assert np.abs(error[~away]).max() < max(1e-3, 6 * noise)


def test_standstill_stays_still_and_is_not_surer_than_its_resolution():
    rng = np.random.default_rng(6)
    u = np.clip((TIME - 20.0) * 1.5, 0.0, 20.0)
    y = np.round((u + np.where(u > 0, 0.02, 0.0) * rng.normal(size=len(u))) / 0.02) * 0.02
    found = smoothed(y, STEP)
    still = TIME < 19.0
    assert np.abs(found.value[still]).max() < 2e-3
    assert np.abs(found.rate[still]).max() < 5e-3
    assert np.sqrt(found.covariance[still, 0, 0]).min() > 0.9 * 0.02 / np.sqrt(12)


def test_an_exact_signal_is_left_as_it_is():
    u = np.sin(0.8 * TIME) + 0.3 * np.sin(2.1 * TIME)
    found = smoothed(u, STEP)
    assert np.abs(found.value - u).max() < 1e-6
    np.testing.assert_allclose(found.rate, 0.8 * np.cos(0.8 * TIME) + 0.63 * np.cos(2.1 * TIME), atol=1e-3)
    assert np.sqrt(found.covariance[:, 0, 0]).max() < 1e-6


def test_both_ends_are_as_good_as_they_say():
    rng = np.random.default_rng(9)
    u, rate = np.sin(1.3 * TIME), 1.3 * np.cos(1.3 * TIME)
    errors = []
    for _ in range(20):
        found = smoothed(u[:2000] + 0.02 * rng.normal(size=2000), STEP)
        for k in (0, -1):
            truth = np.array([u[:2000][k], rate[:2000][k]])
            got = np.array([found.value[k], found.rate[k]])
            errors.append((got - truth) / np.sqrt(np.diag(found.covariance[k])[:2]))
    assert np.mean(np.abs(errors) < 2) > 0.85


def test_a_constant_signal_has_no_rate():
    found = smoothed(np.full(50, 3.0), STEP)
    assert (found.value == 3.0).all()
    assert not found.rate.any()
    assert not found.covariance.any()


def test_a_constant_that_arithmetic_has_rounded_is_smoothed():
    rounded = smoothed(15.0 + np.arange(500) % 13 * np.spacing(15.0), STEP)
    assert rounded.value == pytest.approx(15.0)
    assert np.abs(rounded.rate).max() < 1e-9


def test_resolution_and_runs():
    rng = np.random.default_rng(1)
    assert resolution_of(np.round(rng.normal(size=500) / 0.05) * 0.05) == pytest.approx(0.05)
    assert resolution_of(np.where(TIME > 30.0, 1.0, 0.0)) == 0.0
    assert resolution_of(rng.normal(size=500)) == 0.0
    runs = run_lengths(np.array([1.0, 1.0, np.nan, 1.0, 2.0, 3.0, 3.0]))
    assert runs.tolist() == [3, 3, 1, 3, 1, 2, 2]


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="four"):
        smoothed(np.array([1.0, 2.0, np.nan, 3.0]), STEP)
