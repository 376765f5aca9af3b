"""An identification gone on from with planned drives: joined with its recordings, its errors against the plan's."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.config import resolve_single
from harness.identification.common_step import at_common_step
from harness.identification.contract import Estimate
from harness.identification.earlier_result import EarlierResult, record_of_recordings
from harness.identification.expectation import in_words, reached_errors, reached_rmse, record_of_errors, verdict_of
from harness.recordings import load_recording
from harness.recordings.read.write import write_recording
from support.identification import CAR, model_of, recorded

FREE = "stiffness_over_load_front,mass_over_inertia"
LINE = ["identify", "--model", "car_reference_point", "--parameters", "sun_2015", "--sensors", "car_reference"]
QUICK = ["--setting", "profiles=false", "--setting", "annealings=0"]


def plan_of(**errors):
    """Return a plan that expects standard errors, by name: value, before and after."""
    return {
        "expected": {
            "parameters": {
                name: {"unit": "1/rad", "value": value, "standard_error": {"before": before, "after": after}}
                for name, (value, before, after) in errors.items()
            }
        }
    }


def run(*words):
    return CliRunner().invoke(app, list(map(str, words)))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return a folder with two recordings and a fit to the first one behind which a drive was planned."""
    folder = tmp_path_factory.mktemp("results")
    for seed, name in ((1, "first"), (2, "second")):
        write_recording(recorded(model_of(CAR), seed, duration=6.0, speed=15.0, amplitude=0.5), folder / f"{name}.csv")
    done = run(*LINE, *QUICK, "--train", folder / "first.csv", "--free", FREE, "--out", folder / "fit")
    assert done.exit_code == 0, done.output
    estimates = {e["name"]: e for e in json.loads((folder / "fit" / "identify.json").read_text())["estimates"]}
    (folder / "fit" / "next-drive").mkdir()
    errors = {
        n: (estimates[n]["value"], estimates[n]["standard_error"], estimates[n]["standard_error"] / math.sqrt(2.0))
        for n in FREE.split(",")
    }
    plan = {"result": str(folder / "fit"), **plan_of(**errors)}
    (folder / "fit" / "next-drive" / "next_drive.json").write_text(json.dumps(plan))
    return folder


def test_a_fit_goes_on_from_an_earlier_one_with_its_recordings_and_settings(results):
    done = run("identify", "--after", results / "fit", "--train", results / "second.csv")
    assert done.exit_code == 0, done.output
    both = ["--train", results / "first.csv", "--train", results / "second.csv"]
    assert run(*LINE, *QUICK, *both, "--free", FREE, "--out", results / "both").exit_code == 0
    again, joint = (json.loads((results / f / "identify.json").read_text()) for f in ("fit/after", "both"))
    assert again["estimates"] == joint["estimates"]
    assert joint["after"] is None
    assert again["after"]["verdict"] == "as expected"  # a second drive of the same kind: errors over the root of two
    assert again["after"]["words"] in again["answer"]
    assert again["after"]["words"] in " ".join(done.stdout.split())
    plan = json.loads((results / "fit" / "next-drive" / "next_drive.json").read_text())
    sequence = {"sequence": [{"name": "1-sine", "times": 2}]}
    (results / "twice").mkdir()
    (results / "twice" / "next_drive.json").write_text(json.dumps(plan | sequence))
    assert run("identify", "--after", results / "twice", "--train", results / "second.csv").exit_code == 0
    once = json.loads((results / "twice" / "after" / "identify.json").read_text())["after"]
    assert (once["verdict"], "only 1 of 2 planned drives" in once["words"]) == ("not compared", True)
    for entry in again["after"]["standard_errors"]:
        estimate = next(e for e in joint["estimates"] if e["name"] == entry["name"])
        assert entry["reached"] == estimate["standard_error"]
        assert entry["ratio"] == pytest.approx(entry["reached"] / entry["expected"])


MEASURED_FILE = """
title = "A fit that is gone on from"
recordings = "{folder}"
step = "10 ms"
free = ["stiffness_over_load_front", "mass_over_inertia"]
settings = {{ profiles = false, annealings = 0 }}

[model]
vehicle = "car_reference_point"
parameters = "sun_2015"
sensors = "car_reference"

[[train]]
file = "long.csv"
span = ["5 s", "26 s"]

[[test]]
file = "long.csv"
span = ["30 s", "51 s"]
"""


