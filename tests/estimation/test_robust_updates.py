"""Robust and adaptive corrections: each against its equations, outliers, and noise of another size than believed."""

import numpy as np
import pytest
from scipy import integrate, optimize

from harness.common.errors import UserError
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.testing.estimators import Ground, step_through
from harness.testing.small_models import P0, Q, R, compiled_linear, drive_linear

HUBER, STUDENT = {"threshold": 1.345, "iterations": 100}, {"degrees": 4.0, "iterations": 100}


def stepped(kind, settings, u, y):
    """Return means, covariances and infos of an estimator on the small linear model."""
    compiled = compiled_linear()
    estimator = CompiledEstimator(kind, compiled, settings)
    return step_through(Ground(estimator, compiled, np.array([1.5]), Q, R, P0, u, y))


def with_outliers(samples=120, share=0.1, size=20.0, seed=5):
    """Return inputs and measurements of the linear model, some far off, and its matrices."""
    u, y, A, B, C = drive_linear(samples)
    rng = np.random.default_rng(seed)
    y += (rng.random(y.shape) < share) * rng.choice([-1.0, 1.0], y.shape) * size * np.sqrt(R)
    y[7, 0] = y[30] = np.nan
    return u, y, A, B, C


def priors(means, covariances, u, A, B):
    """Return what each correction began with."""
    return [(A @ x + B @ v, A @ P @ A.T + np.diag(Q)) for x, P, v in zip(means, covariances, u, strict=False)]


def corrected(x, P, y, C, r):
    """Return the textbook's correction with other variances; a missing measurement is left out."""
    seen = ~np.isnan(y)
    H, r = C[seen], r[seen]
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(r))
    rest = np.eye(3) - K @ H
    return x + K @ (y[seen] - H @ x), rest @ P @ rest.T + K @ np.diag(r) @ K.T


def test_huber_finds_the_minimum_of_its_loss():
    u, y, A, B, C = with_outliers(40)
    means, covariances, _ = stepped("huber_ekf", HUBER, u, y)
    k = HUBER["threshold"]
    for n, (x, P) in enumerate(priors(means[:-1], covariances[:-1], u, A, B), 1):
        information = np.linalg.inv(P)

        def loss(z, x=x, information=information, n=n):
            e = np.abs(np.nan_to_num(y[n] - C @ z)) / np.sqrt(R)
            rho = np.where(e <= k, 0.5 * e**2, k * e - 0.5 * k**2)
            return 0.5 * (z - x) @ information @ (z - x) + rho.sum()

        best = optimize.minimize(loss, x, method="BFGS", options={"gtol": 1e-9})
        np.testing.assert_allclose(means[n], best.x, atol=1e-5)
        weights = np.minimum(1.0, k * np.sqrt(R) / np.maximum(np.abs(np.nan_to_num(y[n] - C @ means[n])), 1e-12))
        np.testing.assert_allclose(covariances[n], corrected(x, P, y[n], C, R / weights)[1], rtol=1e-6, atol=1e-9)


def test_huber_without_large_residuals_is_the_ekf():
    u, y, *_ = with_outliers()
    plain, far = stepped("ekf", {}, u, y), stepped("huber_ekf", {"threshold": 1e6}, u, y)
    np.testing.assert_array_equal(plain[0], far[0])
    np.testing.assert_array_equal(plain[1], far[1])
    for a, b in zip(plain[2], far[2], strict=True):
        np.testing.assert_array_equal(a.nis, b.nis)
        np.testing.assert_array_equal(a.log_likelihood, b.log_likelihood)


def test_student_t_solves_its_equations():
    """At the end, weights follow from the state and the state from the weights."""
    u, y, A, B, C = with_outliers()
    means, covariances, _ = stepped("student_t_ekf", STUDENT, u, y)
    nu = STUDENT["degrees"]
    for n, (x, P) in enumerate(priors(means[:-1], covariances[:-1], u, A, B), 1):
        square = np.nan_to_num(y[n] - C @ means[n]) ** 2 + np.diag(C @ covariances[n] @ C.T)
        weights = (nu + 1) / (nu + square / R)
        mean, covariance = corrected(x, P, y[n], C, R / weights)
        np.testing.assert_allclose(means[n], mean, atol=1e-8)
        np.testing.assert_allclose(covariances[n], covariance, atol=1e-8)


@pytest.mark.parametrize("off", [0.0, 2.0, 8.0])
def test_student_t_is_near_the_exact_posterior(off):
    """One measurement of one state: the exact mean is an integral over that state."""
    nu, u, A = 4.0, np.zeros((2, 1)), drive_linear(2)[2]
    y = np.array([[np.nan, np.nan], [off * np.sqrt(R[0]), np.nan]])
    means, _, _ = stepped("student_t_ekf", STUDENT, u, y)
    variance = (A @ np.diag(P0) @ A.T + np.diag(Q))[0, 0]

    def density(z):
        return np.exp(-0.5 * z**2 / variance) * (1 + (y[1, 0] - z) ** 2 / (nu * R[0])) ** (-0.5 * (nu + 1))

    ends = {"limit": 200, "points": [0.0, y[1, 0]]}
    total, first = (integrate.quad(lambda z, p=p: z**p * density(z), -6, 6, **ends)[0] for p in (0, 1))
    assert means[1, 0] == pytest.approx(first / total, abs=0.2 * np.sqrt(R[0]))


