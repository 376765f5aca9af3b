"""The particle filter: against the Kalman filter, its resampling, its seeds and what it does when all is lost."""

from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from harness.common.errors import UserError
from harness.config.specs import CountFrom
from harness.engine.simd.lanes import LANES, get, put
from harness.engine.simd.random import gather, generator_words
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.runner.contract import Held, InputSeries
from harness.runner.scores import Scoring
from harness.simulation.simulate import in_lanes
from harness.study.design import Unit
from harness.study.run_noise import Case, RunNoise
from harness.testing.small_models import P0, Q, R, compiled_linear, drive_linear, textbook

SCHEMES = ("systematic", "stratified", "multinomial", "residual")
SEEDS = [np.random.SeedSequence(5, spawn_key=(lane,)) for lane in range(LANES)]


@pytest.fixture(scope="module")
def compiled():
    return compiled_linear()


def believe(estimator, compiled, q=Q, r=R):
    return estimator.belief(compiled.constants(in_lanes(np.array([1.5]))), in_lanes(q), in_lanes(r))


def run(compiled, u, y, q=Q, p0=P0, seeds=SEEDS, **settings):
    """Return means (samples, nx, LANES), covariances, log-likelihoods (samples - 1, LANES) and the last state."""
    estimator = CompiledEstimator("particle", compiled, settings)
    belief, state = believe(estimator, compiled, q), estimator.init(np.zeros(3), p0, seeds)
    means, covariances, likelihoods = [state.mean], [state.covariance], []
    for k in range(1, len(y)):
        state, info = estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), belief)
        means.append(state.mean)
        covariances.append(state.covariance)
        likelihoods.append(info.log_likelihood[0])
    return np.array(means), np.array(covariances), np.array(likelihoods), state


def test_converges_to_the_kalman_filter_at_the_monte_carlo_rate(compiled):
    u, y, A, B, C = drive_linear()
    y[5, 0] = y[9] = y[20:30, 1] = np.nan
    means, covariances, likelihoods = textbook(u, y, A, B, C)
    std = np.sqrt(np.einsum("kii->ki", covariances))
    sizes, errors, spreads = np.array([64, 256, 1024, 4096]), [], []
    for size in sizes:
        got, got_covariances, got_likelihoods, _ = run(compiled, u, y, particles=int(size))
        errors.append(np.sqrt(np.mean(((got - means[..., None]) / std[..., None])[10:] ** 2)))
        relative = np.einsum("kiil->kil", got_covariances) / std[..., None] ** 2 - 1
        spreads.append(np.sqrt(np.mean(relative[10:] ** 2)))
    for found in (errors, spreads):
        slope = np.polyfit(np.log(sizes), np.log(found), 1)[0]
        assert -0.62 < slope < -0.38
    assert errors[-1] < 0.1  # of a standard deviation
    # the estimate of the likelihood scatters little at this size, and about the right value
    assert np.abs(got_likelihoods.sum(axis=0) - likelihoods.sum()).max() < 1.5
    assert got_likelihoods.sum(axis=0).mean() == pytest.approx(likelihoods.sum(), abs=0.6)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("threshold", [0.5, 1.0])
def test_every_scheme_estimates_the_same(compiled, scheme, threshold):
    u, y, A, B, C = drive_linear()
    means, covariances, _ = textbook(u, y, A, B, C)
    got, *_ = run(compiled, u, y, particles=1000, resampling=scheme, threshold=threshold)
    error = (got - means[..., None]) / np.sqrt(np.einsum("kii->ki", covariances))[..., None]
    assert np.sqrt(np.mean(error[10:] ** 2)) < 0.25
    assert np.abs(error[10:].mean()) < 0.1


def test_without_measurements_it_only_predicts(compiled):
    u, y, A, B, _ = drive_linear(12)
    y[:] = np.nan
    size = 4000
    got, covariances, likelihoods, state = run(compiled, u, y, particles=size)
    x, P = np.zeros(3), np.diag(P0)
    for k in range(1, len(y)):
        x, P = A @ x + B @ u[k - 1], A @ P @ A.T + np.diag(Q)
        std = np.sqrt(np.diag(P))
        assert (np.abs(got[k] - x[:, None]) < 5 * std[:, None] / np.sqrt(size)).all()
        assert np.abs(covariances[k] / np.outer(std, std)[..., None] - (P / np.outer(std, std))[..., None]).max() < 0.12
    assert not likelihoods.any()
    assert state.memory[2] == pytest.approx(np.full(LANES, size))  # the weights stayed equal


