"""Tracing: one filter for all hypotheses, what the score test promises, and what a trace finds and refuses."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.config import resolve_single
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, coordinates, hypotheses
from harness.diagnosis.result.claims import verdict_of
from harness.diagnosis.run import refuse_recordings
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.score_test import SPACING, ScoreTest, best_amplitudes, cosine
from harness.identification.candidates import Candidates
from harness.identification.innovations import Innovations
from harness.recordings import load_recording
from harness.recordings.check.examine import recording_warnings
from harness.recordings.read.write import write_recording
from harness.study.results import read
from support.driven_car import CAR, FREE, SIGNALS, driven

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def gusty(augmented):
    """Two drives with a gust of 400 N at different times, with a fit that does not know of it."""
    times = ((20.0, 31.0), (35.0, 44.0))
    drives = [
        augmented.drive(
            driven(i, ["crosswind"], crosswind_force=400.0, crosswind_onset=a, crosswind_end=b), f"drive {i}"
        )
        for i, (a, b) in enumerate(times)
    ]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    return fitting, fitting.fit(coordinates(augmented, FREE, (), 2), fitting.first(), 10)


def test_at_the_neutral_values_it_is_the_extended_kalman_filter_of_the_nominal_model():
    """With Euler steps in both, and held inputs, the filter around the augmented model is the filter itself."""
    spec = resolve_single(CAR, "test")
    augmented, alone = AugmentedModel(spec, SIGNALS, jobs=1), Innovations(spec, jobs=1)
    recording = driven(3, duration=25.0)
    drive = augmented.drive(recording, "drive")
    drive = dataclasses.replace(drive, between=drive.inputs)
    own = dataclasses.replace(alone.drive(recording, "drive"), first_variance=drive.first_variance[: alone.nx])
    found = augmented.log_likelihoods(
        [drive], dataclasses.replace(Candidates.of(spec), values=augmented.stated()[:, None])
    )[0]
    assert found == pytest.approx(alone.log_likelihoods([own], Candidates.of(spec))[0], rel=1e-7)
    assert np.isfinite(found)


def test_a_fit_without_anything_missing_finds_the_stiffness_and_no_score(augmented):
    drives = [augmented.drive(driven(i + 10, stiffness_peak_front=2.7e5), f"drive {i}") for i in range(2)]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    fitted = fitting.fit(coordinates(augmented, FREE, (), 2), fitting.first(), 10)
    assert fitted.point.values[augmented.row("stiffness_peak_front"), 0] == pytest.approx(2.7e5, rel=0.01)
    tried = hypotheses(augmented, FREE)
    scores = ScoreTest(fitting, fitted).of([h for h in tried if not h.change_times])
    worst = max(scores, key=lambda s: s.gain - 0.5 * s.freedom * np.log(fitting.samples))
    assert 2 * worst.gain - worst.freedom * np.log(fitting.samples) < 20, worst.hypothesis.name


def test_the_score_promises_what_a_refit_gains(augmented):
    drives = [augmented.drive(driven(20, ["steering_offset"], steering_offset=2e-4), "drive")]
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    fitted = fitting.fit(coordinates(augmented, FREE, (), 1), fitting.first(), 10)
    offset = next(h for h in hypotheses(augmented, FREE) if h.name == "steering_offset")
    score = ScoreTest(fitting, fitted).of([offset])[0]
    refitted = fitting.only(coordinates(augmented, FREE, (offset,), 1), fitted.point, 10)
    gained = refitted.log_likelihood - fitted.log_likelihood
    assert score.gain > 20
    assert gained == pytest.approx(score.gain, rel=0.1)
    found = refitted.point.values[augmented.row("steering_offset"), 0]
    assert found == pytest.approx(score.amplitudes[0], abs=score.error[0])
    assert abs(score.amplitudes[0] - 2e-4) < 4 * score.error[0]


def test_the_noise_of_a_fit_does_not_depend_on_where_it_started(augmented, gusty):
    """Process noise fifty times too large hides what is missing; a search along the axes alone ended there."""
    fitting, fitted = gusty
    point = dataclasses.replace(fitted.point, process=fitted.point.process + np.log(50.0))
    assert fitting.log_likelihood(point) < fitted.log_likelihood - 100
    again = fitting.fit(fitted.coordinates, point, 10)
    assert again.objective == pytest.approx(fitted.objective, abs=1.0)
    assert again.point.measurement == pytest.approx(fitted.point.measurement, abs=0.02)


def test_a_fit_is_given_up_where_what_it_promises_does_not_count(gusty):
    """From noise fifty times too large thousands are to be gained; what is out of reach is not sought."""
    fitting, fitted = gusty
    point = dataclasses.replace(fitted.point, measurement=fitted.point.measurement - np.log(50.0))
    reached = fitting.fit(fitted.coordinates, point, 10, afresh=False, least=fitted.objective - 1.0)
    assert reached.objective == pytest.approx(fitted.objective, abs=2.0)
    given_up = fitting.fit(fitted.coordinates, point, 10, afresh=False, least=fitted.objective + 1e9)
    assert given_up.objective < fitted.objective - 1000
    assert np.array_equal(given_up.point.measurement, point.measurement)


def test_a_fault_of_one_sensor_knows_its_signal(augmented):
    columns = {h.name: h.output for h in hypotheses(augmented, FREE)}
    outputs = list(augmented.model.outputs)
    for fault, signal in (("sensor_gain@yaw_rate", "yaw_rate"), ("accelerometer_roll", "lateral_acceleration")):
        assert outputs[columns[fault]] == signal
    lever_arms = [outputs[c] for name, c in columns.items() if name.startswith("sensor_lever_arm")]
    assert set(lever_arms) <= {"lateral_acceleration", "lateral_velocity"}
    assert columns["steering_lag"] is columns["mass"] is None


def test_many_parameters_that_nobody_would_state_so_wrongly_are_not_believed(augmented):
    """Each moves within three deviations of its prior, a factor of 1.8; one fitted alone is free of that.

    They stay where nothing else explains as much, for what comes after them would else be taken for an effect.
    """
    many = next(h for h in hypotheses(augmented, FREE) if h.name == ALL_PARAMETERS)

    def fit(hypothesis, **factors):
        values = augmented.stated()[:, None]
        for name, factor in factors.items():
            values[augmented.row(name)] *= factor
        return FittedHypothesis(
            coordinates(augmented, FREE, (hypothesis,), 1), ParameterPoint(values, np.zeros(0), np.zeros(0)), 0.0, 0.0
        )

    assert not beyond_belief(fit(many, mass=1.75, yaw_inertia=0.57), (many,))
    wrong = {"mass": 1.1, "yaw_inertia": 0.5, "cog_to_front_axle": 2.5}
    assert beyond_belief(fit(many, **wrong), (many,)) == "CoG to front axle 2.5, yaw inertia 0.5"
    mass = next(h for h in hypotheses(augmented, FREE) if h.name == "mass")
    assert not beyond_belief(fit(mass, mass=2.5), (mass,))
    both = FittedHypothesis(coordinates(augmented, FREE, (many, mass), 1), fit(mass, mass=2.5).point, 0.0, 0.0)
    assert beyond_belief(both, (many, mass)) == "mass 2.5"  # beside many it is one of them

    def verdict(**factors):
        after, last = SimpleNamespace(normalised_excess_mse=0.01), SimpleNamespace(added=None, candidates=())
        trace = SimpleNamespace(
            discrepancy=(),
            effects=(),
            rounds=(last,),
            after=after,
            final=fit(many, **factors),
            cut_short="",
            added=(many,),
        )
        return verdict_of(trace, SimpleNamespace(unmodelled=None, random_process=None), coloured=False)

    assert [verdict(mass=1.1), verdict(**wrong)] == ["adequate", "unresolved"]


def test_a_change_is_found_at_its_own_time_in_every_drive(augmented, gusty):
    fitting, fitted = gusty
    test = ScoreTest(fitting, fitted)
    gust = next(h for h in hypotheses(augmented, FREE) if h.name == "crosswind")
    score = test.of([gust])[0]
    assert np.abs(score.change_times - [[20.0, 31.0], [35.0, 44.0]]).max() <= 2.0
    assert score.gain > 100


@pytest.mark.parametrize("moment", [3, 14])
def test_the_response_to_a_change_is_that_of_the_whole_model(augmented, gusty, moment):
    """Onsets are led through the linearised innovations; here through the filter's mean with derivatives."""
    fitting, fitted = gusty
    test = ScoreTest(fitting, fitted)
    gust = next(h for h in hypotheses(augmented, FREE) if h.name == "crosswind")
    values = fitted.point.values[:, [1]].copy()
    values[[augmented.row(n) for n in gust.change_times], 0] = SPACING * (moment + 1), 1e5
    for amplitude in gust.amplitudes:
        direction = np.zeros_like(values)
        direction[augmented.row(amplitude)] = 1.0
        exact = augmented.sensitivities(fitting.drives[1], values, direction, test.kept[1]).reshape(-1)
        found = test._steps(gust, amplitude, 1)[:, moment]
        assert np.linalg.norm(exact) > 0
        assert np.linalg.norm(found - exact) < 5e-3 * np.linalg.norm(exact), amplitude