def test_the_adaptive_filter_follows_its_equations():
    rho, rounds, (u, y, A, B, C) = 0.95, 4, with_outliers()
    means, covariances, infos = stepped("adaptive_ekf", {"forgetting": rho, "iterations": rounds}, u, y)
    x, P = np.zeros(3), np.diag(P0)
    alpha = np.full(2, 0.5 / (1 - rho))
    beta = alpha * R
    for n in range(1, len(y)):
        x, P = A @ x + B @ u[n - 1], A @ P @ A.T + np.diag(Q)
        seen = ~np.isnan(y[n])
        r = beta / alpha
        expected = C @ P @ C.T + np.diag(r)
        np.testing.assert_allclose(infos[n - 1].innovation_covariance[:, :, 0][seen][:, seen], expected[seen][:, seen])
        alpha, beta = np.where(seen, rho * alpha + 0.5, alpha), np.where(seen, rho * beta, beta)
        z, V = corrected(x, P, y[n], C, r)
        for _ in range(rounds):
            square = (y[n] - C @ z) ** 2 + np.diag(C @ V @ C.T)
            new = np.where(seen, beta + 0.5 * np.nan_to_num(square), beta)
            z, V = corrected(x, P, y[n], C, new / alpha)
        x, P, beta = z, V, new
        np.testing.assert_allclose(means[n], x, atol=1e-10)
        np.testing.assert_allclose(covariances[n], P, atol=1e-10)


def truth_and_data(samples=3000, worse=(1.0, 1.0), share=0.0):
    """Return inputs, measurements and states of the linear model with more noise, or some outliers, than believed."""
    rng, (A, B, C) = np.random.default_rng(9), drive_linear(2)[2:]
    u = rng.normal(size=(samples, 1))
    x, truth, y = np.zeros(3), np.empty((samples, 3)), np.empty((samples, 2))
    for k in range(samples):
        truth[k] = x
        y[k] = C @ x + rng.normal(size=2) * np.sqrt(R * worse) + (rng.random(2) < share) * 20 * np.sqrt(R)
        x = A @ x + B @ u[k] + rng.normal(size=3) * np.sqrt(Q)
    return u, y, truth


def errors(kind, settings, data):
    u, y, truth = data
    return np.sqrt(np.mean((stepped(kind, settings, u, y)[0] - truth)[200:, [0, 2]] ** 2, axis=0) / R)


@pytest.mark.parametrize(("kind", "cost"), [("huber_ekf", 1.035), ("student_t_ekf", 1.06), ("adaptive_ekf", 1.01)])
def test_where_all_is_as_believed_it_costs_little(kind, cost):
    data = truth_and_data()
    assert np.all(errors(kind, {}, data) < cost * errors("ekf", {}, data))


@pytest.mark.parametrize("kind", ["huber_ekf", "student_t_ekf"])
def test_outliers_hurt_less(kind):
    data = truth_and_data(share=0.05)
    assert np.all(errors(kind, {}, data) < 0.6 * errors("ekf", {}, data))


def test_the_adaptive_filter_finds_noise_that_nobody_told_it():
    """One sensor is four times as noisy as believed: it gets close to the filter that knows it."""
    u, y, truth = truth_and_data(worse=(16.0, 1.0))
    _, _, infos = stepped("adaptive_ekf", {}, u, y)
    _, _, plain = stepped("ekf", {}, u, y)
    assert np.mean([i.nis[0, 0] for i in infos[1500:]]) == pytest.approx(2.0, abs=0.2)
    assert np.mean([i.nis[0, 0] for i in plain[1500:]]) > 5
    adapted, told = errors("adaptive_ekf", {}, (u, y, truth)), errors("ekf", {}, (u, y, truth))
    assert adapted[0] < 0.8 * told[0]


@pytest.mark.parametrize(
    ("kind", "wrong", "says"),
    [
        ("huber_ekf", {"threshold": 0.0}, "greater than 0"),
        ("student_t_ekf", {"degrees": -1.0}, "greater than 0"),
        ("student_t_ekf", {"iterations": 0}, "greater than or equal to 1"),
        ("adaptive_ekf", {"forgetting": 1.0}, "less than 1"),
    ],
)
def test_wrong_settings_are_refused(kind, wrong, says):
    with pytest.raises(UserError, match=f"settings of estimator '{kind}'(.|\n)*{says}"):
        CompiledEstimator(kind, compiled_linear(), wrong)