def test_innovation_and_its_covariance_are_those_of_the_prediction(compiled):
    u, y, A, B, C = drive_linear(3)
    estimator = CompiledEstimator("particle", compiled, {"particles": 20_000})
    state = estimator.init(np.zeros(3), P0, SEEDS)
    _, info = estimator.step(state, in_lanes(u[0]), in_lanes(u[1]), in_lanes(y[1]), believe(estimator, compiled))
    S = C @ (A @ np.diag(P0) @ A.T + np.diag(Q)) @ C.T + np.diag(R)
    rest = y[1] - C @ (B @ u[0])
    std = np.sqrt(np.diag(S))
    assert (np.abs(info.innovation - rest[:, None]) < 5 * std[:, None] / np.sqrt(20_000)).all()
    assert np.abs(info.innovation_covariance - S[..., None]).max() < 0.05 * S.max()
    assert info.nis[0] == pytest.approx(np.full(LANES, rest @ np.linalg.solve(S, rest)), rel=0.1, abs=0.05)


@pytest.mark.parametrize("particles", [2, 16])
def test_particles_that_are_all_alike_leave_an_innovation_the_noise_of_the_sensors(compiled, particles):
    u, y, _, B, C = drive_linear(3)
    estimator = CompiledEstimator("particle", compiled, {"particles": particles})
    state = estimator.init(np.zeros(3), np.zeros(3), SEEDS)
    belief = believe(estimator, compiled, np.zeros(3))
    _, info = estimator.step(state, in_lanes(u[0]), in_lanes(u[1]), in_lanes(y[1]), belief)
    rest = y[1] - C @ (B @ u[0])
    np.testing.assert_allclose(info.innovation_covariance, np.diag(R)[..., None] * np.ones(LANES), rtol=1e-12, atol=0)
    np.testing.assert_allclose(info.innovation, rest[:, None] * np.ones(LANES), rtol=1e-12)
    np.testing.assert_allclose(info.nis[0], (rest**2 / R).sum(), rtol=1e-12)


def test_gather_reads_every_lane_from_its_own_row():
    @njit
    def kernel(cloud, rows, out):
        for i in range(cloud.shape[1]):
            put(gather(cloud, get(rows, 0), i), out, i)

    cloud = np.arange(10 * 3 * LANES, dtype=float).reshape(10, 3, LANES)
    rows, out = np.array([[9.0, 0, 3, 3, 1, 7, 2, 9]]), np.empty((3, LANES))
    kernel(cloud, rows, out)
    np.testing.assert_array_equal(out, cloud[rows[0].astype(int), :, np.arange(LANES)].T)


def test_a_run_draws_the_same_alone_or_in_a_batch(compiled):
    """Also where the other lanes redraw at other samples."""
    rng = np.random.default_rng(2)
    estimator = CompiledEstimator("particle", compiled, {"particles": 50, "roughening": 0.1})
    u, y = rng.normal(size=(60, 1, LANES)), rng.normal(size=(60, 2, LANES)) * np.linspace(0.1, 3, LANES)

    def of(pick):
        state = estimator.init(np.zeros(3), P0, [SEEDS[i] for i in pick])
        belief = believe(estimator, compiled)
        cut = lambda a: np.ascontiguousarray(a[..., pick])  # noqa: E731
        sizes = []
        for k in range(1, 60):
            state, _ = estimator.step(state, cut(u[k - 1]), cut(u[k]), cut(y[k]), belief)
            sizes.append(state.memory[2] ** 2 / state.memory[3] < 25)
        return state, np.array(sizes)

    batch, redrawn = of(np.arange(LANES))
    assert np.unique(redrawn, axis=1).shape[1] > 1  # lanes do redraw at different samples
    for lane in (0, 5):
        alone, _ = of(np.full(LANES, lane))
        np.testing.assert_array_equal(batch.memory[:, lane], alone.memory[:, 0])
        np.testing.assert_array_equal(batch.mean[:, lane], alone.mean[:, 0])
        np.testing.assert_array_equal(batch.covariance[..., lane], alone.covariance[..., 0])


def test_seeds_tell_runs_repeats_and_estimators_apart():
    noise = RunNoise(SimpleNamespace(seed=0, count_from=CountFrom(), designs=[SimpleNamespace(common_noise=False)]))
    unit, cases = Unit(0, 1, 2, 0, 2), [Case(0, 0), Case(0, 1), Case(1, 0)]
    states = lambda *a: [tuple(s.generate_state(2)) for s in noise.seeds(*a)]  # noqa: E731
    one, other = states(unit, cases, "PF"), states(unit, cases, "PF 1000")
    assert len(one) == LANES
    assert len({*one, *other}) == 2 * len(cases)
    assert one[2:] == [one[2]] * (LANES - 2)  # lanes without a run repeat the last one
    assert one == states(Unit(0, 3, 2, 0, 2), cases, "PF")  # bands share their noise
    assert one[0] not in states(Unit(0, 1, 1, 0, 2), cases, "PF")


