"""Where something is missing and what it looks like: known answers on drives of a car that was simulated."""

import dataclasses

import numpy as np
import pytest

from harness.diagnosis.innovations.disturbance_inputs import disturbance_inputs_of
from harness.diagnosis.residuals.dependence import WITHIN, regressors_of, with_quick
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.innovation_tests import consistency, cross_correlation
from harness.diagnosis.residuals.unmodelled import find_unmodelled
from harness.diagnosis.result.answer import described
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut
from support.driven_car import driven, fitted

GUST, TIMES = 400.0, ((20.0, 31.0), (35.0, 44.0))


@pytest.fixture(scope="module")
def gusty(augmented):
    drives = [
        augmented.drive(
            driven(i, ["crosswind"], crosswind_force=GUST, crosswind_onset=a, crosswind_end=b), f"drive {i}"
        )
        for i, (a, b) in enumerate(TIMES)
    ]
    fitting, fit = fitted(augmented, drives)
    return DisturbanceRanking(fitting, fit.point)


def test_every_way_into_the_model_is_an_entry_once(augmented):
    names = [c.name for c in disturbance_inputs_of(augmented)]
    assert len(set(names)) == len(names)
    assert {"d/dt yaw_rate", "external_lateral_force", "road_wheel_angle", "lateral_gravity", "yaw_rate"} <= set(names)
    # How much drag there is depends on the speed: that is an effect, and no disturbance of a port.
    assert not any("aerodynamic" in p for c in disturbance_inputs_of(augmented) for p in c.parameters)


def test_a_gust_is_found_where_it_acts_with_its_force(gusty):
    names = [s.disturbance_input.name for s in gusty.ranked_inputs]
    assert names.index("external_lateral_force") < 3
    force = gusty.ranked_inputs[names.index("external_lateral_force")]
    assert force.gain > 100
    for drive, history, (begin, end) in zip(gusty.drives, gusty.history(force), TIMES, strict=True):
        during = (drive.time > begin + 3) & (drive.time < end - 1)
        before = (drive.time > 2) & (drive.time < begin - 1)
        assert history.mean[during].mean() == pytest.approx(GUST, rel=0.2)
        assert abs(history.mean[before].mean()) < 0.15 * GUST
        assert history.error[during].max() < 0.5 * GUST


def hardening(seed, augmented, share=0.3, largest=0.015):
    """Return a drive whose steering turns the wheels more than in proportion, by ``share`` at the largest angle."""
    recording = driven(seed)
    true = recording["steering_wheel_angle"].to_numpy()
    grid = np.linspace(-2 * largest, 2 * largest, 4001)
    felt = np.interp(true, grid + share * grid**3 / largest**2, grid)
    assert np.abs(felt).max() > 0.7 * largest
    return augmented.drive(recording.assign(steering_wheel_angle=("time", felt)), f"drive {seed}")


def test_what_has_no_name_is_found_as_a_curve_that_helps_on_a_drive_kept_aside(augmented):
    *train, test = (hardening(seed, augmented) for seed in (60, 61, 62))
    fitting, fit = fitted(augmented, train)
    held_out = HeldOut(augmented, [test], first_variances(augmented, [*train, test]))
    before = held_out.judge((), fit.point)
    found = find_unmodelled(fitting, held_out, fit, before, DisturbanceRanking(fitting, fit.point))
    assert found is not None
    curve = found.curves[0]
    assert curve.regressor.name == "steering_wheel_angle"
    assert curve.disturbance_input.name in ("road_wheel_angle", "steady_lateral_force_axle_front", "d/dt yaw_rate")
    assert "odd in the steering wheel angle" in described(curve)
    assert found.held_out_gain > 25
    assert found.judgement.normalised_excess_mse < 0.25 * before.normalised_excess_mse


def test_nothing_is_found_where_nothing_is_missing(augmented):
    *train, test = (augmented.drive(driven(seed), f"drive {seed}") for seed in (63, 64, 65))
    fitting, fit = fitted(augmented, train)
    held_out = HeldOut(augmented, [test], first_variances(augmented, [*train, test]))
    ranking = DisturbanceRanking(fitting, fit.point)
    assert ranking.ranked_inputs[0].gain < 25
    assert find_unmodelled(fitting, held_out, fit, held_out.judge((), fit.point), ranking) is None


def test_the_quick_part_of_a_signal_forgets_and_knows_nothing_of_its_own_sample(augmented):
    """After a step to one, what is left of the signal without its low-pass falls by its time constant."""
    drive = augmented.drive(driven(66), "drive")
    states, inputs = np.zeros((len(drive.time), len(augmented.model.states))), drive.inputs.copy()
    column, step = augmented.model.inputs.index("steering_wheel_angle"), float(drive.time[1])
    inputs[:, column] = drive.time >= 1.0
    drive = dataclasses.replace(drive, inputs=inputs)
    whole_signal, *quick = [d for d in with_quick(regressors_of(augmented)) if d.name == "steering_wheel_angle"]
    assert np.array_equal(whole_signal.over(states, drive), inputs[:, column])
    assert [d.within for d in quick] == list(WITHIN)
    first = int(np.argmax(inputs[:, column]))
    for d in quick:
        left = d.over(states, drive)
        assert np.all(left[: first + 1] == 0.0)
        later = np.arange(first + 1, len(left))
        assert left[later] == pytest.approx(np.exp(-step / d.within) ** (later - first), rel=1e-9)
        assert "quick part of the steering wheel angle" in d.words


def test_drivers_are_inputs_and_measured_motion_and_never_forces(augmented):
    found = {d.name: d for d in regressors_of(augmented)}
    assert {"steering_wheel_angle", "speed", "yaw_rate", "steering_wheel_angle_rate", "yaw_rate*speed"} <= set(found)
    assert all(d.unit != "N" for d in found.values())


def test_correlation_finds_the_lag_of_what_is_missing_and_stays_in_its_band_elsewhere():
    rng = np.random.default_rng(2)
    signals = [np.cumsum(rng.normal(size=(4000, 2)), axis=0) * 0.02 + rng.normal(size=(4000, 2)) for _ in range(2)]
    whitened = []
    for s in signals:
        r = rng.normal(size=(4000, 2))
        r[50:, 1] += 0.3 * s[:-50, 0]
        r[100:120, 0] = np.nan
        whitened.append(r)
    found = cross_correlation(whitened, signals, 0.01)
    assert found.lag[np.argmax(np.abs(found.values[:, 1, 0]))] == pytest.approx(0.5)
    assert np.abs(found.values[:, 1, 0]).max() > 10 * found.band[1]
    others = np.abs(found.values[:, 0, :]) / found.band[0]
    assert np.mean(others > 1.0) < 0.15


def test_the_nis_of_white_innovations_lies_in_its_band():
    rng = np.random.default_rng(3)
    whitened = rng.normal(size=(6000, 3))
    whitened[::7, 1] = np.nan
    found = consistency(np.arange(6000) * 0.01, whitened)
    assert found.inside == pytest.approx(0.95, abs=0.01)
    assert found.nis.mean() == pytest.approx(1.0, abs=0.05)
    outside = (found.nis < found.band[0]) | (found.nis > found.band[1])
    assert outside.mean() < 0.15
    assert consistency(np.arange(6000) * 0.01, 1.5 * whitened).inside < 0.85
