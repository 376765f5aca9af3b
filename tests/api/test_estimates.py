"""Estimators compared on recordings in Python: the same as one at a time, told apart by their names."""

import numpy as np
import pytest

import harness as h


@pytest.fixture(scope="module")
def car():
    return h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series")


@pytest.fixture(scope="module")
def runs(car):
    drive = h.drive("sine", duration="6 s", amplitude="15 deg")
    return [h.simulate(car, drive, seed=seed) for seed in (1, 2)]


@pytest.fixture(scope="module")
def found(car, runs):
    return h.estimate(
        car, runs, {"EKF": "ekf", "wide": h.Estimator("ukf", alpha=1.0)}, signals=["slip_angle_axle_rear"]
    )


def test_every_estimator_runs_on_every_recording_as_it_does_alone(car, runs, found):
    assert list(found.runs) == [(r, e) for r in ("sine (1)", "sine (2)") for e in ("EKF", "wide")]
    alone = h.Estimator("ukf", alpha=1.0).run(car, runs[1])
    np.testing.assert_allclose(found.runs["sine (2)", "wide"].lateral_velocity, alone.lateral_velocity, rtol=1e-9)
    assert "slip_angle_axle_rear_std" in found.runs["sine (1)", "EKF"]


def test_tables_say_what_the_runs_say(found):
    run = found.runs["sine (1)", "EKF"]
    row = found.errors.loc[("sine (1)", "EKF", "lateral_velocity")]
    error = run.lateral_velocity - run.reference_lateral_velocity
    assert row.rmse == pytest.approx(float(np.sqrt((error**2).mean())))
    assert (row.unit, len(found.summary)) == ("m/s", 4)
    assert found.summary.nis_inside.between(0.85, 1.0).all()
    assert "lateral velocity" in found.answer
    assert "all samples of the recording" in found.notes[-1]
    assert "EKF" in repr(found)
    assert "rmse" in found._repr_html_()


def test_the_report_is_that_of_the_command(found, tmp_path):
    written = found.report(tmp_path, form="nc")
    assert {p.name for p in written} >= {"report.html", "report.pdf", "estimate.json", "sine_1-EKF.nc"}
    assert "in Python" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("estimators", "said"),
    [
        (["ekf", "ekf"], "EKF is asked for twice"),
        ([], "give at least one"),
        (["ekff"], "closest: ekf"),
    ],
)
def test_what_cannot_be_is_said(car, runs, estimators, said):
    with pytest.raises((h.UserError, h.ModelError), match=said):
        h.estimate(car, runs, estimators)


def test_measured_inputs_are_smoothed_or_known_from_the_past(car):
    """A logged drive: smoothed inputs see the future, filtered ones and the samples themselves do not."""
    whole = h.simulate(car, h.drive("winding_road", duration="30 s", speed="20 m/s"), seed=3)
    rng, logged = np.random.default_rng(4), whole.to_dataframe()
    logged["speed"] += 0.3 * rng.normal(size=len(logged))
    logged["steering_wheel_angle"] += np.radians(0.4) * rng.normal(size=len(logged))
    recording = h.read_recording(logged.drop(columns=[c for c in logged if c.startswith("true_")]))
    recording["true_lateral_velocity"] = whole["true_lateral_velocity"]
    ways = {n: h.Estimator("ekf", input_signal=n) for n in ("filtered", "measured")} | {"smoothed": h.Estimator("ekf")}
    found = h.estimate(car, recording, ways)
    errors = found.errors.xs("lateral_velocity", level="signal").droplevel("recording")
    assert errors.rmse["smoothed"] < errors.rmse["filtered"]
    assert errors.nees.between(0.5, 2.0).all()
    assert found.summary.nis.between(0.9, 1.1).all()
    assert "smoothed: Recorded inputs and their rates are those given all samples" in found.notes[-1]
    assert "measured: Recorded inputs are taken as measured" in found.notes[-1]
    later = recording.copy(deep=True)
    later["speed"][2000:] += 1.0
    one, two = (h.Estimator("ekf", input_signal="measured").run(car, r) for r in (recording, later))
    before, behind = slice(None, 2000), slice(2000, None)
    moved = np.abs(one.lateral_velocity - two.lateral_velocity)
    assert moved[before].max() < 0.01 * moved[behind].max()  # by the noise of the whole recording alone
