"""The ensemble filter: it tends to the Kalman filter, with the scatter of its number of members."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.testing.estimators import Ground, step_through
from harness.testing.small_models import P0, Q, R, compiled_linear, drive_linear, textbook


def stepped(members, u, y, **settings):
    """Return means, covariances and infos of lane 0 on the small linear model."""
    compiled = compiled_linear()
    estimator = CompiledEstimator("enkf", compiled, {"members": members, **settings})
    return step_through(Ground(estimator, compiled, np.array([1.5]), Q, R, P0, u, y))


def data():
    u, y, A, B, C = drive_linear()
    y[5, 0] = y[9] = y[20:30, 1] = np.nan
    return u, y, textbook(u, y, A, B, C)


def test_many_members_are_the_kalman_filter():
    """Means scatter by 1/sqrt(N) of their deviation, variances by sqrt(2/N) of themselves."""
    count, (u, y, (right, P, likelihoods)) = 4000, data()
    means, covariances, infos = stepped(count, u, y)
    deviation = np.sqrt(np.einsum("kii->ki", P))
    off = (means - right) / deviation
    assert np.sqrt(np.mean(off**2)) < 3 / np.sqrt(count)
    variances = np.einsum("kii->ki", covariances) / deviation**2
    assert np.abs(variances[1:] - 1).max() < 8 * np.sqrt(2 / count)
    assert abs(variances[1:].mean() - 1) < 2 * np.sqrt(2 / count)
    found = np.array([i.log_likelihood[0, 0] for i in infos])
    np.testing.assert_allclose(found, likelihoods, atol=0.3)
    assert abs(found.sum() - np.sum(likelihoods)) < 1.0


def test_the_error_falls_with_the_members():
    u, y, (right, _, _) = data()
    few, many = (np.sqrt(np.mean((stepped(count, u, y)[0] - right) ** 2)) for count in (20, 500))
    assert many == pytest.approx(few / 5, rel=0.5)


def test_inflation_widens_what_is_stated():
    u, y, _ = data()
    plain, wide = (stepped(200, u, y, inflation=factor)[1] for factor in (1.0, 1.1))
    assert np.all(np.trace(wide[5:], axis1=1, axis2=2) > 1.05 * np.trace(plain[5:], axis1=1, axis2=2))


@pytest.mark.parametrize(
    ("wrong", "says"), [({"members": 1}, "greater than or equal to 2"), ({"inflation": 0.9}, "greater than or equal")]
)
def test_wrong_settings_are_refused(wrong, says):
    with pytest.raises(UserError, match=f"settings of estimator 'enkf'(.|\n)*{says}"):
        CompiledEstimator("enkf", compiled_linear(), wrong)
