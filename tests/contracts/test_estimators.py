"""One suite over every estimator in ``harness/estimation/methods``."""

from typing import NamedTuple

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config.model import resolve_single
from harness.config.roles import ESTIMATORS
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import Estimator, load_estimator
from harness.simulation.simulate import in_lanes, variances
from support.linear_filter import P0, STEP, Q, R, drive_linear, textbook
from support.small_vehicles import curved, linear

NAMES = ESTIMATORS.names()
KALMAN = [n for n in NAMES if getattr(load_estimator(n), "KALMAN_TYPE", False)]
NONLINEAR = [n for n in KALMAN if not getattr(load_estimator(n), "LINEAR", False)]
# made for particular signals, so that the small linear model may be none of theirs; results that scatter with the seed
FITTED, SCATTERING = ({n for n in NAMES if hasattr(load_estimator(n), e)} for e in ("fit", "MONTE_CARLO"))


class Ground(NamedTuple):
    """A model that an estimator fits, with what it believes and data to run on."""

    compiled: CompiledModel
    parameters: np.ndarray
    q: np.ndarray
    r: np.ndarray
    p0: np.ndarray
    u: np.ndarray
    y: np.ndarray


@pytest.fixture(scope="module")
def compiled():
    return compile_model(linear(), STEP)


def ground(name, samples=80):
    """Return the small linear model, or the semitrailer for an estimator made for its signals."""
    small = compile_model(linear(), STEP, signals=("beta_test",))
    try:
        Estimator(name, small)
        u, y, *_ = drive_linear(samples)
        return Ground(small, np.array([1.5]), Q, R, P0, u, y)
    except UserError:
        if name not in FITTED:
            raise
    table = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "series"}
    spec = resolve_single(table, "test")
    truck = compile_model(spec.model(), spec.step, signals=("articulation_angle",))
    q, r = (
        variances(spec.process_noise, truck.model.states),
        variances(spec.measurement_noise, list(truck.model.outputs)),
    )
    rng = np.random.default_rng(3)
    base = np.array([10.0 if i == "speed" else 0.0 for i in truck.model.inputs])
    u, y = base + 0.1 * rng.normal(size=(samples, truck.nu)), 0.05 * rng.normal(size=(samples, truck.ny))
    return Ground(truck, truck.parameter_vector(spec.values), q, r, q, u, y)


def step_through(estimator, compiled, u, y, parameters=(1.5,), q=Q, r=R, p0=P0):
    constants = compiled.constants(in_lanes(np.array(parameters)))
    belief = estimator.belief(constants, in_lanes(q), in_lanes(r))
    state = estimator.init(np.zeros(compiled.nx), p0)
    means, covariances, infos = [state.mean[:, 0]], [state.covariance[:, :, 0]], []
    for k in range(1, len(y)):
        state, info = estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), belief)
        means.append(state.mean[:, 0])
        covariances.append(state.covariance[:, :, 0])
        infos.append(info)
    return np.array(means), np.array(covariances), infos


@pytest.mark.parametrize("name", KALMAN)
@pytest.mark.parametrize("missing", [False, True])
def test_equals_the_textbook_filter_on_a_linear_model(name, missing, compiled):
    u, y, A, B, C = drive_linear()
    if missing:
        y[5, 0] = y[9] = y[20:30, 1] = np.nan
    means, covariances, likelihoods = textbook(u, y, A, B, C)
    got_means, got_covariances, infos = step_through(Estimator(name, compiled), compiled, u, y)
    np.testing.assert_allclose(got_means, means, rtol=0, atol=1e-10)
    np.testing.assert_allclose(got_covariances, covariances, rtol=0, atol=1e-10)
    np.testing.assert_allclose([i.log_likelihood[0, 0] for i in infos], likelihoods, rtol=0, atol=1e-10)
    assert sum(i.repairs.sum() for i in infos) == 0


@pytest.mark.parametrize("name", NAMES)
def test_states_a_symmetric_positive_definite_covariance(name):
    if not load_estimator(name).HAS_COVARIANCE:
        pytest.skip("states no covariance")
    g = ground(name)
    estimator = Estimator(name, g.compiled)
    _, covariances, _ = step_through(estimator, g.compiled, g.u, g.y, g.parameters, g.q, g.r, g.p0)
    assert np.array_equal(covariances, covariances.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariances).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_changes_no_argument(name):
    g = ground(name, 3)
    estimator = Estimator(name, g.compiled)
    belief = estimator.belief(g.compiled.constants(in_lanes(g.parameters)), in_lanes(g.q), in_lanes(g.r))
    state = estimator.init(np.zeros(g.compiled.nx), g.p0)
    arguments = (state, in_lanes(g.u[0]), in_lanes(g.u[1]), in_lanes(g.y[1]), belief)
    flat = lambda: [np.copy(a) for part in arguments for a in (part if isinstance(part, tuple) else (part,))]  # noqa: E731
    before = flat()
    first, _ = estimator.step(*arguments)
    for old, new in zip(before, flat(), strict=True):
        np.testing.assert_array_equal(old, new)
    again, _ = estimator.step(*arguments)
    np.testing.assert_array_equal(first.mean, again.mean)  # no hidden attributes
    np.testing.assert_array_equal(first.covariance, again.covariance)


