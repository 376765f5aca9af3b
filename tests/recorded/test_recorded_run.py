"""Estimators on recordings: the same filter as everywhere, missing samples skipped, references, what is refused."""

import numpy as np
import pytest

from harness.common.errors import ModelError, UserError
from harness.config import resolve_single
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.identification.candidates import Candidates
from harness.recorded.run import RecordedEstimator, RecordedModel, certain_in_words
from harness.simulation.simulate import in_lanes, variances
from support.identification import CAR, TRUCK, model_of, recorded

MEASURED = ("yaw_rate", "heading", "lateral_velocity_rear")


@pytest.fixture(scope="module")
def car():
    return RecordedModel(model_of(CAR), inputs="held", jobs=1)


@pytest.fixture(scope="module")
def drive():
    return recorded(model_of(CAR), 5, duration=20.0, speed=15.0, amplitude=0.5)


def with_gaps(recording, every=7):
    """Return a recording of which some samples of one output and whole samples are missing."""
    found = recording.copy(deep=True)
    found["yaw_rate"][3::every] = np.nan
    for name in MEASURED:
        found[name][200:260] = np.nan
    return found


def test_the_likelihood_is_that_of_identification(car, drive):
    run = RecordedEstimator(car, "ekf").run(drive)
    kept = car.filtered.run(car.drive(drive), Candidates.of(car.spec))
    assert run.attrs["log_likelihood"] == pytest.approx(kept.log_likelihood, rel=1e-12)
    np.testing.assert_allclose(run["innovation_yaw_rate"], kept.innovation[:, 1], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run["nis"][1:], np.sum(kept.whitened[1:] ** 2, axis=1), rtol=1e-9)


def test_missing_samples_are_skipped_exactly(car, drive):
    gaps = with_gaps(drive)
    run = RecordedEstimator(car, "ekf").run(gaps)
    held, spec = car.drive(gaps), car.spec
    stepped = CompiledEstimator("ekf", car.compiled)
    state = stepped.init(held.first_mean, held.first_variance)
    belief = stepped.belief(
        car.compiled.constants(in_lanes(car.compiled.parameter_vector(spec.values))),
        in_lanes(variances(spec.process_noise, spec.model().states)),
        in_lanes(variances(spec.measurement_noise, list(spec.model().outputs))),
    )
    for k in range(1, 300):
        rows = (held.inputs[k - 1], held.inputs[k], held.measurements[k])
        state, _ = stepped.step(state, *(np.ascontiguousarray(np.repeat(r[:, None], LANES, 1)) for r in rows), belief)
        assert float(run["yaw_rate"][k]) == state.mean[1, 0]
        assert float(run["yaw_rate_std"][k]) == pytest.approx(np.sqrt(state.covariance[1, 1, 0]), rel=1e-12)
    assert int(run["nis_degrees"][230]) == 0
    assert np.isnan(run["nis"][230])
    assert int(run["nis_degrees"][10]) == 2
    assert np.isnan(run["innovation_yaw_rate"][10])
    assert np.isfinite(run["innovation_heading"][10])
    assert np.all(np.diff(run["heading_std"][200:260]) > 0)  # nothing corrects it


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_the_right_model_is_consistent_on_a_simulated_drive(car, drive, kind):
    run = RecordedEstimator(car, kind).run(drive)
    assert float(run["nis"].mean()) == pytest.approx(3.0, abs=0.15)
    assert float(run["nees"].mean()) == pytest.approx(3.0, abs=0.8)
    assert set(np.unique(run["nees_degrees"])) == {3.0}
    error = run["lateral_velocity_rear"] - drive["true_lateral_velocity_rear"].values
    np.testing.assert_array_equal(run["error_lateral_velocity_rear"], error)


def test_variables_carry_their_units_and_what_belongs_to_them(car, drive):
    run = RecordedEstimator(car, "ukf", {"alpha": 0.5}, name="mine").run(drive)
    about = run["lateral_velocity_rear"].attrs
    assert about["units"] == "m/s"
    assert about["ancillary_variables"] == "lateral_velocity_rear_std"
    assert run["innovation_yaw_rate"].attrs["units"] == "rad/s"
    assert run.attrs["estimator"] == "mine"
    assert run.attrs["settings"] == "alpha=0.5"
    assert "given all samples" in run.attrs["comment"]


def test_a_state_that_nothing_moves_begins_certain_and_is_said():
    spec = resolve_single({**TRUCK, "sensors": "series"}, "test")
    model = RecordedModel(spec, inputs="held", jobs=1)
    curved = recorded(spec, 1, duration=6.0, speed=15.0, amplitude=0.3)
    straight = curved.copy(deep=True)
    straight["steering_wheel_angle"][:] = 0.0
    for name in spec.model().outputs:
        straight[name][0] = 0.0  # a measured state begins as measured
    moved, at_rest = (RecordedEstimator(model, "ekf").run(each) for each in (curved, straight))
    unmeasured = [state for state in spec.model().states if state not in spec.model().outputs]
    assert certain_in_words([moved]) == []
    (sentence,) = certain_in_words([at_rest, at_rest])
    assert sentence.startswith(f"{', '.join(unmeasured)}: a free run does not move them")


