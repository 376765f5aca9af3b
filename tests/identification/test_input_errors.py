"""Recorded inputs with noise: what it does to filter, likelihood and free run, against solutions that spare nothing."""

import dataclasses
import functools
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from harness.engine.kernel_names import Info
from harness.engine.simd.lanes import LANES, put
from harness.engine.simd.linalg import add_input_errors, correlated_update
from harness.identification.candidates import Candidates
from harness.identification.innovations import Innovations
from harness.identification.input_effects import InputEffects
from harness.identification.measured_inputs import InputErrors
from support.identification import CAR, model_of, recorded

REAL = {"speed": 0.02, "steering_wheel_angle": 0.00175}
"""m/s and rad; ordinary sensors."""
LARGE = {"speed": 0.1, "steering_wheel_angle": 0.02}
"""Several times that, so that it matters beside the other noise."""


@njit
def enlarge(P, errors):
    add_input_errors(P, errors)


@njit
def update(prior, y, r, errors, after, work, info):
    (x_prior, P_prior, predicted, H, seen), (x, P) = prior, after
    put(correlated_update(x_prior, P_prior, predicted, H, seen, y, r, errors, x, P, work, info), info.repairs, 0)


@pytest.fixture(scope="module")
def innovations():
    return Innovations(model_of(CAR), jobs=1)


@pytest.fixture(scope="module")
def exact():
    return recorded(model_of(CAR), 3, duration=20.0, speed=15.0, speed_variation=2.0, amplitude=0.55)


def noisy(recording, seed, noise=REAL):
    """Return a recording whose inputs were measured with noise."""
    rng, found = np.random.default_rng(seed), recording.copy()
    for name, deviation in noise.items():
        if name in found:
            values = recording[name].values + deviation * rng.normal(size=recording.sizes["time"])
            found[name] = ("time", values, {**recording[name].attrs, "derived": 0})
    return found


def in_lanes(values):
    return np.ascontiguousarray(np.repeat(np.asarray(values, dtype=float)[..., None], LANES, axis=-1))


@pytest.mark.parametrize("missing", [(), (1,)])
def test_correlated_update_is_the_dense_solution(missing):
    rng = np.random.default_rng(0)
    n, m, count = 3, 3, 2
    root, H = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    H[0, 1:] = 0.0
    seen = np.array([[0, -1, -1], [0, 1, 2], [0, 1, 2]])
    G, D, r = rng.normal(size=(n, count)), rng.normal(size=(m, count)), rng.uniform(0.5, 2.0, m)
    x, predicted, y = rng.normal(size=n), rng.normal(size=m), rng.normal(size=m)
    y[list(missing)] = np.nan
    errors, P = in_lanes(np.concatenate([G, D])), in_lanes(root @ root.T)
    enlarge(P, errors)
    prior = root @ root.T + G @ G.T
    np.testing.assert_allclose(P[..., 0], prior, rtol=1e-12)
    row = np.zeros((4, LANES))
    info = Info(np.zeros((m, LANES)), np.zeros((m, m, LANES)), row[0:1], row[1:2], row[2:3], row[3:4])
    after, covariance = np.empty((n, LANES)), np.empty((n, n, LANES))
    work = np.empty((m, n, LANES)), np.zeros((m, m, LANES)), np.empty((m, count, LANES))
    before = in_lanes(x), P, in_lanes(predicted), in_lanes(H), seen
    update(before, in_lanes(y), in_lanes(r), errors, (after, covariance), work, info)
    kept = np.isfinite(y)
    h, d = H[kept], D[kept]
    cross = prior @ h.T + G @ d.T
    S = h @ prior @ h.T + h @ G @ d.T + (h @ G @ d.T).T + np.diag(r[kept]) + d @ d.T
    gain = cross @ np.linalg.inv(S)
    e = (y - predicted)[kept]
    np.testing.assert_allclose(after[:, 0], x + gain @ e, rtol=1e-9)
    np.testing.assert_allclose(covariance[..., 0], prior - gain @ S @ gain.T, rtol=1e-9, atol=1e-12)
    density = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
    assert info.log_likelihood[0, 0] == pytest.approx(density, rel=1e-9)