@pytest.mark.parametrize("name", sorted(set(NAMES) - FITTED - SCATTERING))
def test_missing_measurements_only_predict(name, compiled):
    u, y, A, B, _ = drive_linear(12)
    y[:] = np.nan
    means, covariances, infos = step_through(Estimator(name, compiled), compiled, u, y)
    x = np.zeros(3)
    for k in range(1, len(y)):
        x = A @ x + B @ u[k - 1]
        np.testing.assert_allclose(means[k], x, atol=1e-9)
    assert all(i.seen.sum() == 0 and i.log_likelihood.sum() == 0 for i in infos)
    assert np.isfinite(covariances).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("missing", [slice(0, None), slice(20, 40), slice(0, 20)])
def test_missing_measurements_leave_the_estimate_finite(name, missing):
    g = ground(name)
    y = g.y.copy()
    y[missing] = np.nan
    means, _, infos = step_through(Estimator(name, g.compiled), g.compiled, g.u, y, g.parameters, g.q, g.r, g.p0)
    assert np.isfinite(means).all()
    assert [i.seen[0, 0] for i in infos] == list((~np.isnan(y[1:])).sum(axis=1))


@pytest.mark.parametrize("name", NAMES)
def test_same_bits_alone_or_in_a_batch(name):
    """One run in lane 0 beside others equals the same run beside itself, scores included."""
    rng = np.random.default_rng(8)
    samples = 200
    g = ground(name, samples)
    estimator, names = Estimator(name, g.compiled), (*g.compiled.model.states, *g.compiled.signal_names)
    truth, scatter = (rng.normal(size=(samples, n, LANES)) for n in (len(names), g.compiled.ny))
    y = g.y[:, :, None] * (1.0 + scatter)
    u = g.u[:, :, None] * rng.uniform(0.5, 1.5, (samples, g.compiled.nu, LANES))
    parameters = g.parameters[:, None] * np.linspace(0.9, 1.1, LANES)

    def run(pick):
        of = lambda a: np.ascontiguousarray(a[..., pick])  # noqa: E731
        belief = estimator.belief(g.compiled.constants(of(parameters)), in_lanes(g.q), in_lanes(g.r))
        first = estimator.init(np.zeros(g.compiled.nx), g.p0)
        return estimator.run(of(u), of(y), of(truth), names, np.full(LANES, float(samples)), belief, first, keep=True)

    batch = run(np.arange(LANES))
    assert not np.array_equal(batch.rmse[:, 0], batch.rmse[:, 5])
    for lane in (0, 5):
        alone = run(np.full(LANES, lane))
        for field in ("rmse", "bias", "max_error", "nees", "nis", "log_likelihood", "kept"):
            np.testing.assert_array_equal(getattr(batch, field)[..., lane], getattr(alone, field)[..., 0])


@pytest.mark.parametrize("name", NONLINEAR)
def test_follows_a_nonlinear_model_with_a_nonlinear_output(name):
    """The truth stays inside the stated uncertainty as often as it should, within wide limits."""
    compiled = compile_model(curved(), STEP)
    rng = np.random.default_rng(11)
    samples, q, r = 400, np.array([1e-6, 1e-4]), np.array([1e-3])
    x, y, truth = np.array([0.2, 0.0]), np.empty((samples, 1)), np.empty((samples, 2))
    u = np.sin(0.5 * STEP * np.arange(samples))[:, None]
    for k in range(samples):
        truth[k] = x
        y[k] = np.exp(0.3 * x[0]) + x[0] * x[1] + rng.normal() * r[0] ** 0.5
        x = x + STEP * np.array([x[1], -2.0 * np.sin(x[0]) - 0.2 * x[1] * abs(x[1]) + u[k, 0]])
        x = x + rng.normal(size=2) * np.sqrt(q)
    means, covariances, _ = step_through(Estimator(name, compiled), compiled, u, y, (2.0,), q, r, np.array([0.1, 0.1]))
    error = truth - means
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariances), error)[50:]
    assert 1.0 < nees.mean() < 3.5
    assert np.sqrt(np.mean(error[50:, 0] ** 2)) < 0.5 * np.std(truth[50:, 0])
