"""The unscented filter: its weights, the moments they reproduce, its settings."""

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import UserError
from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.methods.ukf import Settings, tuning
from harness.testing.small_models import compiled_linear, linear
from support.small_maps import discrete, disguised, linear_in_disguise, quadratic, squared_output
from support.stepping import Stepper, textbook

CHOICES = [{}, {"alpha": 0.5}, {"alpha": 1.0, "kappa": 2.0, "beta": 0.0}, {"alpha": 0.1, "kappa": 1.0, "beta": 3.0}]


@pytest.mark.parametrize("chosen", CHOICES)
@pytest.mark.parametrize("nx", [1, 3, 11])
def test_weights(chosen, nx):
    """Means of constants and covariances of linear maps are exact; (2.20, 2.21) as written."""
    distance, w0m, w0c, wi = tuning(Settings(**chosen), nx, 1)
    s = Settings(**chosen)
    lam = s.alpha**2 * (nx + s.kappa) - nx
    assert w0m + 2 * nx * wi == pytest.approx(1, abs=1e-12)
    assert 2 * wi * distance**2 == pytest.approx(1, abs=1e-12)
    first = lam / (nx + lam)
    assert [w0m, w0c, wi] == pytest.approx([first, first + 1 - s.alpha**2 + s.beta, 0.5 / (nx + lam)])
    assert distance**2 == pytest.approx(nx + lam)


@pytest.mark.parametrize("chosen", CHOICES)
def test_moments_of_a_linear_map_are_exact(chosen):
    q, step = np.array([0.1, 0.2, 0.3]), 0.1
    A = np.eye(3) + step * np.array([[-0.3 * 1.5, 1, 0], [-4, -1.5, 0], [0.5, 0, -0.2]])
    root = np.array([[1.0, 0, 0], [0.5, 2.0, 0], [-0.3, 0.4, 0.7]])
    P, x = root @ root.T, np.array([1.0, -2.0, 3.0])
    mean, covariance = Stepper("ukf", linear(), q, [1.0, 1.0], chosen, [1.5], step).predict(x, P, 0.7)
    np.testing.assert_allclose(mean, A @ x + [0, step * 0.7, 0], atol=1e-10)
    np.testing.assert_allclose(covariance, A @ P @ A.T + np.diag(q), atol=1e-9)


@pytest.mark.parametrize("chosen", CHOICES)
def test_moments_of_a_quadratic_map(chosen):
    """f = 2 x + 0.7 x^2: mean and first-order variance are exact, the second order is what the weights make of it.

    Written out for one state, the variance is ``(2 + 1.4 m)^2 s^2 + 0.49 (c - alpha^2 + beta) s^4`` with c the square
    of the distance; a normal distribution has 2 in place of the bracket.
    """
    m, variance = 0.6, 0.25
    s = Settings(**chosen)
    mean, covariance = Stepper("ukf", quadratic(), [0.0], [1.0], chosen).predict([m], [variance])
    assert mean[0] == pytest.approx(2 * m + 0.7 * (m**2 + variance), abs=1e-12)
    bracket = s.alpha**2 * (1 + s.kappa) - s.alpha**2 + s.beta
    expected = (2 + 1.4 * m) ** 2 * variance + 0.49 * bracket * variance**2
    assert covariance[0, 0] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("chosen", [CHOICES[0], CHOICES[2]])
def test_the_second_moment_is_that_of_a_normal_distribution(chosen):
    """The thesis's setting (beta = 2) and the classical one (three sigma in all) are exact for one state."""
    m, variance = 0.6, 0.25
    _, covariance = Stepper("ukf", quadratic(), [0.0], [1.0], chosen).predict([m], [variance])
    normal = (2 + 1.4 * m) ** 2 * variance + 2 * 0.49 * variance**2
    assert covariance[0, 0] == pytest.approx(normal, abs=1e-12)


def test_update_through_a_quadratic_output():
    """y = x^2 of a normal x: predicted m^2 + P, variance 4 m^2 P + 2 P^2 + R, covariance with the state 2 m P."""
    m, P, q, r, y = 1.5, 0.2, 0.05, 0.3, 3.1
    mean, covariance, info = Stepper("ukf", squared_output(), [q], [r]).update([m], [P], [y])
    P = P + q
    S, cross = 4 * m**2 * P + 2 * P**2 + r, 2 * m * P
    assert info.innovation[0, 0] == pytest.approx(y - m**2 - P, abs=1e-12)
    assert info.innovation_covariance[0, 0, 0] == pytest.approx(S, abs=1e-12)
    assert mean[0] == pytest.approx(m + cross / S * (y - m**2 - P), abs=1e-12)
    assert covariance[0, 0] == pytest.approx(P - cross**2 / S, abs=1e-12)
    assert info.nis[0, 0] == pytest.approx((y - m**2 - P) ** 2 / S, abs=1e-12)


@pytest.mark.parametrize("kind", ["ukf", "cdkf"])
def test_redrawn_points_equal_the_textbook_where_outputs_are_linear(kind):
    """Outputs that the compiler cannot know to be linear take the general update; it must lose nothing."""
    assert not compile_model(linear_in_disguise()).kernels.OUTPUTS_ARE_LINEAR
    rng = np.random.default_rng(9)
    u, y = rng.normal(size=(50, 1)), rng.normal(size=(50, 2)) * 0.5
    q, r, p0 = [1e-2, 2e-2], [0.1, 0.3], [1.0, 2.0]
    means, covariances, _, infos = Stepper(kind, linear_in_disguise(), q, r).run([0.3, 0.1], p0, u, y + 50)
    expected = textbook(disguised, q, r, [0.3, 0.1], p0, u, y)
    np.testing.assert_allclose(means, expected[0], atol=1e-10)
    np.testing.assert_allclose(covariances, expected[1], atol=1e-10)
    assert sum(i.repairs.sum() for i in infos) == 0


@pytest.mark.parametrize("kind", ["ukf", "cdkf", "st_cdkf"])
def test_more_nonlinear_outputs_than_states(kind):
    """Three outputs of one state: the update equals that of the one output they amount to."""

    def ahead(v, x, u):
        for port in ("product_test", "second_product_test"):
            v.port(port, sp.Abs(x[0] + 50))
        return [x[0]]

    several = discrete(1, ahead, ["product_test", "second_product_test", "alpha_test"])
    off = {"fading": False} if kind == "st_cdkf" else {}
    mean, covariance, info = Stepper(kind, several, [0.0], [0.2, 0.3, 0.5], off).update([0.0], [2.0], [51.0, 51.5, 0.7])
    information = 1 / 2.0 + 1 / 0.2 + 1 / 0.3 + 1 / 0.5
    assert covariance[0, 0] == pytest.approx(1 / information, rel=1e-10)
    assert mean[0] == pytest.approx((1.0 / 0.2 + 1.5 / 0.3 + 0.7 / 0.5) / information, rel=1e-10)
    assert info.seen[0, 0] == 3


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"alpha": 0}, "greater than 0"),
        ({"kappa": -3}, r"alpha\^2 \(n \+ kappa\) = 0 must be positive; raise kappa above -3"),
        ({"alpha": 1e300}, "too large or too small to reckon with"),
        ({"kapa": 1}, "kapa"),
        ({"beta": "two"}, "beta"),
    ],
)
def test_wrong_settings_are_refused(wrong, says):
    with pytest.raises(UserError, match=f"settings of estimator 'ukf'(.|\n)*{says}"):
        CompiledEstimator("ukf", compiled_linear(), wrong)
