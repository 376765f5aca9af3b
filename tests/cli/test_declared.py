"""Options are declared once, by the fields of a dataclass, and called the same in all commands."""

import inspect
from dataclasses import MISSING, dataclass, field, fields
from typing import Annotated

import numpy as np
import pandas as pd
import pytest
import scipy.io
import typer
import typer.main
from typer.testing import CliRunner

import harness as h
from harness.cli.declared import takes
from harness.cli.main import RENAMED, app
from harness.cli.recordings import EstimateOptions, IdentifyOptions, TraceOptions
from harness.common.errors import UserError

COMMANDS = typer.main.get_command(app).commands


@dataclass(frozen=True)
class Place:
    """Where."""

    town: Annotated[str, typer.Option("--town")]
    street: Annotated[str | None, typer.Option("--street")] = None


@dataclass(frozen=True, kw_only=True)
class Visit:
    """When, and where."""

    days: Annotated[int, typer.Option("--days", "-n", min=1)] = 3
    place: Place
    guests: Annotated[list[str], typer.Option("--guest")] = field(default_factory=list)


def ran(*words):
    return CliRunner().invoke(app, list(map(str, words)))


def options(command):
    return {o: p for p in COMMANDS[command].params for o in p.opts}


def test_a_dataclass_gives_names_flags_and_defaults_and_gets_the_values():
    given, one = [], typer.Typer()
    one.command()(takes(Visit)(given.append))
    assert CliRunner().invoke(one, ["--town", "Ulm", "-n", "5", "--guest", "a", "--guest", "b"]).exit_code == 0
    assert CliRunner().invoke(one, ["--town", "Ulm"]).exit_code == 0
    assert given == [Visit(days=5, place=Place("Ulm"), guests=["a", "b"]), Visit(place=Place("Ulm"))]
    assert CliRunner().invoke(one, []).exit_code == 2
    assert CliRunner().invoke(one, ["--town", "Ulm", "--days", "0"]).exit_code == 2
    assert next(iter(inspect.signature(takes(Visit)(given.append)).parameters)) == "town"


@pytest.mark.parametrize(
    ("flags", "commands"),
    [
        (("--channels", "-c"), ("check", "estimate", "tune", "identify", "trace")),
        (("--data", "-d"), ("estimate", "tune")),
        (("--train", "-d"), ("identify", "trace")),
        (("--test", "-t"), ("identify", "trace")),
        (("--estimator", "-e"), ("estimate", "tune", "trace", "remedy")),
        (("--drive",), ("simulate", "observability", "tune", "realtime")),
        (("--model", "-m"), ("estimate", "tune", "identify", "trace", "simulate", "observability", "new")),
        (("--free", "-f"), ("identify", "trace")),
        (("--signal",), ("simulate", "estimate")),
    ],
)
def test_one_thing_has_one_name_in_all_commands(flags, commands):
    for command in commands:
        assert set(options(command)[flags[0]].opts) == set(flags), command


@pytest.mark.parametrize(("command", "former"), [(c, old) for c, names in RENAMED.items() for old in names])
def test_a_former_name_is_taken_with_a_note(command, former):
    today = RENAMED[command][former]
    assert former not in options(command)
    assert today in options(command)
    done = ran(command, former, "nowhere.csv")
    assert f"note: {former} of harness {command} is called {today}" in done.stderr
    assert "No such option" not in done.stderr


@pytest.mark.parametrize(
    ("task", "call"),
    [
        (EstimateOptions, h.estimate),
        (EstimateOptions, h.Estimator.run),
        (IdentifyOptions, h.identify),
        (TraceOptions, h.Diagnosis),
    ],
)
def test_an_option_has_keyword_and_default_of_the_call_in_python(task, call):
    stated = {f.name: f.default for f in fields(task)}
    shared = [p for p in inspect.signature(call).parameters.values() if p.name in stated and p.name != "estimators"]
    assert len(shared) >= 3
    for parameter in shared:
        ours, theirs = (
            None if v in (MISSING, parameter.empty, ()) else v for v in (stated[parameter.name], parameter.default)
        )
        assert ours == theirs, parameter.name


def test_a_bare_harness_prints_help_and_has_done_what_was_asked():
    done = ran()
    assert done.exit_code == 0
    assert done.stdout == ran("--help").stdout
    assert "estimate" in done.stdout


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_a_flag_has_no_type(command):
    help_ = ran(*filter(None, [command]), "--help")
    assert help_.exit_code == 0
    assert "bool" not in help_.stdout.lower().replace("boolean", "")


TIME = np.arange(0, 30, 0.01)
CLOCK = 'time = { channel = "t", unit = "s" }\n'


@pytest.fixture
def two_loggers(tmp_path):
    """Return a CSV file and a MAT file of the same kind of drive, with names and units of their own, and their maps."""
    yaw, speed, steering = 0.2 * np.sin(TIME), np.full(len(TIME), 20.0), 0.5 * np.sin(TIME)
    pd.DataFrame({"t": TIME, "gyro": np.degrees(yaw), "v": 3.6 * speed, "wheel": np.degrees(steering),
                  "ay": 20 * yaw}).to_csv(tmp_path / "a.csv", index=False)  # fmt: skip
    scipy.io.savemat(
        tmp_path / "b.mat", {"t": TIME, "r": yaw, "vx": speed, "delta": steering, "acc": 20 * yaw / 9.80665}
    )

    def entries(names):
        signals = ("yaw_rate", "speed", "steering_wheel_angle", "lateral_acceleration")
        lines = zip(signals, names, strict=True)
        return CLOCK + "\n".join(f'{s} = {{ channel = "{c}", unit = "{u}" }}' for s, (c, u) in lines)

    csv = entries((("gyro", "deg/s"), ("v", "km/h"), ("wheel", "deg"), ("ay", "m/s^2")))
    mat = entries((("r", "rad/s"), ("vx", "m/s"), ("delta", "rad"), ("acc", "g_0")))
    (tmp_path / "csv.toml").write_text(csv)
    (tmp_path / "mat.toml").write_text(mat)
    return tmp_path