def test_a_fit_of_a_measured_file_is_gone_on_from_with_its_spans(results, tmp_path):
    write_recording(recorded(model_of(CAR), 3, duration=55.0, speed=15.0, amplitude=0.5), tmp_path / "long.csv")
    file = tmp_path / "measured.toml"
    file.write_text(MEASURED_FILE.format(folder=tmp_path), encoding="utf-8")
    done = run("identify", file, "--out", tmp_path / "fit")
    assert done.exit_code == 0, done.output
    shutil.copytree(results / "fit" / "next-drive", tmp_path / "fit" / "next-drive")
    done = run("identify", "--after", tmp_path / "fit", "--train", results / "second.csv")
    assert done.exit_code == 0, done.output
    first, again = (json.loads((tmp_path / f / "identify.json").read_text()) for f in ("fit", "fit/after"))
    assert [d["name"] for d in again["asked"]["train"]] == ["long", "second"]
    for key in ("model", "free", "settings", "test"):
        assert again["asked"][key] == first["asked"][key], key
    file.write_text(file.read_text(encoding="utf-8").replace("26 s", "27 s"), encoding="utf-8")
    with pytest.raises(UserError, match=r"measured.toml: holds something else than in that identification"):
        EarlierResult.read(tmp_path / "fit").recordings("train", [])
    file.unlink()
    with pytest.raises(UserError, match=r"'long' cannot be read again; state it as well, as train"):
        EarlierResult.read(tmp_path / "fit").recordings("train", [])


def test_a_recording_without_the_bank_that_earlier_ones_have_is_refused(results, tmp_path):
    table = load_recording(results / "first.csv").to_dataframe()
    table.assign(bank_angle=0.01).to_csv(tmp_path / "banked.csv")
    content = {"asked": {"train": record_of_recordings([load_recording(tmp_path / "banked.csv")]), "test": []}}
    earlier = replace(EarlierResult.read(results / "fit"), content=content)
    with pytest.raises(UserError, match=r"'second' lacks 'bank_angle', which the drives of"):
        earlier.joined([load_recording(results / "second.csv")], [])


@pytest.mark.parametrize("command", ["identify", "trace"])
@pytest.mark.parametrize("words", [("--set", "mass=1"), ("--tyre", "linear"), ("--effect", "camber")])
def test_an_option_of_a_model_that_is_not_named_is_refused(tmp_path, command, words):
    done = run(command, "--after", tmp_path, "--train", tmp_path / "second.csv", *words)
    assert (done.exit_code, f"without {words[0]};" in done.stderr) == (2, True), done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("words", [("--substeps", "1"), ("--integrator", "rk4")])
def test_an_integration_is_that_of_the_model_even_where_the_usual_one_is_named(tmp_path, words):
    done = run("identify", "--after", tmp_path, "--train", tmp_path / "second.csv", *words)
    assert (done.exit_code, f"without {words[0]};" in done.stderr) == (2, True), done.stderr
    assert done.stderr.count("\n") == 1


def test_settings_that_are_named_take_the_place_of_those_of_their_name(results, tmp_path):
    line = ["identify", "--after", results / "fit", "--train", results / "second.csv", "--out", tmp_path]
    assert run(*line, "--setting", "annealings=1").exit_code == 0
    asked = json.loads((tmp_path / "identify.json").read_text())["asked"]
    assert asked["settings"] == {"profiles": False, "annealings": 1}


def test_what_is_no_plan_behind_a_fit_is_refused(results, tmp_path):
    plan = json.loads((results / "fit" / "next-drive" / "next_drive.json").read_text())
    said = {
        "holds no next-drive/next_drive.json; plan drives first": None,
        "behind no identification whose identify.json is there": {**plan, "result": "elsewhere"},
    }
    for words, content in said.items():
        if content is not None:
            (tmp_path / "next_drive.json").write_text(json.dumps(content))
        done = run("identify", "--after", tmp_path, "--train", results / "second.csv")
        assert (done.exit_code, words in done.stderr) == (2, True), done.stderr
    with pytest.raises(UserError, match=r"identify.json: is no folder; name that of the identification"):
        EarlierResult.read(results / "fit" / "identify.json")
    study = results / "fit" / "posterior"  # where the command that a fit prints puts it
    (study / "next-drive").mkdir(parents=True)
    (study / "next-drive" / "next_drive.json").write_text(json.dumps({**plan, "result": str(study)}))
    with pytest.raises(UserError, match="behind no identification"):
        EarlierResult.read(study)
    (tmp_path / "identify.json").write_text("{}")
    with pytest.raises(UserError, match="an earlier version wrote it"):
        EarlierResult.read(tmp_path)
    (tmp_path / "identify.json").write_text((results / "fit" / "identify.json").read_text())
    assert EarlierResult.read(tmp_path).free == tuple(FREE.split(","))
    (tmp_path / "next_drive.json").write_text(json.dumps({"result": "", "expected": {"errors": [], "fit": None}}))
    with pytest.raises(UserError, match="behind a study whose vehicles are of no fit"):
        EarlierResult.read(tmp_path)
    (tmp_path / "next_drive.json").write_text(json.dumps({"result": "", "expected": {"limits": {}}}))
    with pytest.raises(UserError, match="for something else than standard errors"):
        EarlierResult.read(tmp_path)


