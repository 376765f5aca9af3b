"""The central-difference filter against closed moments, the strong-tracking filter against its equations."""

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import UserError
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.methods import cdkf, st_cdkf
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import curved, linear
from support.small_maps import discrete, disguised, linear_in_disguise, quadratic, squared_output
from support.stepping import Stepper, textbook

OFF = {"fading": False}
INTERVALS = [1.0, 2.0, 3.0]


@pytest.mark.parametrize("square", INTERVALS)
@pytest.mark.parametrize("nx", [1, 3, 11])
def test_weights(square, nx):
    """(12) with its two weights separated; constants keep their mean, linear maps their covariance."""
    h, w0m, wim, first, second = cdkf.tuning(cdkf.Settings(interval_squared=square), nx, 1)
    assert h**2 == pytest.approx(square)
    assert w0m + 2 * nx * wim == pytest.approx(1, abs=1e-12)
    assert [w0m, wim] == pytest.approx([(square - nx) / square, 1 / (2 * square)])
    assert [first**2, second**2] == pytest.approx([1 / (4 * square), (square - 1) / (4 * square**2)])
    assert first**2 * (2 * h) ** 2 == pytest.approx(1)
    assert st_cdkf.tuning(st_cdkf.Settings(interval_squared=square), nx, 1)[:5] == [h, w0m, wim, first, second]


@pytest.mark.parametrize("square", INTERVALS)
@pytest.mark.parametrize("states", [1, 2])
def test_moments_of_a_quadratic_map(square, states):
    """f = 2 x + 0.7 x^2: the mean is exact; the variance is for h^2 = 3, as the fourth moment of a normal x is 3."""
    m, variance = np.array([0.6, -0.2])[:states], np.array([0.25, 0.5])[:states]
    chosen = {"interval_squared": square}
    mean, covariance = Stepper("cdkf", quadratic(states), [0.0] * states, [1.0], chosen).predict(m, variance)
    np.testing.assert_allclose(mean, 2 * m + 0.7 * (m**2 + variance), atol=1e-12)
    exact = (2 + 1.4 * m) ** 2 * variance + (square - 1) * 0.49 * variance**2
    np.testing.assert_allclose(covariance, np.diag(exact), atol=1e-12)


def test_a_cubic_map_is_right_to_the_fourth_order():
    """x^3 of a normal x: mean m^3 + 3 m s^2 exactly; of the variance only 15 s^6 is cut to 9 s^6 (h^2 = 3)."""
    m, s = 0.6, 0.5
    model = discrete(1, lambda v, x, u: [x[0] ** 3], ["alpha_test"])
    mean, covariance = Stepper("cdkf", model, [0.0], [1.0]).predict([m], [s**2])
    assert mean[0] == pytest.approx(m**3 + 3 * m * s**2, abs=1e-12)
    assert covariance[0, 0] == pytest.approx(9 * m**4 * s**2 + 36 * m**2 * s**4 + 9 * s**6, abs=1e-12)


def test_a_product_of_correlated_states_has_its_mean():
    """E(x y) = E(x) E(y) + cov(x, y) comes from the second differences along the columns of the factor."""
    model = discrete(2, lambda v, x, u: [x[0] * x[1], x[1] + u], ["beta_test"])
    mean, _ = Stepper("cdkf", model, [0.0, 0.0], [1.0]).predict([1.0, 2.0], [[0.5, 0.3], [0.3, 0.4]])
    assert mean[0] == pytest.approx(1.0 * 2.0 + 0.3, abs=1e-12)


def test_noise_is_added_to_the_prediction_and_not_scaled():
    model = discrete(2, lambda v, x, u: [x[0] + x[1], x[1]], ["alpha_test"])
    _, covariance = Stepper("cdkf", model, [0.1, 0.2], [1.0]).predict([0.0, 0.0], [1.0, 2.0])
    np.testing.assert_allclose(covariance, [[3.1, 2.0], [2.0, 2.2]], atol=1e-12)


@pytest.mark.parametrize(("kind", "chosen"), [("cdkf", {}), ("st_cdkf", OFF)])
def test_update_through_a_quadratic_output(kind, chosen):
    """y = x^2 of a normal x: the weight 1 / (4 h^2) of the print (27) would halve the gain."""
    m, P, q, r, y = 1.5, 0.2, 0.05, 0.3, 3.1
    mean, covariance, info = Stepper(kind, squared_output(), [q], [r], chosen).update([m], [P], [y])
    P = P + q
    S, cross = 4 * m**2 * P + 2 * P**2 + r, 2 * m * P
    assert info.innovation[0, 0] == pytest.approx(y - m**2 - P, abs=1e-12)
    assert info.innovation_covariance[0, 0, 0] == pytest.approx(S, abs=1e-12)
    assert mean[0] == pytest.approx(m + cross / S * (y - m**2 - P), abs=1e-12)
    assert covariance[0, 0] == pytest.approx(P - cross**2 / S, abs=1e-12)


