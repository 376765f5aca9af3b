"""What fits and diagnosis share: runs that are remembered, gains held fixed, coordinates, errors, and the judgement."""

import dataclasses

import numpy as np
import pytest

from harness.identification.candidates import Candidates
from harness.identification.coordinates import Coordinates, parameter_coordinate
from harness.identification.filtered_model import FilteredModel
from harness.identification.free_run import FEWEST, Start
from harness.identification.innovations import Innovations
from harness.identification.objective import LogPosterior
from harness.identification.result import judged_on
from harness.identification.uncertainty import covariance_of
from support.identification import CAR, TRUCK, car_fit, model_of, recorded

FREE = ("stiffness_over_load_front", "mass_over_inertia")


def space_of(innovations, free=FREE):
    spec = innovations.spec
    return Coordinates.of(spec, free, [spec.measurement_noise[n] for n in innovations.model.outputs])


def test_a_run_at_the_same_point_is_not_run_again_and_only_the_last_are_kept():
    innovations, drive = car_fit(20, duration=5.0)
    point = Candidates.of(innovations.spec)
    (first,) = innovations.runs([drive], point)
    assert innovations.runs([drive], point.take([0]))[0] is first
    assert first.log_likelihood == innovations.run(drive, point).log_likelihood
    other = dataclasses.replace(point, measurement=2.0 * point.measurement)
    assert innovations.runs([drive], other)[0].log_likelihood != first.log_likelihood
    for factor in np.linspace(1.1, 1.9, 30):
        innovations.runs([drive], dataclasses.replace(point, measurement=factor * point.measurement))
    assert len(innovations._remembered) == 24
    assert innovations.runs([drive], point)[0] is not first


def test_with_gains_held_fixed_the_slopes_of_parameters_are_nearly_the_exact_ones():
    """A dozen standard errors from the summit the gains' own part is worth less than half of one."""
    innovations, drive = car_fit(21)
    space = space_of(innovations)
    moved = space.kind("parameter")
    z = space.centre + 0.002 * moved
    at = [space.candidates(z)], [space.directions(z, moved)]
    exact, fixed = innovations.slopes([drive], *at), FilteredModel.slopes(innovations, [drive], *at)
    assert fixed.log_likelihood == pytest.approx(exact.log_likelihood, rel=1e-12)
    natural = np.sqrt(np.diagonal(exact.information))
    assert np.all(np.abs(fixed.gradient - exact.gradient) < 0.5 * natural)
    assert np.abs(exact.gradient / natural).max() > 5.0
    assert np.diagonal(fixed.information) == pytest.approx(np.diagonal(exact.information), rel=0.05)


def test_a_coordinate_of_one_drive_moves_that_drive_alone():
    innovations, _ = car_fit(22, duration=5.0)
    spec, names = innovations.spec, innovations.names
    row = names.index(FREE[0])
    p = innovations.model.parameters[row]
    own = parameter_coordinate(p, row, spec.values[p.name], drives=(1,))
    space = Coordinates(spec, names, [own], [Candidates.of(spec)] * 2)
    z = space.centre + 0.1
    values = [space.candidates(z, i).values[row, 0] for i in (0, 1)]
    assert values == pytest.approx([spec.values[p.name], np.exp(0.1) * spec.values[p.name]])
    slopes = [space.directions(z, drive=i).values[row, 0] for i in (0, 1)]
    assert slopes == [0.0, values[1]]


def test_priors_count_in_values_slopes_and_information():
    innovations, drive = car_fit(23, duration=5.0)
    spec = innovations.spec
    first = [spec.measurement_noise[n] for n in innovations.model.outputs]
    alone, held = (Coordinates.of(spec, FREE, first, priors, process=False) for priors in ({}, {FREE[0]: 0.01}))
    z, moved = alone.centre.copy(), alone.kind("parameter")
    z[0] += 0.02
    objectives = [LogPosterior(innovations, [drive], space) for space in (alone, held)]
    values = [o.values(z[:, None])[0] for o in objectives]
    assert values[1] == pytest.approx(values[0] - 2.0)
    without, with_it = (o.slopes(z, moved) for o in objectives)
    assert with_it[0] == pytest.approx(values[1])
    assert with_it[1] - without[1] == pytest.approx([-200.0, 0.0])
    assert with_it[2] - without[2] == pytest.approx(np.diag([1e4, 0.0]))