def test_the_spread_of_a_free_run_is_the_sum_over_the_errors_of_all_samples_before():
    """Covariance and transition of the errors change with time; the outputs are summed up term by term."""
    rng = np.random.default_rng(4)
    samples, n, m, outputs = 7, 2, 2, 3
    A, G = 0.7 * rng.normal(size=(samples, n, n)), rng.normal(size=(samples, n, m))
    H, D = rng.normal(size=(samples, outputs, n)), rng.normal(size=(samples, outputs, m))
    T, P = 0.6 * rng.normal(size=(samples, m, m)), np.zeros((samples, m, m))
    for k in range(samples):
        root = rng.normal(size=(m, m))
        P[k] = root @ root.T + (T[k] @ P[k - 1] @ T[k].T if k else 0.0)
    errors = InputErrors((0, 1), P, np.concatenate([P[:1], T[1:] @ P[:-1]]))
    spread = InputEffects(None)._spread(SimpleNamespace(input_errors=errors), A, H, G, D)

    def from_sample(k, j):
        """Return what the errors of sample j do to the outputs of sample k."""
        if k == j:
            return D[k]
        moved = G[j]
        for i in range(j + 1, k):
            moved = A[i] @ moved
        return H[k] @ moved

    def together(i, j):
        """Return the covariance of the errors of sample i with those of sample j."""
        if i < j:
            return together(j, i).T
        return functools.reduce(lambda lasting, k: T[k] @ lasting, range(j + 1, i + 1), P[j])

    for k in range(samples):
        pairs = itertools.product(range(k + 1), repeat=2)
        total = sum(from_sample(k, i) @ together(i, j) @ from_sample(k, j).T for i, j in pairs)
        np.testing.assert_allclose(spread[k], np.diag(total), rtol=1e-9)


def test_a_simulated_recording_is_exact(innovations, exact):
    drive = innovations.drive(exact, "exact")
    assert drive.effects.shape[2] == 0
    assert not drive.spread.any()
    np.testing.assert_array_equal(drive.inputs[:, 0], exact[innovations.model.inputs[0]])