def test_a_particle_filter_follows_its_seed():
    spec = model_of({**CAR, "noise": {"process_scale": 10.0}})
    model = RecordedModel(spec, inputs="held", jobs=1)
    drive = recorded(spec, 2, duration=6.0, speed=15.0, amplitude=0.3)
    one, same, other = (RecordedEstimator(model, "particle", {"particles": 256}).run(drive, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one["yaw_rate"], same["yaw_rate"])
    assert np.any(one["yaw_rate"] != other["yaw_rate"])
    assert float(np.sqrt((one["error_yaw_rate"] ** 2).mean())) < 3 * float(one["yaw_rate_std"].mean())


def test_a_network_estimates_what_it_was_trained_for_and_states_no_covariance():
    spec = resolve_single({**TRUCK, "sensors": "series"}, "test")
    truck = recorded(spec, 1, duration=5.0, speed=15.0, amplitude=0.3)
    run = RecordedEstimator(RecordedModel(spec, inputs="held", jobs=1), "narx").run(truck)
    assert np.isfinite(run["articulation_angle"]).all()
    assert np.isnan(run["yaw_rate_tractor"]).all()
    assert np.isnan(run["articulation_angle_std"]).all()
    assert np.isnan(run["nis"]).all()
    assert np.isnan(run.attrs["log_likelihood"])
    assert float(np.abs(run["error_articulation_angle"]).mean()) < 0.02


def test_an_unknown_input_is_estimated_from_where_its_random_walk_may_be():
    table = {**TRUCK, "parameters": "ziaukas_2023_road_wheels", "unknown_inputs": ["steering_wheel_angle"]}
    plant = model_of(TRUCK)
    truck = recorded(plant, 1, duration=20.0, speed=15.0, amplitude=1.0)
    model = RecordedModel(resolve_single(table, "test", "belief"), inputs="held", jobs=1)
    run = RecordedEstimator(model, "ekf").run(truck)
    walk = model.spec.process_noise["steering_wheel_angle"]
    assert float(run["steering_wheel_angle_std"][0]) == pytest.approx(np.sqrt(1000 * walk))
    settled = run.isel(time=slice(500, None))
    error = float(np.sqrt((settled["error_steering_wheel_angle"] ** 2).mean()))
    assert error < 0.5 * float(np.sqrt((settled["reference_steering_wheel_angle"] ** 2).mean()))
    assert 0.05 < float(settled["nees_steering_wheel_angle"].mean()) < 2.0


def test_from_a_divergence_on_nothing_is_estimated(car, drive):
    broken = drive.copy(deep=True)
    broken["lateral_velocity_rear"][500:] = 1e6
    run = RecordedEstimator(car, "ekf").run(broken)
    assert run.attrs["diverged_at"] == pytest.approx(5.0)
    assert np.isfinite(run["yaw_rate"][:500]).all()
    for name in ("yaw_rate", "yaw_rate_std", "nis", "error_yaw_rate", "nees"):
        assert np.isnan(run[name][500:]).all(), name
    assert np.isfinite(run.attrs["log_likelihood"])


def test_a_signal_is_the_reference_of_one_quantity_only(car, drive):
    stated = RecordedModel(car.spec, inputs="held", references={"slip_angle_rear": "yaw_rate"}, jobs=1)
    assert "yaw_rate" in car.reference(drive)
    found = stated.reference(drive)
    assert found["slip_angle_rear"] == "true_yaw_rate"
    assert "yaw_rate" not in found


def test_a_reference_is_what_the_estimators_do_not_measure(car, drive):
    measured = drive.drop_vars([f"true_{n}" for n in MEASURED])
    assert car.reference(measured) == {}
    run = RecordedEstimator(car, "ekf").run(measured)
    assert "nees" not in run
    other = RecordedModel(car.spec, (), "held", {"slip_angle_rear": "beta"}, jobs=1)
    with pytest.raises(UserError, match="lacks 'beta'"):
        other.reference(measured)
    named = measured.assign(beta=measured["yaw_rate"] * 0.1)
    assert other.reference(named) == {"slip_angle_rear": "beta"}
    assert "error_slip_angle_rear" in RecordedEstimator(other, "ekf").run(named)
    circular = RecordedModel(car.spec, (), "held", {"slip_angle_rear": "yaw_rate"}, jobs=1)
    with pytest.raises(UserError, match="the estimators measure 'yaw_rate'"):
        circular.reference(measured)


def test_a_port_that_follows_from_the_states_adds_nothing_to_the_nees(car):
    drive = recorded(car.spec, 5, ["lateral_acceleration"], duration=6.0, speed=15.0, amplitude=0.5)
    more = RecordedModel(car.spec, ["lateral_acceleration", "speed"], "held", jobs=1)
    assert list(more.reference(drive)) == [*car.spec.model().states, "lateral_acceleration"]  # speed is known
    one, two = (RecordedEstimator(m, "ekf").run(drive) for m in (car, more))
    np.testing.assert_array_equal(two["nees_degrees"][1:], 3.0)
    np.testing.assert_allclose(two["nees"][50:], one["nees"][50:], rtol=0.05)


def test_what_cannot_be_is_refused_in_words(car, drive):
    with pytest.raises(ModelError, match="no quantity 'yaw_rat'"):
        RecordedModel(car.spec, ["yaw_rat"])
    with pytest.raises(UserError, match=r"0\.02 s apart"):
        RecordedEstimator(car, "ekf").run(drive.isel(time=slice(None, None, 2)))
    with pytest.raises(UserError, match="lacks 'speed'"):
        RecordedEstimator(car, "ekf").run(drive.drop_vars("speed"))
    with pytest.raises(UserError, match="alpa"):
        RecordedEstimator(car, "ukf", {"alpa": 1.0})