def test_of_two_quantities_that_act_as_one_neither_is_known():
    scale = np.array([1.0, 1e3, 1e-4])
    information = np.array([[4.0, 4.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, 25.0]]) * np.outer(scale, scale)
    found = covariance_of(information)
    assert found.lost.tolist() == [True, True, False]
    assert found.errors == pytest.approx([np.inf, np.inf, 1.0 / (5.0 * 1e-4)])
    assert found.correlation[0, 1] == pytest.approx(-1.0)
    solved = covariance_of(information, dropped=True).matrix @ (information @ np.array([1.0, 1e-3, 1.0]))
    assert solved == pytest.approx([1.0, 1e-3, 1.0])


def test_what_is_known_has_the_errors_of_the_inverse_and_what_is_silent_has_none():
    root = np.random.default_rng(4).normal(size=(9, 3))
    information = root.T @ root
    found = covariance_of(information)
    assert found.matrix == pytest.approx(np.linalg.inv(information))
    assert found.errors == pytest.approx(np.sqrt(np.diagonal(np.linalg.inv(information))))
    silent = np.zeros((4, 4))
    silent[:3, :3] = information
    assert covariance_of(silent).errors == pytest.approx([*found.errors, np.inf])
    assert np.all(np.isinf(covariance_of(np.zeros((2, 2))).errors))


def test_a_judgement_tells_the_error_of_the_model_alone_from_that_of_one_step():
    innovations, drive = car_fit(24, duration=10.0)
    calm = innovations.drive(recorded(model_of(CAR), 25, duration=5.0, amplitude=0.1), "calm")
    right = Candidates.of(innovations.spec)
    wrong = right.take([0])
    wrong.values[innovations.row(FREE[0])] *= 0.8
    good, bad = (judged_on(innovations, [drive, calm], c) for c in (right, wrong))
    assert [j.drive.name for j in good] == ["drive", "calm"]
    run = innovations.run(drive, right)
    begin = len(drive.time) // FEWEST
    start = Start(begin, run.state[begin])
    simulated = innovations.free_run(drive, right.values[:, 0], start).outputs
    assert np.isnan(simulated[:begin]).all()
    assert np.array_equal(good[0].simulated, simulated, equal_nan=True)
    expected = np.sqrt(np.mean((drive.measurements - simulated)[begin:] ** 2, axis=0))
    assert good[0].simulation_error == pytest.approx(expected)
    assert good[0].one_step_error == pytest.approx(np.sqrt(np.nanmean(run.innovation**2, axis=0)))
    assert good[0].log_likelihood == run.log_likelihood > bad[0].log_likelihood
    assert np.all(bad[0].simulation_error > good[0].simulation_error)
    assert min(w.ljung_box for w in good[0].whiteness) > 1e-4
    innovations._limits[0] = 0.5 * np.nanmax(np.abs(simulated[:, 0]))
    (lost,) = judged_on(innovations, [drive], dataclasses.replace(right, measurement=1.01 * right.measurement))
    assert np.isnan(lost.simulated[-1]).all()
    assert np.isfinite(lost.simulated[begin]).all()
    assert good[0].stays
    assert not lost.stays
    assert lost.log_likelihood == -np.inf


def test_a_drive_that_is_cut_in_a_bend_is_simulated_as_well_as_the_whole_one():
    """Nothing measures a semitrailer's lateral velocities: from zero a free run would have to find them."""
    innovations = Innovations(model_of({**TRUCK, "noise": {"measurement_scale": 0.01, "process_scale": 1e-6}}), "ekf")
    whole = recorded(innovations.spec, 25, duration=40.0, amplitude=0.3)
    time, bend = whole["time"].to_numpy(), int(np.argmax(np.abs(whole["yaw_rate_tractor"].to_numpy()[:1500])))
    cut = whole.isel(time=slice(bend, None)).assign_coords(time=time[:-bend])
    right = Candidates.of(innovations.spec)
    drives = [innovations.drive(r, name) for r, name in ((whole, "whole"), (cut, "cut"))]
    of_whole, of_cut = (j.simulation_error for j in judged_on(innovations, drives, right))
    assert of_cut == pytest.approx(of_whole, rel=0.02)
    begun = drives[1].measurements - innovations.free_run(drives[1], right.values[:, 0]).outputs
    in_a_second = np.sqrt(np.mean(begun[:100] ** 2, axis=0)) / of_cut
    assert in_a_second.max() > 3.0