def test_the_gain_that_is_kept_is_that_of_the_filter(innovations, exact):
    drive, point = innovations.drive(noisy(exact, 1, LARGE), "noisy", "held"), Candidates.of(innovations.spec)
    kept = innovations.run(drive, point)
    assert np.isfinite(kept.log_likelihood)
    whitened = innovations.sensitivities(drive, point.values, np.eye(len(innovations.names))[:, :1], kept)
    assert np.isfinite(whitened).all()
    k = 500
    values = innovations.stated()
    first = dataclasses.replace(drive, inputs=drive.inputs[k - 1 : k + 1], between=drive.between[k - 1 : k + 1])
    held = np.repeat(values[:, None], LANES, axis=1)
    states, outputs = (np.empty((2, size, LANES)) for size in (innovations.compiled.nx, innovations.compiled.ny))
    begin = np.repeat(kept.state[k - 1][:, None], LANES, axis=1)
    innovations._free.run_free(
        (first.inputs, first.between), innovations.compiled.constants(held), begin,
        np.full(innovations.compiled.nx, np.inf), states, outputs, np.empty((1, LANES)),
    )  # fmt: skip
    corrected = states[1, :, 0] + kept.gain[k] @ kept.innovation[k]
    np.testing.assert_allclose(corrected, kept.state[k], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("known", [False, True])
def test_runs_in_lanes_are_those_of_each_candidate_alone(innovations, exact, known):
    drive, point = innovations.drive(noisy(exact, 1, LARGE), "noisy", "held"), Candidates.of(innovations.spec)
    drive = dataclasses.replace(drive, effects=drive.effects[:, :, :0]) if known else drive
    each = [
        Candidates((1.0 + 0.01 * k) * point.values, 3.0**k * point.process, 0.9**k * point.measurement)
        for k in range(LANES + 1)
    ]
    together = innovations.runs_of(drive, Candidates.together(each))
    assert len({run.log_likelihood for run in together}) == len(each)
    for candidate, in_lane in zip(each, together, strict=True):
        for alone, kept in zip(
            *(vars(run).values() for run in (innovations.run(drive, candidate), in_lane)), strict=True
        ):
            np.testing.assert_array_equal(alone, kept)


def in_variables(innovations, drive, lasting):
    """Return log-likelihood and states of the filter that has the errors of the inputs among its states."""
    spec, values = innovations.spec, innovations.stated()
    point = Candidates.of(spec)
    kept = innovations.run(drive, point)
    states = kept.state.copy()
    states[0] = innovations.first_state(drive, values)
    effects, nx, errors = InputEffects(innovations.duals), innovations.nx, drive.input_errors
    rows = [i for i in errors.rows if i >= 0]
    unit = np.eye(nx + drive.inputs.shape[1])[:, [*range(nx), *(nx + i for i in rows)]]
    ahead, outputs = effects._tangents(drive, states, values, unit, nx)
    m, visible = len(errors.rows), [*range(nx), *(nx + a for a, i in enumerate(errors.rows) if i >= 0)]
    slopes = [np.zeros((len(states), part.shape[1], nx + m)) for part in (ahead, outputs)]
    for whole, part in zip(slopes, (ahead, outputs), strict=True):
        whole[:, :, visible] = part
    ahead, outputs = slopes
    free = innovations.free_run(drive, values)
    n = nx
    Q, R, P_e, C = point.process[:, 0], point.measurement[:, 0], errors.covariance, errors.transition
    x, P, total, found = np.zeros(n + m), np.zeros((n + m, n + m)), 0.0, [np.zeros(n)]
    P[:n, :n] = np.diag(drive.first_variance)
    P[n:, n:] = P_e[0]
    for k in range(1, len(states)):
        M, W = np.zeros((n + m, n + m)), np.zeros((n + m, n + m))
        M[:n] = ahead[k - 1]
        W[:n, :n] = np.diag(Q)
        M[n:, n:] = C[k] if lasting else 0.0
        W[n:, n:] = P_e[k] - M[n:, n:] @ P_e[k - 1] @ M[n:, n:].T
        x, P = M @ x, M @ P @ M.T + W
        kept_rows = np.isfinite(drive.measurements[k])
        H = outputs[k][kept_rows]
        S = H @ P @ H.T + np.diag(R[kept_rows])
        e = (drive.measurements[k] - free.outputs[k])[kept_rows] - H @ x
        total -= 0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
        K = P @ H.T @ np.linalg.inv(S)
        x, P = x + K @ e, P - K @ S @ K.T
        found.append(x[:n].copy())
    return total, free.states[: len(found)] + np.array(found)


def likelihoods(innovations, drive):
    """Return log-likelihoods: ours, of the full filter, and of one that takes the inputs for exact; and both states."""
    point, exact = Candidates.of(innovations.spec), dataclasses.replace(drive, effects=drive.effects[:, :, :0])
    ours = innovations.run(drive, point)
    full, states = in_variables(innovations, drive, lasting=True)
    return ours.log_likelihood, full, innovations.run(exact, point).log_likelihood, ours.state, states


def test_with_real_sensors_likelihood_and_states_are_those_of_the_full_filter(innovations, exact):
    """The filter whose states hold the errors of values and rates knows that they last; ours takes them for white."""
    drive = innovations.drive(noisy(exact, 1), "noisy", "held")
    ours, full, ignored, mean, states = likelihoods(innovations, drive)
    assert ours == pytest.approx(full, abs=10.0)  # of 36,000
    assert ours > ignored
    after = slice(200, None)
    apart = np.sqrt(np.mean((mean[after] - states[after]) ** 2, axis=0))
    assert (apart < 0.02 * np.std(states[after], axis=0)).all()


def test_of_large_noise_most_is_explained(innovations, exact):
    ours, full, ignored, *_ = likelihoods(innovations, innovations.drive(noisy(exact, 1, LARGE), "noisy", "held"))
    assert full - ignored > 1000.0
    assert ours - ignored > 0.75 * (full - ignored)


def test_taken_for_white_the_full_filter_is_ours(innovations, exact):
    drive = innovations.drive(noisy(exact, 1), "noisy", "held")
    white, _ = in_variables(innovations, drive, lasting=False)
    assert innovations.run(drive, Candidates.of(innovations.spec)).log_likelihood == pytest.approx(white, abs=0.5)


def test_the_free_run_is_off_by_what_is_foretold(innovations, exact):
    """Over draws of the noise of the inputs the simulated outputs scatter as the tangent run says."""
    right = innovations.free_run(innovations.drive(exact, "exact", "held"), innovations.stated()).outputs
    squares, spread = [], []
    for seed in range(12):
        drive = innovations.drive(noisy(exact, 10 + seed, LARGE), "noisy", "held")
        squares.append((innovations.free_run(drive, innovations.stated()).outputs - right) ** 2)
        spread.append(drive.spread)
    ratio = np.mean(squares, axis=(0, 1)) / np.mean(spread, axis=(0, 1))
    assert ratio[:2] == pytest.approx([1.0, 1.0], abs=0.3)  # lateral velocity and yaw rate
    assert 0.4 < ratio[2] < 2.5  # the heading sums the errors up: a draw is hardly more than one number
