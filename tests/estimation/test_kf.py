"""The linear Kalman filter: the lecture's numbers, its two limits, and its linearisation about straight driving."""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from harness.models.assembly.assemble import assemble
from harness.models.parameters import kit_2015a, kit_2015b
from harness.testing.small_models import RATE, curved, module
from support.small_maps import discrete
from support.stepping import Stepper, textbook


def example():
    """Return the lecture's scalar filter (exercise 1)."""
    model = assemble("scalar_example", sensors="example")
    q, r = kit_2015a.PROCESS_NOISE["example_state"], kit_2015a.MEASUREMENT_NOISE["example_state"]
    return Stepper("kf", model, [q], [r], parameters=[kit_2015a.VALUES["transition"]])


def by_hand(samples):
    """Return predicted variance, gain and variance of exercise 1 as fractions, by the recursion of the lecture."""
    P, rows = Fraction(10), []
    for _ in range(samples):
        ahead = P / 4 + 1
        K = ahead / (ahead + 1)
        P = (1 - K) ** 2 * ahead + K**2
        rows.append((ahead, K, P))
    return rows


def test_the_recursion_by_hand_begins_as_the_lecture():
    rows = by_hand(4)
    assert rows[0][:2] == (Fraction(7, 2), Fraction(7, 9))
    assert float(rows[0][1]) == pytest.approx(0.7778, abs=5e-5)
    assert all(K == P for _, K, P in rows)  # because R = 1


def test_gains_of_the_scalar_example():
    """The gain is what a unit of innovation moves the state by."""
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=(5, 1)), rng.normal(size=(5, 1))
    means, covariances, _, infos = example().run([0.0], [10.0], u, y)
    x = 0.0
    for k, (ahead, K, P) in enumerate(by_hand(4)):
        predicted = 0.5 * x + u[k, 0]
        innovation = infos[k].innovation[0, 0]
        assert innovation == pytest.approx(y[k + 1, 0] - predicted, abs=1e-14)
        assert (means[k, 0] - predicted) / innovation == pytest.approx(float(K), abs=1e-12)
        assert infos[k].innovation_covariance[0, 0, 0] == pytest.approx(float(ahead + 1), abs=1e-12)
        assert covariances[k, 0, 0] == pytest.approx(float(P), abs=1e-12)
        x = means[k, 0]


def test_the_stationary_gain_is_the_root_of_the_lecture():
    """P = f(P) gives 0.25 P^2 + 1.75 P - 1 = 0, and K = P because R = 1."""
    _, covariances, _, _ = example().run([0.0], [10.0], np.zeros((40, 1)), np.zeros((40, 1)))
    root = max(np.roots([0.25, 1.75, -1.0]).real)
    assert root == pytest.approx(0.5311, abs=5e-5)
    assert covariances[-1, 0, 0] == pytest.approx(root, abs=1e-12)


HEADING = assemble("vehicle_heading", sensors="gyro_heading")


def turning(q, r, samples=200):
    """Return increments of the encoders, gyro headings and true headings of a turn."""
    rng = np.random.default_rng(4)
    true = np.cumsum(0.01 * np.sin(0.05 * np.arange(samples)))
    increments = np.diff(true, append=true[-1:]) + rng.normal(size=samples) * q**0.5
    return increments[:, None], (true + rng.normal(size=samples) * r**0.5)[:, None], true


def test_noisy_encoders_leave_the_gyro():
    u, y, _ = turning(1e-2, 1e-4)
    means, covariances, _, _ = Stepper("kf", HEADING, [1e-2 * 1e8], [1e-4]).run([0.0], [1.0], u, y)
    np.testing.assert_allclose(means[:, 0], y[1:, 0], atol=1e-8)
    np.testing.assert_allclose(covariances[:, 0, 0], 1e-4, rtol=1e-6)


def test_a_noisy_gyro_leaves_the_sum_of_the_encoders():
    u, y, _ = turning(1e-6, 1.0)
    means, _, _, _ = Stepper("kf", HEADING, [1e-6], [1e12]).run([0.3], [1e-6], u, y)
    np.testing.assert_allclose(means[:, 0], 0.3 + np.cumsum(u[:-1, 0]), atol=1e-12)


