"""What turns once per distance driven, without a name: a car whose steered wheels shake, at varying speed."""

import numpy as np
import pytest

from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.order_analysis import DistanceDomainDrive, Waves, find_periodic, in_distance_domain
from harness.diagnosis.residuals.unmodelled import find_unmodelled
from harness.diagnosis.result.answer import described
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut
from support.driven_car import driven, fitted

TURN, SIZE = 2.1, 3e-3


def distance(recording):
    """Return the distance driven at each sample."""
    v, time = recording["speed"].to_numpy(), recording["time"].to_numpy()
    return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time))])


def shaken(seed, augmented, phase, growth=0):
    """Return a drive in which the steered wheels turn by ``SIZE`` to and fro, once per ``TURN``."""
    recording = driven(seed)
    v = recording["speed"].to_numpy()
    shake = SIZE * (v / v.mean()) ** growth * np.cos(2 * np.pi * distance(recording) / TURN - phase)
    felt = recording["steering_wheel_angle"].to_numpy() - shake
    return augmented.drive(recording.assign(steering_wheel_angle=("time", felt)), f"drive {seed}")


def test_what_turns_is_found_and_helps_on_a_drive_kept_aside(augmented):
    *train, test = (shaken(seed, augmented, phase) for seed, phase in ((60, 0.3), (61, 2.0), (62, 4.4)))
    fitting, fit = fitted(augmented, train)
    held_out = HeldOut(augmented, [test], first_variances(augmented, [*train, test]))
    before = held_out.judge((), fit.point)
    found = find_unmodelled(fitting, held_out, fit, before, DisturbanceRanking(fitting, fit.point))
    assert found is not None
    periodic = found.periodic[0]
    assert periodic.disturbance_input.name in (
        "road_wheel_angle",
        "steady_lateral_force_axle_front",
        "external_lateral_force",
    )
    assert periodic.wavelength == pytest.approx(TURN, rel=1e-3)
    assert "once per 2.10 m driven" in described(periodic)
    assert found.held_out_gain > 25
    assert found.judgement.normalised_excess_mse < 0.1 * before.normalised_excess_mse
    assert periodic.amplitude == pytest.approx(SIZE, rel=0.05)  # the model's input runs straight between samples


def test_what_grows_with_the_speed_is_told_from_what_does_not(augmented):
    for growth in (0, 2):
        drives = [shaken(seed, augmented, phase, growth) for seed, phase in ((70, 1.0), (71, 3.0))]
        fitting, fit = fitted(augmented, drives)
        ranking = DisturbanceRanking(fitting, fit.point, ranked=False)
        speeds = [d.inputs[:, augmented.model.inputs.index("speed")] for d in drives]
        periodic = find_periodic(ranking, ranking.disturbance_inputs, in_distance_domain(ranking, speeds), 25.0)
        assert periodic is not None
        assert periodic.growth == growth


def test_nothing_turns_where_no_distance_is_driven(augmented):
    fitting, fit = fitted(augmented, [shaken(72, augmented, 1.0)])
    ranking = DisturbanceRanking(fitting, fit.point, ranked=False)
    standing = [np.zeros(len(d.time)) for d in fitting.drives]
    assert find_periodic(ranking, ranking.disturbance_inputs, in_distance_domain(ranking, standing), 25.0) is None


def test_the_pull_on_a_disturbance_is_that_of_its_response():
    """The adjoint gives for every sample at once what one response per sample gives."""
    rng = np.random.default_rng(5)
    samples, n, ny = 40, 3, 2
    model = InnovationModel(
        0.5 * rng.normal(size=(samples, n, n)), rng.normal(size=(samples, ny, n)), rng.normal(size=(samples, ny)), 0.01
    )
    input_direction = InputDirection(rng.normal(size=(samples, n)), rng.normal(size=(samples, ny)))
    distance_drive = DistanceDomainDrive(model, model.residual, np.arange(40.0), np.ones(40))
    responses = model.responses(input_direction, np.eye(samples))
    pull = distance_drive.pull(input_direction, model.adjoint(model.residual))
    assert pull[1:] == pytest.approx(np.tensordot(responses, model.residual, ((0, 1), (0, 1)))[1:])


def test_the_phase_is_the_best_of_the_circle():
    rng = np.random.default_rng(6)
    model = InnovationModel(np.zeros((30, 1, 1)), np.zeros((30, 1, 1)), rng.normal(size=(30, 1)), 0.01)
    input_direction, waves = InputDirection(np.zeros((30, 1)), np.ones((30, 1))), rng.normal(size=(30, 2))
    distance_drive = DistanceDomainDrive(model, model.residual, np.arange(30.0), np.ones(30))
    shares, gain, explained = distance_drive.phase(input_direction, Waves(waves, np.zeros_like(waves)))
    assert np.hypot(*shares) == pytest.approx(1.0)
    assert explained[1:, 0] == pytest.approx((waves @ shares)[1:])
    for angle in np.linspace(0.0, 6.2, 50):
        x = (waves @ [np.cos(angle), np.sin(angle)])[1:]
        assert x @ model.residual[1:, 0] - 0.5 * x @ x <= gain + 1e-12