def test_a_mat_and_a_csv_file_meet_in_one_trace(two_loggers, monkeypatch):
    asked = []

    def run_trace(task, folder, console):
        asked.append(task)
        raise UserError("enough")

    monkeypatch.setattr("harness.diagnosis.run.run_trace", run_trace)
    monkeypatch.chdir(two_loggers)
    done = ran("trace", "-m", "car", "--parameters", "blanco_2021", "--tyre", "linear",
               "--train", "a.csv@csv.toml@0s:25s", "--test", "b.mat@mat.toml", "--out", "there")  # fmt: skip
    assert done.exit_code == 2
    assert "enough" in done.stderr
    ((train,), (test,)) = asked[0].train, asked[0].test
    assert (train.attrs["name"], test.attrs["name"]) == ("a", "b")
    assert (train.sizes["time"], test.sizes["time"]) == (2500, 3000)
    for name in ("yaw_rate", "speed", "steering_wheel_angle", "lateral_acceleration"):
        np.testing.assert_allclose(train[name].values, test[name].values[:2500], atol=1e-9)


def test_the_map_of_a_recording_goes_before_that_of_all(two_loggers, monkeypatch):
    monkeypatch.chdir(two_loggers)
    one, other = (h.read_recording(path, "csv.toml") for path in ("a.csv", "b.mat@mat.toml"))
    np.testing.assert_allclose(one.speed.values, other.speed.values)
    with pytest.raises(h.UserError, match=r"b\.mat"):
        h.read_recording("b.mat", "csv.toml")


def test_one_vehicle_is_named_either_way(tmp_path):
    words = ["--drive", "sine", "--out", tmp_path / "sine.csv", "--option", "duration=2 s"]
    assert ran("simulate", "-m", "scalar_example", "car", *words).exit_code == 2
    assert ran("simulate", *words).exit_code == 2
    assert "name one vehicle" in ran("simulate", *words).stderr


FILE = """
title = "Two loggers"
recordings = "."
channels = "csv.toml"
step = "10 ms"
free = ["yaw_inertia"]
model = { vehicle = "car", parameters = "blanco_2021", tyre = "linear", sensors = "car_series" }
train = [{ file = "a.csv", span = ["0 s", "25 s"] }]
test = [{ file = "b.mat", channels = "mat.toml" }]
"""


@pytest.fixture
def measured_file(two_loggers, monkeypatch):
    monkeypatch.chdir(two_loggers)
    (two_loggers / "both.toml").write_text(FILE)
    return "both.toml"


@pytest.mark.parametrize(
    ("words", "where", "noted"),
    [(("trace",), "results/trace-both", False), (("loop",), "results/loop-both", True)],
)
def test_a_trace_takes_a_file_of_measured_drives(measured_file, monkeypatch, words, where, noted):
    asked = []
    monkeypatch.setattr(
        "harness.diagnosis.measured_study.trace_study", lambda *given: asked.append(given) or ["adequate", "the same"]
    )
    done = ran(*words, measured_file, "--jobs", 2)
    assert done.exit_code == 0, done.output
    assert ("is called harness trace FILE" in done.stderr) == noted
    ((study, drives, out, jobs, _),) = asked
    assert (study.raw.title, str(out), jobs) == ("Two loggers", where, 2)
    assert (drives["train"][0].sizes["time"], drives["test"][0].sizes["time"]) == (2501, 3000)
    np.testing.assert_allclose(drives["train"][0].speed.values, drives["test"][0].speed.values[:2501])
    assert done.stdout.splitlines() == ["adequate", "the same", f"{where}/report.html"]


def test_an_identification_takes_the_same_file(measured_file, monkeypatch):
    asked = []

    def fit(task, say):
        asked.append(task)
        raise UserError("enough")

    monkeypatch.setattr("harness.identification.fit_recordings.fit_recordings", fit)
    done = ran("identify", measured_file)
    assert done.exit_code == 2, done.output
    assert (asked[0].free, asked[0].method) == (("yaw_inertia",), "likelihood")
    assert [d.attrs["name"] for d in (*asked[0].train, *asked[0].test)] == ["a", "b"]


@pytest.mark.parametrize("command", ["trace", "identify"])
def test_a_file_stands_alone_and_without_one_the_rest_is_asked_for(measured_file, command):
    done = ran(command, measured_file, "-m", "car")
    assert done.exit_code == 2
    assert "give only --out and --jobs with it" in done.stderr
    done = ran(command, "-m", "car", "--train", "a.csv")
    assert done.exit_code == 2
    assert ("--test" in done.stderr) == (command == "trace")
    assert "--out" in done.stderr
    assert "--model" not in done.stderr


def test_remedies_are_tried_as_asked(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("harness.remedy.run.try_remedies", lambda *given: asked.append(given) or "tried")
    monkeypatch.setattr("harness.remedy.answer.answer", lambda tried: f"{tried}: take it")
    monkeypatch.setattr("harness.remedy.report.write_remedy", lambda tried, out, command: [out / "report.html"])
    done = ran("remedy", "kalman-lecture", "--out", tmp_path / "there", "--equipment", 1, "--jobs", 2, "--yes")
    assert done.exit_code == 0, done.output
    ((study, out, *further),) = asked
    assert (study.name, out, further) == ("kalman-lecture", tmp_path / "there", [None, 1, 2, None, False])
    assert done.stdout.splitlines() == ["tried: take it", str(tmp_path / "there" / "report.html")]