def test_both_together_beat_each_alone():
    q, r = kit_2015b.PROCESS_NOISE["heading"], kit_2015b.MEASUREMENT_NOISE["heading"]
    u, y, true = turning(q, r, 4000)
    means, covariances, _, _ = Stepper("kf", HEADING, [q], [r]).run([true[0]], [q], u, y)
    spread = lambda estimate: np.sqrt(np.mean((estimate - true[1:]) ** 2))  # noqa: E731
    fused, gyro, encoders = spread(means[:, 0]), spread(y[1:, 0]), spread(true[0] + np.cumsum(u[:-1, 0]))
    assert fused < 0.4 * min(gyro, encoders)
    assert fused == pytest.approx(covariances[-1, 0, 0] ** 0.5, rel=0.1)  # and it knows how good it is


def test_the_linearisation_follows_the_known_input():
    """A model that is linear for every input: the filter is the textbook's with A(n), B(n) u(n) and C(n)."""

    def matrices(u):
        A = np.array([[1 - 0.1 * u[0], 0.1], [-0.2 * u[0] ** 2, 0.9]])
        return A, np.array([np.sin(u[0]), u[0]]), np.array([[1.0, 0.0], [u[0], 1.0]])

    def ahead(v, x, u):
        v.port("product_test", u * x[0] + x[1])
        return [x[0] - 0.1 * u * x[0] + 0.1 * x[1] + sp.sin(u), 0.9 * x[1] - 0.2 * u**2 * x[0] + u]

    model = discrete(2, ahead, measured=("alpha_test", "product_test"))
    rng = np.random.default_rng(6)
    u, y = rng.normal(size=(60, 1)), rng.normal(size=(60, 2))
    q, r, p0 = [1e-2, 3e-2], [0.1, 0.4], [1.0, 2.0]
    means, covariances, _, _ = Stepper("kf", model, q, r).run([0.5, -1.0], p0, u, y)
    expected = textbook(matrices, q, r, [0.5, -1.0], p0, u, y)
    np.testing.assert_allclose(means, expected[0], atol=1e-10)
    np.testing.assert_allclose(covariances, expected[1], atol=1e-10)


@pytest.mark.parametrize("name", ["kf", "ekf"])
def test_a_nonlinear_model_is_linearised_at_zero_and_nowhere_else(name):
    """On the small pendulum: the filter of the tangent at zero, whatever the estimate is. The EKF is not."""
    step, rate = 0.05, 2.0

    def matrices(u):
        A = np.eye(2) + step * np.array([[0.0, 1.0], [-rate, 0.0]])
        return A, np.array([0.0, step * u[0]]), np.array([[0.3, 0.0]])

    rng = np.random.default_rng(7)
    u, y = rng.normal(size=(40, 1)), 1 + 0.3 * rng.normal(size=(40, 1))
    q, r, p0, start = [1e-4, 1e-3], [0.01], [0.1, 0.1], [0.8, 0.2]
    stepper = Stepper(name, curved(), q, r, parameters=[rate], step=step)
    means, covariances, _, _ = stepper.run(start, p0, u, y)
    expected = textbook(matrices, q, r, start, p0, u, y - 1.0)  # the output at zero is exp(0) = 1
    same = np.allclose(means, expected[0], atol=1e-10) and np.allclose(covariances, expected[1], atol=1e-10)
    assert same == (name == "kf")


def test_an_unknown_input_is_zero_where_it_is_linearised():
    """A gain times an unknown input: the filter of a model in which the input acts by its slope at zero."""

    def equations(v):
        v.derivative(
            "alpha_test", v.input("push_test") * (1 + v.state("alpha_test")) - v.p("rate") * v.state("alpha_test")
        )

    vehicle = module(
        "unknown", STATES=("alpha_test",), INPUTS=("push_test",), PARAMETERS=(RATE,), AXLES={}, VALID={},
        equations=equations,
    )  # fmt: skip
    model = assemble(vehicle, sensors=module("sensors", OUTPUTS={"alpha_test": "alpha_test"})).augment(["push_test"])
    A, C = np.array([[1 - 0.1 * 1.5, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    y = np.random.default_rng(8).normal(size=(30, 1))
    q, r, p0 = [1e-3, 1e-1], [0.05], [1.0, 1.0]
    means, _, _, _ = Stepper("kf", model, q, r, parameters=[1.5]).run([2.0, 1.0], p0, np.empty((30, 0)), y)
    expected, _ = textbook(lambda u: (A, np.zeros(2), C), q, r, [2.0, 1.0], p0, np.empty((30, 0)), y)
    np.testing.assert_allclose(means, expected, atol=1e-10)
