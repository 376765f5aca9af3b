"""A run computed again has the bits of the store, and as a study of its own it has them too."""

import io
import shutil
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

import harness as h
from harness.common.errors import UserError
from harness.config import build_study, load_study
from harness.config.alone import Change
from harness.study.design import points
from harness.study.evaluate import StudyEvaluator
from harness.study.layout import root_attributes
from harness.study.replay import Place, Replayer
from harness.study.replayed import table
from harness.study.run import run_study
from harness.study.store import Store
from harness.study.stored import attributes_of, compare, stored_scores, study_of
from support.probe_study import STUDY

CAR = {
    "name": "car",
    "seed": 11,
    "targets": ["lateral_velocity"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"},
    "drive": [
        {"name": "weave", "kind": "sine", "duration": 6, "amplitude": "20 deg"},
        {"name": "fast", "kind": "sine", "duration": 4, "amplitude": "30 deg", "speed": "30 m/s"},
    ],
    "estimator": [
        {"name": "EKF", "kind": "ekf"},
        {"name": "UKF", "kind": "ukf", "alpha": 0.5},
        {"name": "PF", "kind": "particle", "particles": 32},
    ],
    "design": [
        {"name": "mass", "repeats": 3, "factor": [{"parameter": "mass", "levels": ["1.5 t", "1.9 t"]}]},
        {
            "name": "all",
            "sampling": "saltelli",
            "samples": 2,
            "factor": [
                {"parameter": "mass", "range": ["1.4 t", "1.9 t"]},
                {"parameter": "friction", "range": [0.6, 1.1], "of": "both"},
                {"parameter": "process_noise_scale", "range": [0.1, 10], "scale": "log"},
            ],
        },
    ],
}


def quiet():
    return Console(file=io.StringIO())


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    """Finished studies by name: of several estimators, with noisy inputs and unknown parameters, of a semitrailer."""
    folder = tmp_path_factory.mktemp("stores")
    uncertain = {"unknown_parameters": ["mass"]}
    noisy = CAR["plant"] | {"noise": {"input": {"steering_wheel_angle": "0.01 deg^2"}}}
    few = {"estimator": CAR["estimator"][:1], "design": CAR["design"][:1]}
    (folder / "probe.toml").write_text(STUDY)
    studies = {
        "car": build_study(CAR),
        "noisy": build_study({**CAR, **few, "name": "noisy", "plant": noisy, "belief": uncertain}),
        "probe": load_study(folder / "probe.toml"),
    }
    for name, study in studies.items():
        run_study(study, folder / name, jobs=1, console=quiet())
    return folder, studies


@pytest.fixture(scope="module")
def replayers(stores):
    return {name: Replayer(study) for name, study in stores[1].items()}


RUNS = [
    ("car", Place(0, 1, 1, 0, 2)),
    ("car", Place(0, 0, 0, 0, 0)),
    ("car", Place(1, 0, 1, 7, 0)),
    ("noisy", Place(0, 1, 0, 0, 1)),
    ("probe", Place(0, 0, 1, 0, 4)),
    ("probe", Place(1, 0, 0, 3, 0)),
]


def compared(stores, replayers, name, place, **further):
    folder, studies = stores
    run = replayers[name].run(place, **further)
    now = root_attributes(studies[name])
    stored = stored_scores(folder / name, studies[name], run)
    return run, compare(run, stored, attributes_of(folder / name), now, studies[name])


@pytest.mark.parametrize(("name", "place"), RUNS)
@pytest.mark.parametrize("innovations", [True, False])
def test_the_scores_are_those_of_the_store_to_the_last_bit(stores, replayers, name, place, innovations):
    run, found = compared(stores, replayers, name, place, innovations=innovations)
    assert found.same, found.words
    assert found.words == "The scores are those of the store, to the last bit."
    assert ("nis" in run.data) == innovations


@pytest.mark.parametrize(("name", "place"), RUNS)
def test_as_a_study_of_its_own_it_has_the_same_scores(stores, replayers, name, place, tmp_path):
    alone = replayers[name].alone(place)
    (tmp_path / "alone.toml").write_text(alone.text, encoding="utf-8")
    again = load_study(tmp_path / "alone.toml")
    assert again.hash == alone.hash
    run_study(again, tmp_path / "out", jobs=1, console=quiet())
    wanted = replayers[name].run(place)
    own = stored_scores(tmp_path / "out", again, replace(wanted, place=Place(0, 0, 0)))
    for score, values in wanted.scores.items():
        np.testing.assert_array_equal(own[score], values, err_msg=score)


def test_a_run_of_a_run_is_that_run(replayers):
    first = replayers["car"].alone(Place(0, 1, 1, 0, 2))
    again = Replayer(first).alone(Place(0, 0, 0))
    assert again.count_from == first.count_from
    assert (again.count_from.drive, again.count_from.sample, again.count_from.repeat) == (1, 0, 2)


def test_one_of_several_estimators_has_the_same_scores(stores, replayers):
    run, found = compared(stores, replayers, "car", Place(0, 1, 0, 0, 1), estimators=[2, 0])
    assert found.same
    assert list(run.data["estimator"].values) == ["PF", "EKF"]


def test_what_is_kept_over_time_is_what_was_scored(replayers):
    run = replayers["car"].run(Place(0, 1, 0, 0, 1))
    data = run.data
    error = (data.estimate - data.truth).sel(target="lateral_velocity")[1:]
    np.testing.assert_allclose(np.sqrt((error**2).mean("time")), run.scores["rmse"][:, 0], rtol=1e-12)
    np.testing.assert_allclose(data.nis[1:].mean("time")[:2], run.scores["nis"][:2], rtol=1e-12)
    np.testing.assert_allclose(data.nees[10::10].mean("time")[:2], run.scores["nees"][:2], rtol=1e-6)
    held = data.estimate.sel(target="yaw_rate", estimator="EKF")
    gap = data.measured_yaw_rate - held
    assert float(np.abs(gap).max()) < 10 * float(np.sqrt(data.measured_yaw_rate.attrs["variance"]))
    rows = table(data)
    assert len(rows) == data.sizes["time"]
    assert {"truth_lateral_velocity", "UKF estimate_yaw_rate", "EKF innovation_yaw_rate", "input_speed"} <= set(rows)


def test_what_if_is_a_run_with_that_value(stores, replayers, tmp_path):
    place, change = Place(0, 0, 0, 0, 1), [Change("mass", "1.9 t")]
    changed = replayers["car"].run(place, changes=change)
    heavy = replayers["car"].run(replace(place, band=1))  # levels share their noise
    for score, values in heavy.scores.items():
        np.testing.assert_array_equal(changed.scores[score], values, err_msg=score)
    assert changed.plant["mass"] == 1900.0
    other = replayers["car"].run(place, changes=[Change("mass", "1.9 t", "belief"), Change("process_noise_scale", 2.0)])
    assert not np.array_equal(other.scores["rmse"], changed.scores["rmse"])
    run_study(other.study, tmp_path / "out", jobs=1, console=quiet())
    own = stored_scores(tmp_path / "out", other.study, replace(other, place=Place(0, 0, 0)))
    np.testing.assert_array_equal(own["rmse"], other.scores["rmse"])


def test_of_both_gives_way_where_one_changes(replayers):
    place = Place(1, 0, 0, 4, 0)
    alone = replayers["car"].alone(place, [Change("friction", 0.5)])
    value = points(replayers["car"].study, replayers["car"].study.designs[1]).values[0, 4, 1]
    held = {(f.parameter, f.of): f.lower[0] for f in alone.designs[0].factors}
    assert held["friction", "plant"] == 0.5
    assert held["friction", "belief"] == value
    assert ("friction", "both") not in held


@pytest.mark.parametrize("change", [Change("mass", "-3 t"), Change("mas", 1500.0), Change("mass", "3 s")])
def test_what_is_not_possible_is_refused_in_words(replayers, change):
    with pytest.raises(UserError, match=r"design\[0\]\.factor"):
        replayers["car"].run(Place(0, 0, 0), changes=[change])


def test_another_result_is_told(stores, replayers):
    folder, studies = stores
    run = replayers["car"].run(Place(0, 0, 0))
    attributes, now = attributes_of(folder / "car"), root_attributes(studies["car"])
    stored = stored_scores(folder / "car", studies["car"], run)
    near = {**stored, "rmse": stored["rmse"] * (1 + 1e-9)}
    found = compare(run, near, {**attributes, "machine": "another"}, now, studies["car"])
    assert not found.same
    assert "within the tolerance of 1e-06" in found.words
    assert "was computed on another" in found.words
    far = compare(run, {**stored, "bias": stored["bias"] * 1.5}, attributes, now, studies["car"])
    assert "this is not the stored run" in far.words
    assert "let harness verify look at it" in far.words


def test_the_study_of_a_store_is_found_or_it_is_said_what_differs(stores, tmp_path, monkeypatch):
    folder, studies = stores
    monkeypatch.chdir(tmp_path)
    assert study_of(folder / "noisy").hash == studies["noisy"].hash
    with pytest.raises(UserError, match="no result of a study here"):
        study_of(tmp_path)
    monkeypatch.setattr("harness.study.stored.attributes_of", lambda f: {**attributes_of(f), "study_hash": "0"})
    with pytest.raises(UserError, match="no run can be computed again"):
        study_of(folder / "noisy")


def test_a_recording_is_found_near_the_result_or_named(tmp_path, monkeypatch):
    lap = tmp_path / "lab" / "studies" / "lap.csv"
    lap.parent.mkdir(parents=True)
    rows = "".join(f"{0.01 * i:.2f},{0.1 * np.sin(0.02 * i):.6f},15\n" for i in range(500))
    lap.write_text(f"time,steering_wheel_angle,speed\n{rows}")
    study = build_study({**CAR, "drive": [{"name": "lap", "kind": "from_file", "file": "lap.csv"},
                                          *CAR["drive"]]}, lap.parent / "study.toml")  # fmt: skip
    out = tmp_path / "lab" / "results" / "car"
    Store(study, lambda: StudyEvaluator(study), out)
    monkeypatch.chdir(tmp_path)
    assert study_of(out).hash == study.hash
    lap.write_text(lap.read_text().replace(",15\n", ",16\n", 1))
    with pytest.raises(UserError, match=r"no run can be computed again: it needs lap\.csv as it was"):
        study_of(out)
    moved = lap.parent / "moved"
    moved.mkdir()
    lap.rename(moved / "lap.csv")
    (moved / "lap.csv").write_text((moved / "lap.csv").read_text().replace(",16\n", ",15\n", 1))
    assert study_of(out, beside=moved).hash == study.hash


def test_a_store_of_before_has_its_study_from_the_text_as_written(stores, tmp_path, monkeypatch):
    def before(folder):
        return {k: v for k, v in attributes_of(folder).items() if k != "self_contained_study"}

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.study.stored.attributes_of", before)
    again = study_of(stores[0] / "car")
    assert again.hash == stores[1]["car"].hash
    assert again.plant.parameters == "govindarajan_2018"


def test_in_python(stores, tmp_path):
    results = h.open_results(stores[0] / "car")
    found = results.replay("mass", band="1.9 t", drive="fast", repeat=2, estimators=["UKF"])
    assert found.is_same
    assert isinstance(found.data, xr.Dataset)
    stored = results["mass"].rmse.sel(band_label="1.9 t", drive="fast", estimator="UKF").isel(repeat=2, sample=0)
    assert found.scores.rmse[0] == float(stored.squeeze())
    files = {p.name for p in found.write(tmp_path)}
    assert files == {"study.toml", "run.csv"}
    assert h.read_study(tmp_path / "study.toml").runs == 3
    changed = results.replay("mass", plant={"mass": "1.7 t"})
    assert changed.is_same is None
    assert changed.answer == "This run is in no store: mass of the plant 1.7 t."
    with pytest.raises(UserError, match="no drive 'fats'; closest: fast"):
        results.replay("mass", drive="fats")
    with pytest.raises(UserError, match="no repeat 3; there are 3"):
        results.replay("mass", repeat=3)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"band": True}, "there is no band True"),
        ({"estimators": []}, "name at least one estimator; there are: EKF, UKF, PF"),
        ({"plant": "mass = 3"}, "plant: expected a dictionary"),
        ({"plant": {"mass": np.nan}}, "mass of the plant cannot be nan: expected a finite number"),
        ({"belief": {"mass": None}}, "mass of the belief cannot be None: expected a number in SI units or text"),
    ],
)
def test_in_python_what_makes_no_sense_is_refused_in_words(stores, asked, said):
    with pytest.raises(UserError, match=said):
        h.open_results(stores[0] / "car").replay("mass", **asked)


def test_scores_that_are_deleted_meanwhile_are_missed_in_words(stores, tmp_path):
    results = h.open_results(shutil.copytree(stores[0] / "car", tmp_path / "car"))
    shutil.rmtree(tmp_path / "car" / "scores.zarr" / "mass" / "rmse")
    with pytest.raises(UserError, match=r"its scores cannot be read .* 'harness verify' says what is damaged"):
        results.replay("mass")


@pytest.mark.filterwarnings("error")
def test_a_covariance_near_the_largest_numbers_has_no_infinite_nees(stores):
    results = h.open_results(stores[0] / "car")
    found = results.replay("mass", belief={"process_noise_scale": 1e150}, estimators="EKF")
    assert not np.isinf(found.data.nees).any()
    with pytest.raises(UserError, match="too large to be squared"):
        results.replay("mass", belief={"process_noise_scale": 1e300}, estimators="EKF")