def test_an_effect_without_slope_is_told_from_one_that_is_there(augmented, gusty):
    """The speed is prescribed, so a grade shows nowhere: the gate of excitation says so."""
    scores = ScoreTest(*gusty).of([h for h in hypotheses(augmented, FREE) if h.name in ("road_grade", "road_bank")])
    excited = {s.hypothesis.name: s.excited for s in scores}
    assert excited == {"road_grade": False, "road_bank": True}


def test_an_effect_that_is_a_parameter_in_other_words_has_its_response(augmented, gusty):
    scores = ScoreTest(*gusty).of([h for h in hypotheses(augmented, FREE) if h.name == "steering_ratio"])
    assert [s.hypothesis.kind for s in scores] == ["parameter", "effect"]
    assert cosine(*scores) == pytest.approx(1.0, abs=1e-4)


def test_amplitudes_stay_within_their_bounds():
    G = np.array([[4.0, 1.0], [1.0, 9.0]])
    b = np.array([-2.0, 3.0])
    seen = np.ones(2, dtype=bool)
    free, gain = best_amplitudes(b, G, seen, np.full(2, -10.0), np.full(2, 10.0))
    assert free == pytest.approx(np.linalg.solve(G, b))
    assert gain == pytest.approx(0.5 * b @ np.linalg.solve(G, b))
    bounded, less = best_amplitudes(b, G, seen, np.zeros(2), np.full(2, 10.0))
    assert bounded == pytest.approx([0.0, 3.0 / 9.0])
    assert less < gain
    assert best_amplitudes(b, G, ~seen, np.zeros(2), np.ones(2)) == (pytest.approx([0.0, 0.0]), 0.0)