def test_a_recording_brought_to_another_step_is_read_again_as_it_was_fitted(results, tmp_path):
    table = load_recording(results / "first.csv", step=0.00998).to_dataframe().round(9)
    table.to_csv(tmp_path / "off.csv")
    first, off = at_common_step([load_recording(results / "first.csv"), load_recording(tmp_path / "off.csv")])
    content = {"asked": {"train": record_of_recordings([first, off]), "test": []}}
    earlier = replace(EarlierResult.read(results / "fit"), content=content)
    assert [a.equals(b) for a, b in zip(earlier.recordings("train", []), (first, off), strict=True)] == [True, True]
    assert earlier.recordings("train", [first, load_recording(tmp_path / "off.csv")]) == []  # whose step is its own
    assert [r.attrs["name"] for r in earlier.recordings("train", [first])] == ["off"]
    (results / "first.csv").rename(tmp_path / "kept.csv")
    load_recording(results / "second.csv").to_dataframe().to_csv(results / "first.csv")
    with pytest.raises(UserError, match=r"first.csv: holds something else than in that identification"):
        earlier.recordings("train", [load_recording(results / "first.csv")])  # not left out because of its name
    (tmp_path / "kept.csv").rename(results / "first.csv")


def test_errors_are_compared_in_proportion_to_positive_parameters():
    spec = resolve_single(CAR, "test")
    front, rear = "stiffness_over_load_front", "stiffness_over_load_rear"
    found = [Estimate(front, "1/rad", 8.0, 16.0, 2.1), Estimate(rear, "1/rad", 8.0, 8.0, math.inf)]
    plan = plan_of(**{front: (8.0, None, 1.0), rear: (8.0, 3.0, 1.0), "mass_over_inertia": (1.0, 1.0, 0.5)})
    reached = reached_errors(plan, found, spec)
    assert [(r.name, r.expected, r.before) for r in reached] == [(front, 2.0, math.inf), (rear, 1.0, 3.0)]
    assert verdict_of(reached[:1]) == "as expected"
    assert verdict_of(reached) == "larger"
    assert verdict_of([replace(reached[0], reached=1.5)]) == "smaller"
    assert verdict_of([replace(reached[0], reached=math.nan)]) == "not stated"
    assert record_of_errors(reached)["standard_errors"][1]["ratio"] is None
    assert "stiffness over load front is 2.10 1/rad (expected 2.00, before ∞)" in in_words(reached[:1])
    assert record_of_errors(()) is None


def test_the_errors_of_estimators_follow_from_the_covariance_that_is_reached():
    """Of ``1 + 8 x^2 + 2 x y`` in standard deviations of now; what is not fitted is as unknown as before."""
    front, rear, other = "stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia"
    plan = plan_of(**{front: (8.0, 2.0, 1.0), rear: (8.0, 4.0, 1.0), other: (1.0, 0.5, 0.5)})
    curvature = [[8.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    rmse = {"before": 4.0, "after": 2.5, "known": 1.0}
    error = {"estimator": "EKF", "target": "yaw_rate", "rmse": rmse, "square": {"floor": 1.0, "curvature": curvature}}
    plan["expected"]["errors"] = [error]
    found = [Estimate(rear, "1/rad", 8.0, 8.0, 2.0), Estimate(front, "1/rad", 8.0, 8.0, 1.0)]
    correlation = np.array([[1.0, -0.5], [-0.5, 1.0]])
    (reached,) = reached_rmse(plan, found, correlation)
    # 8 (1/2)^2 + 2 (-0.5) (1/2) (2/4) + 3
    assert reached.reached == pytest.approx(math.sqrt(1.0 + 2.0 - 0.25 + 3.0))
    assert (reached.before, reached.expected, reached.unit) == (4.0, 2.5, "rad/s")
    errors = reached_errors(plan, found, resolve_single(CAR, "test"))
    assert "yaw rate with EKF by 2.40 rad/s (expected 2.50, before 4.00)" in in_words(errors[:1], rmse=[reached])
    (kept,) = record_of_errors(errors, rmse=[reached])["errors"]
    assert kept["ratio"] == pytest.approx(reached.reached / 2.5)
    (worse,) = reached_rmse(plan, [replace(e, error=9.0) for e in found], correlation)
    assert worse.reached == 4.0  # no estimator is worse off than before
    (unknown,) = reached_rmse(plan, [replace(e, error=math.nan) for e in found], np.zeros((0, 0)))
    assert math.isnan(unknown.reached)
    assert verdict_of([replace(reached, reached=4.0)]) == "larger"
