"""Likelihood and sensitivities: exact to rounding, whatever the filter, with missing samples and several drives."""

from dataclasses import fields
from functools import partial

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.engine.simd.lanes import LANES
from harness.identification import time_loops
from harness.identification.candidates import Candidates
from harness.identification.coordinates import Coordinates
from harness.identification.innovations import Innovations
from harness.identification.time_loops import Likelihood
from harness.runner.contract import Held, History, InputSeries
from harness.runner.history import EverySample
from support.identification import CAR, TRUCK, car_fit, five_point, model_of, recorded

LENGTHS = ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia", "cog_to_front_axle")


def space_of(innovations, free):
    spec = innovations.spec
    return Coordinates.of(spec, free, [spec.measurement_noise[n] for n in innovations.model.outputs])


def check_gradient(innovations, drives, free):
    space = space_of(innovations, free)
    z = space.centre + 0.01
    slopes = innovations.slopes(drives, space.candidates(z), space.directions(z))

    def likelihood(points):
        return innovations.log_likelihoods(drives, space.candidates(points))

    assert slopes.log_likelihood == pytest.approx(likelihood(z[:, None])[0], rel=1e-12)
    natural = np.sqrt(np.diagonal(slopes.information))
    for j in range(len(space)):
        expected = five_point(likelihood, z, j, min(1e-2, 0.1 / natural[j]))
        assert abs(slopes.gradient[j] - expected) <= 1e-7 * max(abs(expected), natural[j]), space.coordinates[j].name


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_the_gradient_is_that_of_central_differences_for_a_car(kind):
    innovations, drive = car_fit(1, kind=kind, stiffness_over_load_front=8.0)
    drive.measurements[40:60, 0] = np.nan
    drive.measurements[100:103] = np.nan
    check_gradient(innovations, [drive], LENGTHS)


@pytest.mark.proof
def test_the_gradient_is_that_of_central_differences_for_the_semitrailer():
    spec = model_of(TRUCK, trailer_mass=23000.0)
    recording = recorded(model_of(TRUCK), 2, duration=20.0, speed=15.0, amplitude=0.5)
    innovations = Innovations(spec, jobs=1)
    drive = innovations.drive(recording, "drive")
    check_gradient(innovations, [drive], ("trailer_mass", "stiffness_peak_2", "relaxation_length_11", "friction"))


def test_the_information_is_the_curvature_that_the_model_expects():
    """Over data that the model itself made, gradients scatter with the Fisher information (Bartlett's identity)."""
    innovations, _ = car_fit(0)
    space = space_of(innovations, LENGTHS)
    drives = [
        innovations.drive(recorded(model_of(CAR), seed, duration=5.0, amplitude=0.55), "drive") for seed in range(40)
    ]
    found = [innovations.slopes([d], space.candidates(space.centre), space.directions(space.centre)) for d in drives]
    mean = np.mean([f.information for f in found], axis=0)
    moved = space.kind("parameter", "measurement")
    gradients = np.array([f.gradient for f in found])[:, moved]
    root = np.linalg.cholesky(mean[np.ix_(moved, moved)])
    whitened = np.linalg.solve(root, gradients.T)
    assert np.all(np.abs(whitened.mean(axis=1)) < 4 / np.sqrt(40))
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], whitened.size) / whitened.size
    assert low < np.mean(whitened**2) < high


def test_several_drives_add_up_in_any_number_of_threads():
    innovations, drive = car_fit(3)
    shorter = innovations.drive(recorded(model_of(CAR), 4, duration=10.0, amplitude=0.5), "shorter")
    space = space_of(innovations, LENGTHS)
    held, along = space.candidates(space.centre), space.directions(space.centre)
    one, other = (innovations.slopes([d], held, along) for d in (drive, shorter))
    both = innovations.slopes([drive, shorter], held, along)
    assert both.log_likelihood == pytest.approx(one.log_likelihood + other.log_likelihood, rel=1e-13)
    assert np.allclose(both.gradient, one.gradient + other.gradient, rtol=1e-12)
    assert np.allclose(both.information, one.information + other.information, rtol=1e-12)
    innovations.jobs = 2
    again = innovations.slopes([drive, shorter], held, along)
    assert again.log_likelihood == both.log_likelihood
    assert np.array_equal(again.information, both.information)


def test_more_candidates_than_lanes_come_in_their_order():
    innovations, drive = car_fit(5, duration=5.0)
    held = Candidates.of(innovations.spec)
    factors = np.linspace(0.8, 1.2, 11)
    many = Candidates(held.values * factors, np.repeat(held.process, 11, 1), np.repeat(held.measurement, 11, 1))
    found = innovations.log_likelihoods([drive], many)
    assert found.shape == (11,)
    for k in (0, 7, 8, 10):
        assert found[k] == innovations.log_likelihoods([drive], many.take([k]))[0]