def traced(tmp_path, drives, *more):
    """Run the command on drives, the last one held out; return its result and folder."""
    paths = []
    for i, recording in enumerate(drives):
        paths.append(tmp_path / f"drive_{i}.csv")
        write_recording(recording, paths[-1])
    train = [word for path in paths[:-1] for word in ("--train", str(path))]
    arguments = ["trace", "--model", "car", "--parameters", "blanco_2021", "--tyre", "linear", *train]
    return CliRunner().invoke(app, [*arguments, "--test", str(paths[-1]), "--out", str(tmp_path / "out"), *more])


STUDY = """
name = "load"
title = "How much does a load matter?"
seed = 3
targets = ["yaw_rate", "lateral_velocity"]
drive = [{ name = "weave", kind = "sine", duration = "20 s", speed = "20 m/s", amplitude = "0.8 deg" }]
plant = { vehicle = "car", parameters = "blanco_2021", tyre = "linear", sensors = "car_navigation" }
estimator = [{ name = "EKF", kind = "ekf" }]
design = [{ name = "load", factor = [{ parameter = "mass", shift = ["0 %", "10 %"] }] }]
"""


@pytest.mark.proof
def test_a_trace_finds_what_nobody_told_it_of(tmp_path):
    drives = [driven(i + 30, ["steering_lag"], steering_lag=0.08) for i in range(2)]
    (tmp_path / "load.toml").write_text(STUDY)
    result = traced(tmp_path, drives, "--estimator", "ekf", "--study", str(tmp_path / "load.toml"))
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "out" / "trace.json").read_text())
    assert found["verdict"] == "amended"
    assert [a["effect"] for a in found["added"]] == ["steering_lag"]
    lag = found["added"][0]["parameters"]["steering_lag"]
    assert lag["value"] == pytest.approx(0.08, rel=0.05)
    assert 0 < lag["std"] < 0.01
    assert found["excess"]["after"] < 0.1 * found["excess"]["before"]
    for error in found["error"].values():
        assert error["after"] <= 1.01 * error["before"]
    for error in found["estimators"]["ekf"].values():
        assert error["after"] < 1.01 * error["before"]
    assert found["estimators"]["ekf"]["yaw_rate"]["after"] < 0.8 * found["estimators"]["ekf"]["yaw_rate"]["before"]
    assert (tmp_path / "out" / "report.pdf").stat().st_size > 10_000
    again, nominal = (
        resolve_single({**CAR, "parameters": str(tmp_path / "out" / f"{name}.toml")}, "test")
        for name in ("amended", "nominal")
    )
    assert again.values["steering_lag"] == lag["value"]
    assert (again.effects, nominal.effects) == (("steering_lag",), ())
    gained = found["worth"]["estimators"]["EKF"]["yaw_rate"]
    assert gained["ratio_interval_95"][1] < 0.9
    assert gained["after"] < gained["before"]
    runs = [read(tmp_path / "out" / "worth" / name) for name in ("nominal", "amended")]
    masses = [r.designs[0].factors[0].values.tolist() for r in runs]
    assert masses[0] == masses[1]
    assert runs[0].designs[0].planned == 8


