"""Noise from innovations: found and certain where recordings show it, as stated and said so where they do not."""

import dataclasses
import json

import numpy as np
import pytest

from bench.tuning import CASES, coverage
from harness.common.errors import UserError
from harness.config import resolve_single
from harness.recorded.run import RecordedEstimator, RecordedModel
from harness.recorded.summary import summary
from harness.recorded.tuning import tune_noise
from harness.recorded.tuning_report import report, write_tuning
from harness.reporting.document import Sheet, made
from support.identification import CAR, model_of, recorded


def believed(**factors):
    """Return the car's model with some variances wrong by a factor, by state or output."""
    spec = model_of(CAR)

    def wrong(noise, kind):
        return {n: v * factors.get(f"{kind}_{n}", 1.0) for n, v in noise.items()}

    return dataclasses.replace(
        spec,
        process_noise=wrong(spec.process_noise, "process"),
        measurement_noise=wrong(spec.measurement_noise, "measured"),
    )


@pytest.fixture(scope="module")
def drive():
    return recorded(model_of(CAR), 5, duration=20.0, speed=15.0, amplitude=0.5).assign_attrs(name="drive")


@pytest.fixture(scope="module")
def found(drive):
    spec = believed(measured_yaw_rate=20.0, measured_heading=0.1, process_lateral_velocity_rear=6.0)
    return tune_noise(RecordedModel(spec, inputs="held", jobs=1), [drive])


def test_the_true_variances_are_found_and_the_filter_becomes_consistent(found):
    true = model_of(CAR)
    for v in found.variances:
        truth = (true.process_noise if v.kind == "process" else true.measurement_noise)[v.names[0]]
        assert not v.held
        assert v.lower[0] < truth < v.upper[0], v.label
        assert v.lower[0] < v.value[0] < v.upper[0]
    assert found.log_likelihood[1] > found.log_likelihood[0] + 1000
    (before,), (after,) = found.before, found.after
    assert before.inside < 0.9
    assert after.inside == pytest.approx(0.95, abs=0.02)
    assert after.nis == pytest.approx(1.0, abs=0.02)
    assert min(w.ljung_box for w in after.outputs.values()) > 0.01
    assert min(w.ljung_box for w in before.outputs.values()) < 0.01


def test_errors_are_as_large_as_the_number_of_samples_allows(found):
    errors = [v.error for v in found.variances if v.kind == "measurement"]
    floor = np.sqrt(2.0 / found.after[0].samples)
    assert all(floor < e < 2 * floor for e in errors)  # the rest is what process noise takes


def test_what_the_recordings_do_not_show_stays_as_stated(drive):
    spec = believed()
    quiet = dataclasses.replace(spec, process_noise={n: 1e-4 * v for n, v in spec.process_noise.items()})
    exact = recorded(quiet, 3, duration=10.0, speed=15.0, amplitude=0.5)
    stated = dataclasses.replace(spec, process_noise={n: 1e-3 * v for n, v in spec.process_noise.items()})
    answered = tune_noise(RecordedModel(stated, inputs="held", jobs=1), [exact])
    held = [v for v in answered.variances if v.held]
    assert [v.kind for v in held] == ["process"] * 3
    for v in held:
        assert not v.contradicted
        assert v.value[0] == pytest.approx(v.stated[0], rel=1e-12)
        assert answered.spec.process_noise[v.names[0]] == pytest.approx(v.stated[0], rel=1e-12)
    assert "not determined, and left as stated" in answered.answer


def test_a_stated_value_that_the_recordings_contradict_gives_way(drive):
    quiet = dataclasses.replace(believed(), process_noise=dict.fromkeys(believed().process_noise, 1e-16))
    exact = recorded(quiet, 3, duration=10.0, speed=15.0, amplitude=0.5)
    answered = tune_noise(RecordedModel(believed(), inputs="held", jobs=1), [exact])
    held = [v for v in answered.variances if v.held]
    assert any(v.contradicted for v in held)
    for v in held:
        assert v.value[0] <= v.stated[0] * 1.06
    assert answered.after[0].inside == pytest.approx(0.95, abs=0.03)


def test_several_recordings_say_more_than_one(found, drive):
    other = recorded(model_of(CAR), 6, duration=20.0, speed=15.0, amplitude=0.5)
    both = tune_noise(found.model, [drive, other])
    assert len(both.after) == 2
    for one, two in zip(found.variances, both.variances, strict=True):
        assert two.error < 0.85 * one.error


def test_states_of_a_unit_may_share_a_factor(drive):
    spec = believed(process_yaw_rate=5.0, process_heading=5.0, process_lateral_velocity_rear=5.0)
    answered = tune_noise(RecordedModel(spec, inputs="held", jobs=1), [drive], by="unit")
    units = [v for v in answered.variances if v.kind == "process"]
    assert [v.names for v in units] == [("lateral_velocity_rear",), ("yaw_rate",), ("heading",)]
    assert all(v.lower[0] < v.stated[0] / 5 < v.upper[0] for v in units)


def test_the_file_is_a_parameter_file_for_studies_and_estimate(found, drive, tmp_path):
    toml, numbers = write_tuning(tmp_path / "tuned.toml", found)
    spec = resolve_single({**CAR, "parameters": str(toml), "noise": {}}, "test", "belief")
    assert spec.process_noise == pytest.approx(found.spec.process_noise, rel=1e-12)
    assert spec.measurement_noise == pytest.approx(found.spec.measurement_noise, rel=1e-12)
    assert spec.values == found.spec.values
    assert "95 % interval" in toml.read_text()
    stored = json.loads(numbers.read_text())
    assert len(stored["variances"]) == 6
    assert stored["recordings"][0]["after"]["nis_inside_95"] == found.after[0].inside
    run = RecordedEstimator(RecordedModel(spec, inputs="held", jobs=1), "ekf").run(drive)
    assert summary(run).nis_inside == pytest.approx(found.after[0].inside, abs=1e-9)


def test_the_report_shows_every_variance(found):
    blocks = made(report(found, "harness tune").sections)
    sheet = next(b for b in blocks if isinstance(b, Sheet))
    assert len(sheet.rows) == 6
    assert {row[6] for row in sheet.rows} == {"found"}


def test_measurement_noise_of_zero_is_refused(drive):
    spec = believed(measured_heading=0.0)
    with pytest.raises(UserError, match="measurement noise of heading is stated as zero"):
        tune_noise(RecordedModel(spec, inputs="held", jobs=1), [drive])


@pytest.mark.proof
def test_the_intervals_hold_the_true_variances():
    """A short form of ``make tuning-proof``, which counts more than 400 variances."""
    found, _ = coverage(CASES[:5], 5, first=50_000)
    assert len(found) > 90
    assert np.mean([f.inside for f in found]) > 0.89  # three deviations below 95 %
