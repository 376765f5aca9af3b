"""EM with particles: Q against its definition, its gradient, the smoother's pairs, and the case of Sun 2015."""

import dataclasses

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.estimation.particle_smoother import Clouds, transitions
from harness.identification.contract import Problem, load_method, settings_of
from harness.identification.innovations import Innovations
from harness.identification.methods.em import Maximisation, Settings, identify, settled
from reproductions.sun_em import FREE, car, recording

TRUTH = np.array([8.36, 7.78, 0.62, 1.014])


@pytest.fixture(scope="module")
def drive():
    return recording(7)


def searched(drive, free=FREE, **settings):
    return Maximisation(car(start=True), free, [drive], Settings.model_validate(settings))


def test_pairs_of_particles_are_weighted_as_the_formula_says():
    rng = np.random.default_rng(3)
    particles, weights = rng.normal(size=(3, 11, 2)), rng.random((3, 11))
    weights /= weights.sum(axis=1, keepdims=True)
    noise = np.array([0.5, 0.8])
    clouds = Clouds(particles, weights, 0.9 * particles[:-1], noise)
    moves = transitions(clouds)
    following, spread = weights[-1], np.zeros(2)
    for t in (1, 0):  # (2.74), (2.75), (2.77) with all N^2 pairs
        away = particles[t + 1][:, None, :] - clouds.ahead[t][None, :, :]
        density = weights[t] * np.exp(-0.5 * (away**2 / noise).sum(axis=2))
        pairs = following[:, None] * density / density.sum(axis=1, keepdims=True)
        following = pairs.sum(axis=0)
        means = np.einsum("il,id->ld", pairs, particles[t + 1]) / following[:, None]
        spread += np.einsum("il,ild->d", pairs, (particles[t + 1][:, None, :] - means[None]) ** 2)
        np.testing.assert_allclose(moves.weights[t], following, rtol=1e-10)
        np.testing.assert_allclose(moves.targets[t], means, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(moves.spread, spread, rtol=1e-10)


def test_q_is_its_definition_and_its_gradient_is_exact(drive):
    em = searched(drive, process_noise=False)
    point = em.start()
    expectation = em.expecter.expect(point, np.random.SeedSequence(1))
    (move,), (x,), (u,), (y,) = (getattr(expectation, n) for n in ("moves", "particles", "inputs", "measurements"))

    def by_hand(free):
        front, rear, ratio, l_f = free
        v, L, h, g = car(start=True).values, 2.69, 0.5, 9.81
        l_r = L - l_f
        wheel, speed, rate = (u[:-1, i, None] for i in range(3))
        v_y, w, _ = (x[:-1, :, i] for i in range(3))
        a_x = rate - w * v_y - w**2 * l_r
        f_f = front * (l_r * g - h * a_x) / L * (wheel / v["steering_ratio"] - (v_y + L * w) / speed)
        f_r = rear * (l_f * g + h * a_x) / L * (-v_y / speed)
        dw = ratio * (l_f * f_f - l_r * f_r)
        ahead = x[:-1] + 0.01 * np.stack([f_f + f_r - w * speed - dw * l_r, dw, w], axis=-1)
        states = np.einsum("tn,tnd->d", move.weights[:-1], (move.targets - ahead) ** 2) + move.spread
        outputs = np.einsum("tn,tnd->d", move.weights, (y[:, None] - x) ** 2)
        return 0.5 * (np.sum(states / point.process) + np.sum(outputs / point.measurement))

    for settings in (em.settings, Settings.model_validate({"measurement_noise": True})):
        cost = Maximisation(car(start=True), FREE, [drive], settings).negative_q(expectation, point)
        value, gradient = cost(TRUTH)
        if settings is em.settings:
            assert value == pytest.approx(by_hand(TRUTH), rel=1e-9)
        for i, step in enumerate(np.diag(1e-5 * TRUTH)):
            difference = (cost(TRUTH + step)[0] - cost(TRUTH - step)[0]) / (2 * step[i])
            assert gradient[i] == pytest.approx(difference, rel=1e-5, abs=1e-3)


def test_the_m_step_reaches_the_largest_q_and_the_best_variances(drive):
    em = searched(drive, measurement_noise=True)
    start = em.start()
    expectation = em.expecter.expect(start, np.random.SeedSequence(1))
    cost, best = em.negative_q(expectation, start), em.maximise(expectation, start, 0)
    assert cost(best.free)[0] < cost(start.free)[0]
    assert np.abs(cost(best.free)[1] * best.free).max() < 1.0  # against 1e4 and more at the start
    assert np.abs(cost(start.free)[1] * start.free).max() > 100.0
    one = searched(drive, search="coordinate").maximise(expectation, start, 2)
    assert (one.free != start.free).tolist() == [False, False, True, False]
    sums, _ = em.expecter.residuals(expectation, best.free)
    np.testing.assert_allclose(np.append(best.process, best.measurement) * np.repeat([499, 500], 3), sums)


def test_it_finds_the_car_of_sun_better_than_the_thesis(drive):
    found = searched(drive).run(7)
    assert found.converged
    error = 100 * np.abs(found.point.free / TRUTH - 1)
    assert np.all(error < [0.5, 0.5, 2.0, 1.0]), error
    assert np.all(found.point.process < 0.3 * found.history[0].process)
    again = searched(drive, iterations=3, window=2).run(7)
    np.testing.assert_array_equal([p.free for p in again.history], [p.free for p in found.history[:4]])
    assert not again.converged


def test_missing_samples_and_several_recordings(drive):
    holes = drive.measurements.copy()
    holes[50:90, 0] = holes[200:260] = np.nan
    both = [dataclasses.replace(drive, measurements=holes), recording(8)]
    found = Maximisation(car(start=True), FREE, both, Settings(iterations=12, window=4)).run(1)
    assert np.all(100 * np.abs(found.point.free / TRUTH - 1) < [1.0, 1.0, 2.0, 2.0])


def test_as_a_method_it_raises_the_likelihood(drive):
    problem = Problem(Innovations(car(start=True), jobs=1), (drive,), FREE, seed=7)
    file = load_method("em")
    fit = identify(problem, settings_of(file, {"iterations": 10, "window": 5}))
    assert fit.after > fit.before
    assert len(fit.further["iterates"][FREE[0]]) == 11
    assert fit.spec.values[FREE[3]] == fit.estimate(FREE[3]).value
    assert set(fit.spec.process_noise) == set(problem.spec.model().states)


def test_two_windows_that_drift_are_not_at_rest():
    rng = np.random.default_rng(0)
    still = rng.normal(size=(40, 1))
    assert settled(still)
    assert not settled(np.hstack([still, np.arange(40.0)[:, None]]))


def test_bad_requests_name_what_is_wrong(drive):
    with pytest.raises(UserError, match="closest: cog_to_front_axle"):
        searched(drive, free=("cog_to_front_axl",))
    with pytest.raises(UserError, match=r"starts at 7\.942, its search range is 8 to 9"):
        searched(drive, bounds={FREE[0]: (8.0, 9.0)})
    with pytest.raises(UserError, match="no free parameter"):
        searched(drive, bounds={"cog_height": (0.1, 1.0)})
    with pytest.raises(UserError, match="no recording"):
        Maximisation(car(start=True), FREE, [])
    still = dataclasses.replace(car(start=True), process_noise=dict.fromkeys(car(start=True).process_noise, 0.0))
    with pytest.raises(UserError, match="needs process noise on every state"):
        Maximisation(still, FREE, [drive]).run(0)
    with pytest.raises(UserError, match="particle"):
        settings_of(load_method("em"), {"particle": 5})