# --- strong tracking


def strong_tracking(matrices, q, r, start, variances, u, y, forgetting=0.95, softening=1.0):
    """Li et al. (16) to (22), (32) to (34) on a linear model with full matrices; each output in units of its noise."""
    x, P, Q, R = np.array(start), np.diag(variances), np.diag(q), np.diag(r)
    V = np.full((len(r), len(r)), np.nan)
    means, covariances, factors = [], [], []
    for k in range(1, len(y)):
        (A, b, _), (_, _, C) = matrices(u[k - 1]), matrices(u[k])
        x, prior = A @ x + b, A @ P @ A.T + Q
        residual = y[k] - C @ x
        seen = ~np.isnan(residual)
        newest = np.outer(residual, residual)
        earlier = np.where(np.isnan(V), C @ prior @ C.T + R, V)  # where (22) begins with the first residual
        newest = (forgetting * earlier + newest) / (1 + forgetting)
        V = np.where(np.isnan(newest), V, newest)
        cross = prior @ C.T
        inverse = np.linalg.inv(prior)
        N = V - softening * R - cross.T @ inverse @ Q @ inverse @ cross  # (19)
        M = C @ (prior - Q) @ inverse @ cross  # its trace is that of (20)
        total = lambda matrix: np.sum((np.diag(matrix) / r)[seen])  # noqa: B023, E731
        c = total(N) / total(M) if seen.any() else 0.0
        factors.append(max(c, 1.0))
        P = factors[-1] * (prior - Q) + Q
        H = C[seen]
        S = H @ P @ H.T + R[np.ix_(seen, seen)]
        K = P @ H.T @ np.linalg.inv(S)
        x, rest = x + K @ residual[seen], np.eye(len(x)) - K @ H
        P = rest @ P @ rest.T + K @ R[np.ix_(seen, seen)] @ K.T  # fading would amplify the rounding of P - K S K'
        P = (P + P.T) / 2
        means.append(x)
        covariances.append(P)
    return np.array(means), np.array(covariances), np.array(factors)


def test_one_output_is_the_print_letter_by_letter():
    """Without units of noise (one output): N and M of (19) and (20) as they stand."""
    rng = np.random.default_rng(12)
    P, Q, C = np.diag([1.0, 2.0]) + 0.3, np.diag([0.1, 0.2]), rng.normal(size=(1, 2))
    cross, inverse = P @ C.T, np.linalg.inv(P)
    printed = (P - Q) @ inverse @ cross @ cross.T @ inverse
    assert np.trace(printed) == pytest.approx(np.trace(C @ (P - Q) @ C.T))
    assert (cross.T @ inverse @ Q @ inverse @ cross) == pytest.approx(C @ Q @ C.T)


LINEAR = linear()


def sampled(u):
    A = np.eye(3) + 0.05 * np.array([[-0.3 * 1.5, 1, 0], [-4, -1.5, 0], [0.5, 0, -0.2]])
    return A, np.array([0.0, 0.05 * u[0], 0.0]), np.array([[1.0, 0, 0], [0, 0, 1.0]])