def test_frozen_gains_give_the_derivative_of_the_mean_alone():
    """Differences of the innovations over two runs that share gains and whitening, which ``follow`` keeps."""
    innovations, drive = car_fit(6, duration=5.0)
    drive.measurements[50:60, 1] = np.nan
    held = Candidates.of(innovations.spec)
    kept = innovations.run(drive, held)
    directions = innovations.along(LENGTHS)
    found = innovations.sensitivities(drive, held.values, directions, kept)
    assert found.shape == (*drive.measurements.shape, 4)
    assert not found[50:60, 1].any()
    model, kernels, C = innovations.compiled, innovations.compiled.kernels, np.eye(3)

    def innovate(values):
        lanes = [np.repeat(v, 8, axis=1) for v in (values, drive.first_mean[:, None])]
        constants, x = model.constants(lanes[0]), lanes[1]
        ahead, work, rows = np.empty_like(x), np.empty((model.nw, 8)), [np.zeros(3)]
        for k in range(1, len(drive.inputs)):
            kernels.next_state(x, np.repeat(drive.inputs[k - 1][:, None], 8, 1), constants, ahead, work)
            e = np.nan_to_num(drive.measurements[k] - C @ ahead[:, 0])
            x = ahead + (kept.gain[k] @ e)[:, None]
            rows.append(kept.whitening[k] @ e)
        return np.array(rows)

    same = innovate(held.values)
    seen = np.isfinite(kept.whitened)
    assert np.allclose(same[seen], kept.whitened[seen], atol=1e-8)
    for j in range(4):
        h = 1e-5 * held.values[directions[:, j] > 0, 0][0]
        expected = (innovate(held.values + h * directions[:, [j]])
                    - innovate(held.values - h * directions[:, [j]])) / (2 * h)  # fmt: skip
        assert np.abs(found[:, :, j] - expected).max() <= 1e-6 * np.abs(expected).max()


def test_whitened_innovations_of_the_right_model_are_standard_normal():
    innovations, drive = car_fit(7)
    held = Candidates.of(innovations.spec)
    kept = innovations.run(drive, held)
    w = kept.whitened[5:]
    assert kept.log_likelihood == pytest.approx(
        innovations.log_likelihoods([drive], Candidates.of(innovations.spec))[0]
    )
    assert stats.kstest(w.ravel(), "norm").pvalue > 1e-3
    assert np.allclose(kept.innovation[5:, 0] / kept.deviation[5:, 0], w[:, 0])


def test_a_candidate_that_leaves_the_range_of_the_model_counts_minus_infinity():
    innovations, drive = car_fit(8, duration=5.0)
    held = Candidates.of(innovations.spec)
    assert np.isfinite(innovations.log_likelihoods([drive], held)[0])
    largest = np.abs(drive.measurements[:, 0]).max()
    innovations._limits[0] = 0.5 * largest
    assert innovations.log_likelihoods([drive], held)[0] == -np.inf
    assert innovations.run(drive, held).log_likelihood == -np.inf


def test_the_likelihood_follows_from_the_history_of_a_filter():
    """As a filter that is no kernel is recorded: the sum over its samples, and the first one outside its limits."""
    innovations, drive = car_fit(8, duration=5.0)
    point, limits = Candidates.of(innovations.spec), innovations._limits
    at, inputs = point.in_lanes(), InputSeries(drive.inputs, drive.between, effects=drive.effects)
    first, variance = (np.repeat(a[:, None], LANES, axis=1) for a in (drive.first_mean, drive.first_variance))
    held = Held(at.values, at.process, at.measurement, first, variance)

    def recorded_and_of_history():
        run = partial(innovations._plain.run, inputs, drive.measurements, held)
        record = Likelihood(time_loops.note_run, innovations._notes(drive, 0))
        history = run(EverySample(of_state=False))
        side_by_side = History(*(getattr(history, f.name)[..., None] for f in fields(history)))
        return run(record)[:, 0], record.of(side_by_side, innovations._plain)[:, 0]

    recorded_one, of_history = recorded_and_of_history()
    assert of_history == pytest.approx(recorded_one, rel=1e-12)
    assert recorded_one[1] == len(drive.inputs)
    limits[0] = 0.5 * np.abs(drive.measurements[:, 0]).max()
    recorded_one, of_history = recorded_and_of_history()
    assert 0 < of_history[1] == recorded_one[1] < len(drive.inputs)


def test_a_parameter_that_does_not_exist_and_another_step_are_refused():
    innovations, _ = car_fit(9, duration=5.0)
    with pytest.raises(UserError, match="closest: stiffness_over_load_front"):
        innovations.along(["stiffness_over_load_frnt"])
    recording = recorded(model_of(CAR), 0, duration=5.0)
    recording = recording.assign_coords(time=2 * recording["time"])
    with pytest.raises(UserError, match=r"0\.02 s apart, those of the model 0\.01 s"):
        innovations.drive(recording, "slow")
