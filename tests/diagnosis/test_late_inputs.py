"""An input that was recorded late is read ahead by whole samples; only what is left of its delay is approximated."""

from dataclasses import replace

import numpy as np
import pytest

from harness.diagnosis.innovations.innovation_model import Linearised, ModelTangents
from harness.identification.candidates import Candidates
from support.driven_car import driven


def late(drive, column, samples):
    """Return a drive of which an input comes late by a number of samples."""
    inputs, between = drive.inputs.copy(), drive.between.copy()
    for part in (inputs, between):
        part[:, column] = np.concatenate([np.repeat(part[:1, column], samples), part[:-samples, column]])
    return replace(drive, inputs=inputs, between=between)


@pytest.fixture(scope="module")
def drive(augmented):
    return augmented.drive(driven(70), "punctual")


@pytest.fixture(scope="module")
def steering(augmented):
    return augmented.model.inputs.index("steering_wheel_angle")


def held(augmented, **values):
    """Return the nominal model with some other parameters, one candidate for each of their values."""
    count = max(np.size(v) for v in values.values())
    point = Candidates.of(augmented.spec).take([0] * count)
    at = np.repeat(augmented.stated()[:, None], count, axis=1)
    for name, value in values.items():
        at[augmented.row(name)] = value
    return replace(point, values=at)


def test_whole_samples_are_read_ahead_and_the_rest_of_the_delay_is_left(augmented, drive, steering):
    row = augmented.row("steering_delay")
    read, left = augmented.read_ahead(drive, held(augmented, steering_delay=-0.043).values)
    assert left[row, 0] == pytest.approx(-0.003)
    assert np.array_equal(read.inputs[:-4, steering], drive.inputs[4:, steering])
    assert np.array_equal(read.between[:-4, steering], drive.between[4:, steering])
    assert np.all(read.inputs[-4:, steering] == drive.inputs[-1, steering])
    others = [i for i in range(drive.inputs.shape[1]) if i != steering]
    assert np.array_equal(read.inputs[:, others], drive.inputs[:, others])
    again, same = augmented.read_ahead(read, left)
    assert again is read
    assert same is left
    for delay in (0.0, 0.04, -0.004):  # the past is there, and less than half a sample is approximated well
        assert augmented.read_ahead(drive, held(augmented, steering_delay=delay).values)[0] is drive


def test_a_late_recording_is_as_likely_with_its_delay_as_a_punctual_one_without(augmented, drive, steering):
    """Of second order alone the filter would be off by milliseconds, and the likelihood by hundreds."""
    behind = late(drive, steering, 4)
    (punctual,) = augmented.log_likelihoods([drive], held(augmented, steering_delay=0.0))
    found = augmented.log_likelihoods([behind], held(augmented, steering_delay=[-0.04, 0.0]))
    assert found[0] == pytest.approx(punctual, abs=5.0)  # of the last four samples, of which nothing is known
    assert found[1] < punctual - 500.0
    free = augmented.free_run(behind, held(augmented, steering_delay=-0.04).values[:, 0]).outputs
    exact = augmented.free_run(drive, augmented.stated()).outputs
    assert free[:-4] == pytest.approx(exact[:-4], abs=1e-12)


def test_candidates_of_any_delay_are_each_as_alone(augmented, drive, steering):
    delays = np.array([-0.02, 0.0, -0.031, 0.015, -0.024, -0.016, -0.02, 0.0, -0.05])
    both = [drive, late(drive, steering, 2)]
    many = augmented.log_likelihoods(both, held(augmented, steering_delay=delays))
    each = [augmented.log_likelihoods(both, held(augmented, steering_delay=d))[0] for d in delays]
    assert many.tolist() == each
    assert len(set(each)) == 7  # some delays are there twice


def test_sensitivities_and_the_linear_model_are_those_of_the_punctual_recording(augmented, drive, steering):
    behind = late(drive, steering, 3)
    here, there = held(augmented, steering_delay=0.0), held(augmented, steering_delay=-0.03)
    directions = augmented.along(["stiffness_peak_front", "steering_delay"])
    linear, columns = [], []
    for recording, point in ((drive, here), (behind, there)):
        kept = augmented.run(recording, point)
        columns.append(augmented.sensitivities(recording, point.values, directions, kept))
        linear.append(Linearised(ModelTangents(augmented), recording, point.values[:, 0], kept))
    scale = np.abs(columns[0]).max(axis=(0, 1))
    assert columns[1][:-3] / scale == pytest.approx(columns[0][:-3] / scale, abs=1e-9)
    assert linear[1].transition[:-4] == pytest.approx(linear[0].transition[:-4], abs=1e-9)
    moved = [model.along([p.values[:, 0]], [directions[:, 1]]) for model, p in zip(linear, (here, there), strict=True)]
    assert moved[1][0][:-4] == pytest.approx(moved[0][0][:-4], abs=1e-9)


def test_a_speed_that_was_recorded_late_is_read_ahead_as_well(augmented, drive):
    column = augmented.model.inputs.index("speed")
    read, _ = augmented.read_ahead(drive, held(augmented, speed_delay=-0.02, steering_delay=-0.01).values)
    assert np.array_equal(read.inputs[:-2, column], drive.inputs[2:, column])
    assert augmented.read_ahead(drive, held(augmented, sensor_delay_yaw_rate=0.03).values)[0] is drive