@pytest.mark.parametrize("value", [np.inf, 1e200])
def test_all_weights_zero_is_a_divergence_with_its_time(compiled, value):
    rng = np.random.default_rng(4)
    samples, lost = 40, 17
    u, y = rng.normal(size=(samples, 1, LANES)), 0.2 * rng.normal(size=(samples, 2, LANES))
    truth = np.zeros((samples, 1, LANES))
    estimator = CompiledEstimator("particle", compiled, {"particles": 100})
    parts = (in_lanes(each) for each in (np.array([1.5]), Q, R, np.zeros(3)))
    held, record = Held(*parts, P0, seeds=SEEDS), Scoring(truth, ("beta_test",), np.full(LANES, float(samples)))
    good = estimator.run(InputSeries(u), y, held, record).scores()
    bad_y = y.copy()
    bad_y[lost, 0, 3] = value
    bad = estimator.run(InputSeries(u), bad_y, held, record).scores()
    assert list(bad.diverged_at) == [samples if lane != 3 else lost for lane in range(LANES)]
    assert np.isfinite(bad.rmse).all()
    assert np.isfinite(bad.log_likelihood).all()
    rest = [lane for lane in range(LANES) if lane != 3]
    np.testing.assert_array_equal(bad.rmse[:, rest], good.rmse[:, rest])
    np.testing.assert_array_equal(bad.log_likelihood[rest], good.log_likelihood[rest])


def test_a_broken_particle_loses_its_weight_and_nothing_else(compiled):
    u, y, *_ = drive_linear(6)
    estimator = CompiledEstimator("particle", compiled, {"particles": 64, "threshold": 0.0})
    belief, state = believe(estimator, compiled), estimator.init(np.zeros(3), P0, SEEDS)
    state, _ = estimator.step(state, in_lanes(u[0]), in_lanes(u[1]), in_lanes(y[1]), belief)
    whole, _ = estimator.step(state, in_lanes(u[1]), in_lanes(u[2]), in_lanes(y[2]), belief)
    state.memory[5 + 3 * 7 + 1, 2] = np.nan  # a state of particle 7 in lane 2
    state.memory[5 + 3 * 9, 2] = np.inf
    after, info = estimator.step(state, in_lanes(u[1]), in_lanes(u[2]), in_lanes(y[2]), belief)
    weights = after.memory[5 + 4 * 64 :]
    assert weights[7, 2] == weights[9, 2] == 0.0
    assert np.isfinite(after.mean).all()
    assert np.isfinite(after.covariance).all()
    assert np.isfinite(info.log_likelihood).all()
    others = [lane for lane in range(LANES) if lane != 2]
    np.testing.assert_array_equal(after.mean[:, others], whole.mean[:, others])
    assert np.abs(after.mean[:, 2] - whole.mean[:, 2]).max() < 0.5


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"particles": 0}, "particles"),
        ({"particles": -5}, "particles"),
        ({"resampling": "sistematic"}, "systematic"),
        ({"threshold": 1.5}, "threshold"),
        ({"roughening": -0.1}, "roughening"),
    ],
)
def test_settings_are_refused(compiled, settings, says):
    with pytest.raises(UserError, match=rf"(?s)estimator 'particle'.*{says}"):
        CompiledEstimator("particle", compiled, settings)


def test_roughening_keeps_particles_apart(compiled):
    """Without process noise redrawn particles stay the same for ever; jitter tells them apart."""
    u, y, *_ = drive_linear(30)
    distinct = []
    for roughening in (0.0, 0.2):
        *_, state = run(compiled, u, y, q=np.zeros(3), particles=100, roughening=roughening)
        distinct.append(len(np.unique(state.memory[5 : 5 + 300].reshape(100, 3, LANES)[:, 0, 0])))
    assert distinct[0] < 30
    assert distinct[1] > 60  # those redrawn since the last time are their own again


def test_several_batches_begin_as_each_alone(compiled):
    estimator, seeds = CompiledEstimator("particle", compiled), np.random.SeedSequence(1).spawn(2 * LANES)
    mean = np.random.default_rng(2).normal(size=(2, 3, LANES))
    both = estimator.init(mean, mean**2, seeds)
    for batch, own in enumerate((seeds[:LANES], seeds[LANES:])):
        for found, wanted in zip(both, estimator.init(mean[batch], mean[batch] ** 2, own), strict=True):
            np.testing.assert_array_equal(found[batch], wanted)


