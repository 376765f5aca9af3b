"""What turns once per distance driven, without a name: a car whose steered wheels shake, at varying speed."""

import numpy as np
import pytest

from harness.config import resolve_single
from harness.diagnosis.innovations.innovation_model import Inlet, InnovationModel
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.residuals.disturbance_ranking import Pinpoint
from harness.diagnosis.residuals.order_analysis import Ride, Waves, find_turning, ridden
from harness.diagnosis.residuals.unmodelled import find_unnamed
from harness.diagnosis.result.wording import described
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut
from support.driven_car import CAR, SIGNALS, driven, fitted

TURN, SIZE = 2.1, 3e-3


@pytest.fixture(scope="module")
def whole():
    return AugmentedModel(resolve_single({**CAR, "integrator": "rk4"}, "test"), SIGNALS, jobs=2)


def distance(recording):
    """Return the distance driven at each sample."""
    v, time = recording["speed"].to_numpy(), recording["time"].to_numpy()
    return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time))])


def shaken(seed, whole, phase, growth=0):
    """Return a drive in which the steered wheels turn by ``SIZE`` to and fro, once per ``TURN``."""
    recording = driven(seed)
    v = recording["speed"].to_numpy()
    shake = SIZE * (v / v.mean()) ** growth * np.cos(2 * np.pi * distance(recording) / TURN - phase)
    felt = recording["steering_wheel_angle"].to_numpy() - shake
    return whole.drive(recording.assign(steering_wheel_angle=("time", felt)), f"drive {seed}")


def test_what_turns_is_found_and_helps_on_a_drive_kept_aside(whole):
    *train, test = (shaken(seed, whole, phase) for seed, phase in ((60, 0.3), (61, 2.0), (62, 4.4)))
    fitting, fit = fitted(whole, train)
    held_out = HeldOut(whole, [test], first_variances(whole, [*train, test]))
    before = held_out.judge((), fit.point)
    found = find_unnamed(fitting, held_out, fit, before, Pinpoint(fitting, fit.point))
    assert found is not None
    turning = found.turning[0]
    assert turning.channel.name in ("road_wheel_angle", "steady_lateral_force_axle_front", "external_lateral_force")
    assert turning.wavelength == pytest.approx(TURN, rel=1e-3)
    assert "once per 2.10 m driven" in described(turning)
    assert found.held_out_gain > 25
    assert found.judgement.excess < 0.1 * before.excess
    assert turning.amplitude == pytest.approx(SIZE, rel=0.05)  # the model's input runs straight between samples


def test_what_grows_with_the_speed_is_told_from_what_does_not(whole):
    for growth in (0, 2):
        drives = [shaken(seed, whole, phase, growth) for seed, phase in ((70, 1.0), (71, 3.0))]
        fitting, fit = fitted(whole, drives)
        pinpoint = Pinpoint(fitting, fit.point, ranked=False)
        speeds = [d.inputs[:, whole.model.inputs.index("speed")] for d in drives]
        turning = find_turning(pinpoint, pinpoint.channels, ridden(pinpoint, speeds), 25.0)
        assert turning is not None
        assert turning.growth == growth


def test_nothing_turns_where_no_distance_is_driven(whole):
    fitting, fit = fitted(whole, [shaken(72, whole, 1.0)])
    pinpoint = Pinpoint(fitting, fit.point, ranked=False)
    standing = [np.zeros(len(d.time)) for d in fitting.drives]
    assert find_turning(pinpoint, pinpoint.channels, ridden(pinpoint, standing), 25.0) is None


def test_the_pull_on_a_disturbance_is_that_of_its_response():
    """The adjoint gives for every sample at once what one response per sample gives."""
    rng = np.random.default_rng(5)
    samples, n, ny = 40, 3, 2
    model = InnovationModel(
        0.5 * rng.normal(size=(samples, n, n)), rng.normal(size=(samples, ny, n)), rng.normal(size=(samples, ny)), 0.01
    )
    inlet = Inlet(rng.normal(size=(samples, n)), rng.normal(size=(samples, ny)))
    ride = Ride(model, model.residual, np.arange(40.0), np.ones(40))
    responses = model.responses(inlet, np.eye(samples))
    pull = ride.pull(inlet, model.adjoint(model.residual))
    assert pull[1:] == pytest.approx(np.tensordot(responses, model.residual, ((0, 1), (0, 1)))[1:])


def test_the_phase_is_the_best_of_the_circle():
    rng = np.random.default_rng(6)
    model = InnovationModel(np.zeros((30, 1, 1)), np.zeros((30, 1, 1)), rng.normal(size=(30, 1)), 0.01)
    inlet, waves = Inlet(np.zeros((30, 1)), np.ones((30, 1))), rng.normal(size=(30, 2))
    ride = Ride(model, model.residual, np.arange(30.0), np.ones(30))
    shares, gain, explained = ride.phase(inlet, Waves(waves, np.zeros_like(waves)))
    assert np.hypot(*shares) == pytest.approx(1.0)
    assert explained[1:, 0] == pytest.approx((waves @ shares)[1:])
    for angle in np.linspace(0.0, 6.2, 50):
        x = (waves @ [np.cos(angle), np.sin(angle)])[1:]
        assert x @ model.residual[1:, 0] - 0.5 * x @ x <= gain + 1e-12