def test_a_study_of_another_vehicle_is_refused_before_anything_is_compiled(tmp_path):
    drives = [driven(i, duration=25.0) for i in (47, 48)]
    result = traced(tmp_path, drives, "--study", str(ROOT / "studies" / "mass.toml"))
    assert result.exit_code == 2
    assert "plant.vehicle is 'semitrailer', that of the traced model 'car'" in " ".join(result.output.split())


def test_a_drive_that_is_too_calm_says_what_to_drive(tmp_path):
    calm = [driven(i, duration=25.0) for i in (49, 50)]
    calm[1] = calm[1].assign(yaw_rate=0.02 * calm[1]["yaw_rate"])
    result = traced(tmp_path, calm)
    assert result.exit_code == 2
    assert "drive_1.csv: for 95 % of the time the lateral acceleration" in " ".join(result.output.split())
    assert "too little excitation to identify what is missing; drive quick steering" in " ".join(result.output.split())


def test_a_drive_of_20_s_of_which_samples_were_lost_is_traced_and_a_shorter_one_is_not():
    recording, spec = driven(49, duration=25.0).assign_attrs(file="drive.csv"), resolve_single(CAR, "test")
    refuse_recordings([recording.isel(time=slice(0, 1997))], spec)
    with pytest.raises(UserError, match=r"drive.csv: lasts 19.9 s, too short"):
        refuse_recordings([recording.isel(time=slice(0, 1990))], spec)


def test_a_wrong_sign_and_spikes_are_reported_with_the_evidence(tmp_path):
    recording = driven(51, duration=25.0)
    rate = -recording["yaw_rate"].to_numpy()
    rate[[300, 900]] += 1.0
    names = {n: recording[n].to_numpy() for n in ("time", *SIGNALS)}
    table = pd.DataFrame({**names, "yaw_rate": rate})
    table.to_csv(tmp_path / "drive.csv", index=False)
    notes = recording_warnings([load_recording(tmp_path / "drive.csv")])
    assert any("yaw_rate: wrong sign" in n and "opposite sign" in n for n in notes), notes
    assert any("yaw_rate: single-sample spikes: 2 (t = 3.00, 9.00 s)" in n for n in notes), notes
    names["yaw_rate"] = recording["yaw_rate"].to_numpy()
    pd.DataFrame(names).to_csv(tmp_path / "right.csv", index=False)
    assert not recording_warnings([load_recording(tmp_path / "right.csv")])


def test_the_same_drive_under_another_name_is_refused(tmp_path):
    recording = driven(40, duration=25.0)
    result = traced(tmp_path, [recording, recording])
    assert result.exit_code == 2
    assert "drive_1.csv is fitted as well" in result.output


def test_a_recording_that_is_too_short_says_what_to_drive(tmp_path):
    result = traced(tmp_path, [driven(41, duration=15.0), driven(42, duration=15.0)])
    assert result.exit_code == 2
    assert "lane changes" in " ".join(result.output.split())


def test_missing_signals_are_named(tmp_path):
    measured = ["yaw_rate", "lateral_acceleration", "lateral_velocity"]
    result = traced(tmp_path, [driven(i, duration=25.0).drop_vars(measured) for i in (43, 44)])
    assert result.exit_code == 2
    assert f"hold nothing that sensors of 'car' measure: {', '.join(measured)}" in " ".join(result.output.split())


def test_a_parameter_that_the_model_does_not_have_is_refused_before_anything_is_compiled(tmp_path):
    result = traced(tmp_path, [driven(i, duration=25.0) for i in (45, 46)], "--free", "stiffness_peek_front")
    assert result.exit_code == 2
    assert "closest: stiffness_peak_front" in " ".join(result.output.split())