def test_of_normal_numbers_that_come_in_pairs_the_one_left_over_is_the_next_first(compiled):
    kernel = CompiledEstimator("particle", compiled)._kernels.normals

    @njit
    def draw(z, spare, words):
        s0, s1 = kernel(z, spare, get(words, 0), get(words, 1))
        put(s0, words, 0)
        put(s1, words, 1)

    words, rows = generator_words(SEEDS), []
    z = np.full((4, LANES), np.nan)
    for call in range(2000):
        left = z[3].copy()
        draw(z, call % 2 == 1, words)
        if call % 2:
            np.testing.assert_array_equal(z[0], left)
        rows.append(z[:3].copy())
    drawn = np.concatenate(rows).reshape(1000, 6, LANES)
    whitened = np.einsum("nil,njl->ij", drawn, drawn) / (1000 * LANES)
    np.testing.assert_allclose(whitened, np.eye(6), atol=0.06)  # five standard deviations of 8000 products


# --- resampling


@pytest.fixture(scope="module")
def redraw(compiled):
    kernel = CompiledEstimator("particle", compiled)._kernels.redraw

    @njit
    def call(scheme, redrawn, weights, total, points, ancestors, words):
        s0, s1 = kernel(scheme, redrawn, weights, total, points, ancestors, get(words, 0), get(words, 1))
        put(s0, words, 0)
        put(s1, words, 1)

    return call


def children(redraw, scheme, weights, rounds):
    """Return how many children each particle has in each round, ``(rounds, N, LANES)``."""
    count = len(weights)
    words, counts = generator_words(SEEDS), np.zeros((rounds, count, LANES), dtype=int)
    points, ancestors = np.empty((count, LANES)), np.empty((count, LANES))
    total = weights.sum(axis=0, keepdims=True)
    for i in range(rounds):
        redraw(SCHEMES.index(scheme), np.ones((1, LANES)), weights, total, points, ancestors, words)
        assert np.array_equal(ancestors, np.floor(ancestors))
        for lane in range(LANES):
            counts[i, :, lane] = np.bincount(ancestors[:, lane].astype(int), minlength=count)
    return counts


@pytest.mark.parametrize("scheme", SCHEMES)
def test_children_are_as_many_as_the_weight_says(redraw, scheme):
    rng = np.random.default_rng(1)
    weights = rng.exponential(size=(20, LANES)) ** 2
    weights[3] = 0.0
    weights[-1, :4] = 0.0
    expected = 20 * weights / weights.sum(axis=0)
    rounds = 3000
    counts = children(redraw, scheme, weights, rounds)
    assert (counts.sum(axis=1) == 20).all()
    assert not counts[:, 3].any()
    share = expected / 20
    scatter = np.sqrt(20 * share * (1 - share) / rounds)  # of the multinomial scheme, the largest of the four
    assert (np.abs(counts.mean(axis=0) - expected) <= 5 * scatter + 1e-12).all()
    variance = counts.var(axis=0)
    if scheme == "multinomial":
        assert variance == pytest.approx(20 * share * (1 - share), rel=0.2, abs=0.03)
    else:
        assert variance.sum() < 0.8 * (20 * share * (1 - share)).sum()
    if scheme == "systematic":
        assert (counts >= np.floor(expected) - 1e-9).all()
        assert (counts <= np.ceil(expected) + 1e-9).all()
    if scheme == "residual":
        assert (counts >= np.floor(expected - 1e-9)).all()
    if scheme == "stratified":
        assert (np.abs(counts - expected) < 2).all()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_equal_weights_and_one_weight(redraw, scheme):
    counts = children(redraw, scheme, np.ones((16, LANES)), 20)
    if scheme in ("systematic", "residual"):
        assert (counts == 1).all()
    single = np.zeros((16, LANES))
    single[11] = 2.5
    assert (children(redraw, scheme, single, 20)[:, 11] == 16).all()


def test_lanes_that_are_not_redrawn_keep_particles_and_generator(redraw):
    rng = np.random.default_rng(1)
    weights, words = rng.exponential(size=(30, LANES)), generator_words(SEEDS)
    before, marks = words.copy(), np.zeros((1, LANES))
    marks[0, [1, 4]] = 1.0
    ancestors = np.empty((30, LANES))
    redraw(2, marks, weights, weights.sum(axis=0, keepdims=True), np.empty((30, LANES)), ancestors, words)
    for lane in range(LANES):
        moved = lane in (1, 4)
        assert np.array_equal(ancestors[:, lane], np.arange(30)) != moved
        assert np.array_equal(words[:, lane], before[:, lane]) != moved
