"""The noise of an output at rest: at once, sample by sample, and from a recording."""

import numpy as np
import pytest
import xarray as xr

from harness.common.errors import UserError
from harness.recordings.noise_at_rest import Running, batch, noise_at_rest

SAMPLES = np.random.default_rng(2).multivariate_normal([1e6, -3.0], [[4.0, 1.0], [1.0, 0.5]], size=500)


def running(samples):
    state = Running.start(samples.shape[1])
    for sample in samples:
        state = state.add(sample)
    return state.noise()


def test_all_at_once_is_mean_and_covariance():
    found = batch(SAMPLES)
    np.testing.assert_allclose(found.mean, SAMPLES.mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(found.covariance, np.cov(SAMPLES.T), rtol=1e-12)
    np.testing.assert_array_equal(found.variances, np.diag(found.covariance))
    # 500 samples: the relative standard error of a variance is sqrt(2 / 499) = 6 %
    np.testing.assert_allclose(found.variances, [4.0, 0.5], rtol=0.2)


def test_the_recursive_form_agrees_far_from_zero_and_with_missing_samples():
    gappy = SAMPLES.copy()
    gappy[3, 0] = gappy[50:60, 1] = np.nan
    at_once, one_by_one = batch(gappy), running(gappy)
    assert at_once.samples == one_by_one.samples == 489
    np.testing.assert_allclose(one_by_one.mean, at_once.mean, rtol=1e-13)
    np.testing.assert_allclose(one_by_one.covariance, at_once.covariance, rtol=1e-9)


def test_adding_changes_nothing():
    first = Running.start(2).add(SAMPLES[0])
    kept = first.mean.copy(), first.scatter.copy()
    first.add(SAMPLES[1])
    np.testing.assert_array_equal(first.mean, kept[0])
    np.testing.assert_array_equal(first.scatter, kept[1])


@pytest.mark.parametrize("estimate", [batch, running])
def test_one_sample_has_no_covariance(estimate):
    with pytest.raises(UserError, match="at least two complete samples, there are 1"):
        estimate(np.array([[1.0, 2.0], [np.nan, 1.0]]))


def recording(moves_from=5.0):
    time = np.arange(500) * 0.02
    speed = np.where(time >= moves_from, 3.0, 0.0)
    return xr.Dataset(
        {"yaw_rate": ("time", SAMPLES[:, 1] + speed), "speed": ("time", speed), "dead": ("time", np.full(500, 0.25))},
        coords={"time": time},
    )


def test_a_stretch_of_a_recording():
    found = noise_at_rest(recording(), ["yaw_rate"], 1.0, 4.99)
    assert found.samples == 200
    assert found.covariance[0, 0] == pytest.approx(np.var(SAMPLES[50:250, 1], ddof=1))


@pytest.mark.parametrize(
    ("outputs", "stop", "says"),
    [
        (["yaw_rate"], 9.0, "moves at 5 s"),
        (["yaw_rte"], 4.0, "no 'yaw_rte'; closest: yaw_rate"),
        (["dead"], 4.0, "'dead' has the same value in all 201 samples"),
        (["yaw_rate"], 0.0, "at least two"),
    ],
)
def test_what_is_no_rest_is_refused(outputs, stop, says):
    with pytest.raises(UserError, match=says):
        noise_at_rest(recording(), outputs, stop=stop)