def drive(samples, nu=1, gaps=False):
    rng = np.random.default_rng(13)
    u, y = rng.normal(size=(samples, nu)), rng.normal(size=(samples, 2)) * 0.3
    y[samples // 2 :] += 2.0  # a jump
    if gaps:
        y[1, 1] = y[7, 0] = y[10] = y[20:25] = np.nan
    return u, y


@pytest.mark.parametrize("settings", [{}, {"forgetting": 0.5, "softening": 3.0}])
@pytest.mark.parametrize("gaps", [False, True])
def test_fading_follows_its_equations(settings, gaps):
    """Closed-form update, more than one output, samples missing."""
    u, y = drive(60, gaps=gaps)
    q, r, p0 = [1e-3, 2e-3, 5e-4], [1e-2, 4e-2], [0.5, 1.0, 2.0]
    stepper = Stepper("st_cdkf", LINEAR, q, r, settings, [1.5], 0.05)
    means, covariances, _, _ = stepper.run([0.0] * 3, p0, u, y)
    expected = strong_tracking(sampled, q, r, [0.0] * 3, p0, u, y, **settings)
    assert np.sum(expected[2] > 1) > 3
    assert np.sum(expected[2] == 1) > 0  # both branches of (17)
    np.testing.assert_allclose(means, expected[0], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(covariances, expected[1], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("gaps", [False, True])
def test_fading_follows_its_equations_with_redrawn_points(gaps):
    """Nonlinear outputs in the code, linear in fact: slopes come from the points (19), which are drawn twice."""
    u, y = drive(60, gaps=gaps)
    q, r, p0 = [1e-2, 2e-2], [0.1, 0.3], [1.0, 2.0]
    means, covariances, _, _ = Stepper("st_cdkf", linear_in_disguise(), q, r).run([0.3, 0.1], p0, u, y + 50)
    expected = strong_tracking(disguised, q, r, [0.3, 0.1], p0, u, y)
    assert np.sum(expected[2] > 1) > 3
    np.testing.assert_allclose(means, expected[0], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(covariances, expected[1], rtol=1e-10, atol=1e-10)


def test_memory_holds_residual_variances():
    u, y = drive(6)
    y[3, 1] = np.nan
    stepper = Stepper("st_cdkf", LINEAR, [1e-3] * 3, [1e-2, 4e-2], {}, [1.5], 0.05)
    _, _, memories, infos = stepper.run([0.0] * 3, [1.0] * 3, u, y)
    residuals = np.array([i.innovation[:, 0] for i in infos])
    A, _, C = sampled(u[0])
    first = np.diag(C @ (A @ A.T + 1e-3 * np.eye(3)) @ C.T) + np.array([1e-2, 4e-2])  # what the filter expects
    assert memories[0] == pytest.approx((0.95 * first + residuals[0] ** 2) / 1.95)
    assert memories[1] == pytest.approx((0.95 * memories[0] + residuals[1] ** 2) / 1.95)
    assert memories[2, 1] == memories[1, 1]  # not measured, not followed


def test_one_large_first_residual_does_not_fade_what_is_known():
    """At the start the covariance is that of one step; (22) as printed would multiply it by thousands."""
    u, y = drive(3)
    y[1] = 3.5 * np.sqrt([0.25, 0.25])  # 3.5 standard deviations, once
    stepper = Stepper("st_cdkf", LINEAR, [1e-6] * 3, [0.25, 0.25], {"softening": 10.0}, [1.5], 0.05)
    plain = Stepper("cdkf", LINEAR, [1e-6] * 3, [0.25, 0.25], {}, [1.5], 0.05)
    start = [0.0] * 3, [1e-6] * 3, u[:2], y[:2]
    np.testing.assert_array_equal(stepper.run(*start)[1], plain.run(*start)[1])


def test_the_units_of_an_output_do_not_matter():
    u, y = drive(60)
    q, p0 = [1e-2, 2e-2], [1.0, 2.0]
    means = {}
    for scale in (1.0, 1000.0):
        stepper = Stepper("st_cdkf", linear_in_disguise(scale), q, [0.1, 0.3 * scale**2])
        means[scale] = stepper.run([0.3, 0.1], p0, u, (y + 50) * [1.0, scale])[0]
    np.testing.assert_allclose(means[1000.0], means[1.0], rtol=1e-10, atol=1e-10)


def two_runs(model, parameters, nx, ny, first, second):
    """Return the states and infos of two filters over the same noisy run, all lanes different."""
    compiled = compile_model(model, 0.05)
    rng = np.random.default_rng(14)
    results = []
    u, y = rng.normal(size=(40, 1, LANES)), 1 + rng.normal(size=(40, ny, LANES))
    y[5:9, :, 2] = np.nan
    for kind, settings in (first, second):
        estimator = CompiledEstimator(kind, compiled, settings)
        constants = compiled.constants(in_lanes(np.array(parameters)))
        belief = estimator.belief(constants, in_lanes(np.full(nx, 1e-3)), in_lanes(np.full(ny, 0.05)))
        state, found = estimator.init(np.full(nx, 0.1), np.full(nx, 0.5)), []
        for k in range(1, 40):
            state, info = estimator.step(state, u[k - 1], u[k], y[k], belief)
            found += [state.mean, state.covariance, *info]
        results.append(found)
    return results


@pytest.mark.parametrize(("model", "nx", "ny"), [(LINEAR, 3, 2), (curved(), 2, 1)], ids=["linear", "curved"])
def test_without_fading_it_is_the_cdkf_bit_for_bit(model, nx, ny):
    plain, off = two_runs(model, [1.5], nx, ny, ("cdkf", {}), ("st_cdkf", OFF))
    for a, b in zip(plain, off, strict=True):
        np.testing.assert_array_equal(a, b)
    never = ("st_cdkf", {"softening": 1e12})  # the factor is computed and always 1
    _, calm = two_runs(model, [1.5], nx, ny, ("cdkf", {}), never)
    for a, b in zip(plain, calm, strict=True):
        np.testing.assert_array_equal(a, b)
    _, fading = two_runs(model, [1.5], nx, ny, ("cdkf", {}), ("st_cdkf", {}))
    assert any(not np.array_equal(a, b, equal_nan=True) for a, b in zip(plain, fading, strict=True))


def test_without_fading_it_equals_the_textbook_filter():
    u, y = drive(60)
    q, r, p0 = [1e-3, 2e-3, 5e-4], [1e-2, 4e-2], [0.5, 1.0, 2.0]
    means, covariances, _, _ = Stepper("st_cdkf", LINEAR, q, r, OFF, [1.5], 0.05).run([0.0] * 3, p0, u, y)
    expected = textbook(sampled, q, r, [0.0] * 3, p0, u, y)
    np.testing.assert_allclose(means, expected[0], atol=1e-10)
    np.testing.assert_allclose(covariances, expected[1], atol=1e-10)


def test_a_lane_that_fades_leaves_its_neighbours_alone():
    """With a nonlinear output the points are redrawn for all lanes as soon as one fades."""
    compiled = compile_model(curved(), 0.05)
    estimator = CompiledEstimator("st_cdkf", compiled)
    constants = compiled.constants(in_lanes(np.array([1.5])))
    belief = estimator.belief(constants, in_lanes(np.full(2, 1e-3)), in_lanes(np.array([0.05])))
    state, u, y = estimator.init(np.full(2, 0.1), np.full(2, 0.5)), np.zeros((1, LANES)), np.full((1, LANES), 1.1)
    calm, calm_info = estimator.step(state, u, u, y, belief)
    y[0, 3] = 30.0
    mixed, mixed_info = estimator.step(state, u, u, y, belief)
    others = [i for i in range(LANES) if i != 3]
    for a, b in zip((*calm, *calm_info), (*mixed, *mixed_info), strict=True):
        np.testing.assert_array_equal(a[..., others], b[..., others])
    assert mixed.covariance[0, 0, 3] != calm.covariance[0, 0, 3]


def test_a_jump_of_a_parameter_is_followed_faster_with_fading():
    """x(n+1) = 0.8 x + k u with the gain k believed to wander slowly; it falls from 1 to 0.4 at once."""
    model = discrete(2, lambda v, x, u: [sp.Rational(4, 5) * x[0] + x[1] * u, x[1]], ["alpha_test"])
    rng = np.random.default_rng(15)
    samples, jump, q, r = 400, 200, np.array([1e-4, 1e-7]), np.array([1e-2])
    u, gain = np.ones((samples, 1, LANES)), np.where(np.arange(samples) < jump, 1.0, 0.4)
    x, y = np.full(LANES, 5.0), np.empty((samples, 1, LANES))
    for k in range(samples):
        y[k, 0] = x + rng.normal(size=LANES) * r[0] ** 0.5
        x = 0.8 * x + gain[k] * u[k, 0] + rng.normal(size=LANES) * q[0] ** 0.5
    compiled = compile_model(model)
    found = {}
    for kind, settings in (("cdkf", {}), ("st_cdkf", {}), ("st_cdkf", {"softening": 5.0})):
        estimator = CompiledEstimator(kind, compiled, settings)
        belief = estimator.belief(compiled.constants(np.empty((0, LANES))), in_lanes(q), in_lanes(r))
        state, estimates = estimator.init(np.array([5.0, 1.0]), np.array([0.1, 0.01])), np.empty((samples, LANES))
        for k in range(1, samples):
            state, _ = estimator.step(state, u[k - 1], u[k], y[k], belief)
            estimates[k] = state.mean[1]
        error = np.abs(estimates - gain[:, None])
        # samples until half of the jump is made good, and the error before the jump
        found[kind, len(settings)] = np.argmax(error[jump + 1 :] < 0.3, axis=0).mean(), error[50:jump].mean()
    plain, faded, softened = found["cdkf", 0], found["st_cdkf", 0], found["st_cdkf", 1]
    assert plain[0] > 30
    assert faded[0] < 0.2 * plain[0]
    assert softened[0] < 0.2 * plain[0]
    assert softened[1] < faded[1]  # softening buys back the accuracy in quiet times


@pytest.mark.parametrize(
    ("kind", "wrong", "says"),
    [
        ("cdkf", {"interval_squared": 0.9}, "greater than or equal to 1"),
        ("cdkf", {"interval_squared": float("inf")}, "finite"),
        ("cdkf", {"h": 1.7}, "h"),
        ("st_cdkf", {"interval_squared": 0.9}, "greater than or equal to 1"),
        ("st_cdkf", {"forgetting": 0.0}, "greater than 0"),
        ("st_cdkf", {"forgetting": 1.1}, "less than or equal to 1"),
        ("st_cdkf", {"softening": 0.5}, "greater than or equal to 1"),
        ("st_cdkf", {"fading": "perhaps"}, "fading"),
    ],
)
def test_wrong_settings_are_refused(kind, wrong, says):
    with pytest.raises(UserError, match=f"settings of estimator '{kind}'(.|\n)*{says}"):
        CompiledEstimator(kind, compile_model(LINEAR, 0.05), wrong)
