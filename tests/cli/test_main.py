"""The command line: exit statuses, one message per error, and what the commands write."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli import main as cli
from harness.cli.listing import LISTED
from harness.common.errors import ModelError, UserError
from harness.models.contracts import Profile
from support import synthetic

ROOT = Path(__file__).parents[2]


@pytest.fixture
def harness():
    """Run the command line; return (exit status, stdout, stderr)."""

    def run(*args: object) -> tuple[int, str, str]:
        result = CliRunner().invoke(cli.app, [str(a) for a in args])
        return result.exit_code, result.stdout, result.stderr

    return run


@pytest.fixture
def small_study(tmp_path):
    text = (ROOT / "studies" / "mass.toml").read_text().split("[report.monitor]")[0]  # which takes a minute
    (tmp_path / "drives").mkdir()
    drives = (ROOT / "studies" / "drives" / "robustness.toml").read_text()
    (tmp_path / "drives" / "robustness.toml").write_text(drives)
    path = tmp_path / "mass.toml"
    path.write_text(text)
    return path


def test_a_vehicle_is_listed_with_what_it_computes(harness):
    status, printed, _ = harness("list", "vehicles", "car")
    assert status == 0
    rows = {line.split()[0]: line.split()[1] for line in printed.split("quantities of car")[1].splitlines() if line}
    assert rows["lateral_velocity"] == "state"
    assert rows["slip_angle_axle_rear"] == "port"
    assert "example_state" in harness("list", "vehicles", "scalar_example")[1]  # without tyres


def test_help_of_every_command(harness):
    status, out, _ = harness("--help")
    assert status == 0
    for command in ("run", "report", "list", "simulate", "observability", "realtime", "cache", "schema"):
        assert command in out
        assert harness(command, "--help")[0] == 0


def test_help_is_quick_and_imports_nothing_heavy():
    code = (
        "import sys; sys.argv = ['harness', '--help']\n"
        "from harness.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'sympy', 'numba', 'xarray', 'pandas', 'pint', 'matplotlib', 'pydantic'}\n"
        "heavy |= {'email', 'http'}\n"
        "sys.exit(','.join(heavy & set(sys.modules)) or 0)"
    )
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert time.perf_counter() - started < 5.0  # generous: the machine may be busy; the imports are the point


def test_version(harness):
    status, out, _ = harness("--version")
    assert status == 0
    assert out.startswith("harness 0.")


def test_run_hands_over_and_prints_the_reports(harness, small_study, tmp_path, monkeypatch):
    seen = {}

    def run_study(study, out, jobs, client, agree, restart, device):
        seen.update(study=study, out=out, jobs=jobs)
        return synthetic.write(out, {"level": synthetic.design(repeats=2)})

    import harness.study.run as stage
    from harness.study import report

    monkeypatch.setattr(stage, "run_study", run_study)
    real, analysed = report.Analysis, []
    monkeypatch.setattr(report, "Analysis", lambda store: analysed.append(store) or real(store))
    out = tmp_path / "out"
    status, printed, err = harness("run", small_study, "--jobs", 2, "--out", out)
    assert status == 0
    assert (seen["study"].name, seen["out"], seen["jobs"]) == ("mass", out, 2)
    answer, *files = printed.splitlines()
    assert "With the trailer mass at 8 t instead of the believed 24 t," in answer
    assert files == [str(out / "report.html"), str(out / "report.pdf")]
    assert all(Path(file).stat().st_size for file in files)
    assert len(analysed) == 1
    assert err.splitlines()[-1] == f"{out}: {report.NOT_VERIFIABLE}"  # a slow machine says what it writes before


def test_run_on_a_cluster_takes_its_client_from_the_options(harness, small_study, tmp_path, monkeypatch):
    import contextlib

    import harness.study.cluster as cluster
    import harness.study.run as stage

    asked, seen = [], []

    @contextlib.contextmanager
    def connected(scheduler, workers):
        asked.append((scheduler, workers))
        yield f"client of {scheduler}"

    def run_study(study, out, jobs, client, agree, restart, device):
        seen.append((client, study.path.is_absolute()))

    monkeypatch.setattr(cluster, "connected", connected)
    monkeypatch.setattr(stage, "run_study", run_study)
    monkeypatch.setattr("harness.api.results.open_results", lambda folder: folder)
    monkeypatch.setattr(cli, "_write_report", lambda *_, **__: None)
    for options in (["--scheduler", "tcp://there:8786"], ["--dask", "local", "--jobs", 2]):
        assert harness("run", small_study, "--out", tmp_path / "out", *options)[0] == 0
    assert asked == [("tcp://there:8786", None), (None, 2)]
    assert seen == [("client of tcp://there:8786", True), ("client of None", True)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scheduler", "tcp://there:8786", "--jobs", 2], "leave out --dask and --jobs"),
        (["--scheduler", "tcp://there:8786", "--dask", "local"], "leave out --dask and --jobs"),
        (["--dask", "remote"], "'remote' is not"),
    ],
)
def test_cluster_options_that_do_not_fit(harness, small_study, options, message):
    status, _, err = harness("run", small_study, *options)
    assert status == 2
    assert message in " ".join(err.replace("│", " ").split())


@pytest.mark.parametrize("options", [[], ["--yes"], ["--restart"]])
def test_what_costs_much_wants_yes_where_there_is_no_terminal(harness, small_study, tmp_path, monkeypatch, options):
    import harness.study.run as stage

    seen = []

    def run_study(study, out, jobs, client, agree, restart, device):
        if agree is not None:
            agree("9 runs to do: about 2 h")
        seen.append(restart)

    monkeypatch.setattr(stage, "run_study", run_study)
    monkeypatch.setattr("harness.api.results.open_results", lambda folder: folder)
    monkeypatch.setattr(cli, "_write_report", lambda *_, **__: None)
    status, _, err = harness("run", small_study, "--out", tmp_path / "out", *options)
    if "--yes" in options:
        assert (status, seen) == (0, [False])
    else:
        assert (status, seen) == (2, [])
        assert err.startswith("error: 9 runs to do: about 2 h; nothing is begun: begin it with --yes, or state less")


@pytest.mark.parametrize(
    ("raised", "status", "begins"),
    [
        (UserError("a.toml: key: wrong; do this"), 2, "error: a.toml: key: wrong; do this"),
        (ModelError("unknown tyre 'x'"), 2, "error: unknown tyre 'x'"),
        (RuntimeError("disk on fire"), 70, "fault: RuntimeError: disk on fire; this is a fault of the harness"),
        (
            KeyboardInterrupt(),
            130,
            "interrupted: a study, a trace or a plan goes on from what is finished, other commands begin again",
        ),
    ],
)
def test_exit_status_says_what_kind_of_error(harness, small_study, tmp_path, monkeypatch, raised, status, begins):
    import harness.study.run as stage

    def run_study(*_, **__):
        raise raised

    monkeypatch.setattr(stage, "run_study", run_study)
    found, out, err = harness("run", small_study, "--out", tmp_path / "out")
    assert found == status
    assert out == ""
    assert err.startswith(begins)
    assert "Traceback" not in err
    if status != 130:
        assert "Traceback" in harness("run", small_study, "--debug", "--out", tmp_path / "out")[2]


def test_bad_study_is_refused_before_anything_is_written(harness, small_study, tmp_path):
    small_study.write_text(small_study.read_text().replace('"8 t", "12 t"', '"8 m", "-12 t"'))
    out = tmp_path / "out"
    status, printed, err = harness("run", small_study, "--out", out)
    assert (status, printed) == (2, "")
    assert f"{small_study}: design[0].factor[0].levels[0]: '8 m' does not fit" in err
    assert not out.exists()


def test_long_messages_are_not_wrapped(harness, tmp_path):
    path = tmp_path / ("long-" * 30 + ".toml")
    status, _, err = harness("run", path)
    assert status == 2
    assert err.count("\n") == 1
    assert f"{path}: there is no such file" in err


def test_study_by_name(harness, small_study, monkeypatch):
    import harness.study.run as stage

    monkeypatch.chdir(ROOT)
    names = []
    monkeypatch.setattr(stage, "run_study", lambda study, out, *_, **__: names.append((study.name, out)))
    monkeypatch.setattr("harness.api.results.open_results", lambda folder: folder)
    monkeypatch.setattr(cli, "_write_report", lambda *_, **__: None)
    assert harness("run", "ideal")[0] == 0
    assert names == [("ideal", Path("results/ideal"))]
    status, _, err = harness("run", "mas")
    assert status == 2
    assert "there is no study 'mas'; closest: mass (looked in studies)" in err


def test_recorded_study_stops_with_the_reason_without_the_recording(harness, tmp_path, monkeypatch):
    path = tmp_path / "mass-recorded.toml"
    text = (ROOT / "studies" / "mass-recorded.toml").read_text()
    path.write_text(text)
    monkeypatch.chdir(tmp_path)
    status, _, err = harness("run", path, "--out", tmp_path / "out")
    assert status == 2
    assert "cpg_slow_lap.mat" in err
    assert "does not exist" in err
    assert not (tmp_path / "out").exists()


def test_usage_errors_exit_with_2(harness, small_study):
    assert harness("run")[0] == 2
    assert harness("run", small_study, "--jobs", 0)[0] == 2
    assert harness("rum")[0] == 2


def test_report_of_a_missing_folder(harness, tmp_path):
    (tmp_path / "mass").mkdir()
    status, _, err = harness("report", tmp_path / "mas")
    assert status == 2
    assert "there is no such folder; closest: " in err


@pytest.mark.parametrize(
    ("role", "expected"),
    [
        ("models", ["semitrailer", "magic_formula", "ziaukas_2023", "test_vehicle"]),
        ("vehicles", ["semitrailer"]),
        ("tyres", ["linear", "magic_formula"]),
        ("sensors", ["series"]),
        ("parameters", ["ziaukas_2023", "trailer_mass", "24000", "stiffness_load_2", "65000"]),
        ("drives", ["winding_road", "steering_scale", "options of sine", "lateral_acceleration_limit"]),
        ("estimators", ["ekf", "ukf"]),
        ("readers", ["csv", "mat", "parquet"]),
        ("signals", ["articulation_angle", "deg"]),
        ("effects", ["effects"]),
    ],
)
def test_list_shows_every_file_of_the_folder(harness, role, expected):
    status, out, _ = harness("list", role)
    assert status == 0
    for word in expected:
        assert word in out
    if role not in ("models", "signals"):
        for name in LISTED[role].names():
            assert name in out


def test_list_studies(harness, monkeypatch):
    monkeypatch.chdir(ROOT)
    status, out, _ = harness("list", "studies")
    assert status == 0
    assert "mass-recorded" in out
    assert "heavier or lighter" in out


def test_list_one_file_with_its_settings(harness):
    status, out, _ = harness("list", "drives", "sine")
    assert status == 0
    assert "amplitude" in out
    assert "winding" not in out
    assert "UKF" not in out
    for role, name, word in (
        ("vehicles", "semitrailer", "trailer_mass"),
        ("tyres", "linear", "stiffness_peak"),
        ("sensors", "test_vehicle", "lateral_force_axle_21"),
        ("estimators", "ukf", "settings of ukf"),
        ("effects", "dropout", "is a degradation of sensors"),
    ):
        assert word in harness("list", role, name)[1]


def test_list_suggests_the_closest(harness):
    status, _, err = harness("list", "vehicels")
    assert (status, err.strip()) == (2, "error: unknown role 'vehicels'; closest: vehicles, channels")
    assert "closest: sine" in harness("list", "drives", "sin")[2]


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".nc"])
def test_simulate_writes_a_recording(harness, tmp_path, suffix):
    import xarray as xr

    out = tmp_path / f"drive{suffix}"
    status, printed, err = harness(
        "simulate", "semitrailer", "--drive", "sine", "--option", "duration=20 s", "--option", "speed=12",
        "--set", "trailer_mass=8 t", "--out", out,
    )  # fmt: skip
    assert status == 0, err
    assert "2001 samples" in printed
    if suffix == ".nc":
        with xr.open_dataset(out) as data:
            assert data["articulation_angle"].attrs["units"] == "rad"
            columns = data.to_dataframe().reset_index()
    else:
        columns = pd.read_csv(out) if suffix == ".csv" else pd.read_parquet(out)
    np.testing.assert_allclose(columns["time"], np.arange(2001) * 0.01, atol=1e-9)
    np.testing.assert_allclose(columns["speed"], 12.0)
    assert 0.01 < columns["articulation_angle"].abs().max() < 0.5


def test_simulate_with_noise_writes_what_sensors_give(harness, tmp_path):
    """A file of ``harness simulate --seed`` is a measured drive to every command: truths have names of their own."""
    for name, further in (("exact", ()), ("noisy", ("--seed", 1, "--signal", "coupling_force"))):
        out = tmp_path / f"{name}.csv"
        status, _, err = harness("simulate", "semitrailer", "--drive", "sine", "--sensors", "series", *further,
                                 "--out", out)  # fmt: skip
        assert status == 0, err
    exact, noisy = pd.read_csv(tmp_path / "exact.csv"), pd.read_csv(tmp_path / "noisy.csv")
    assert {"time", "steering_wheel_angle", "speed", "yaw_rate_trailer", "articulation_angle"} <= set(exact)
    np.testing.assert_array_equal(exact["yaw_rate_trailer"], exact["true_yaw_rate_trailer"])
    plain = [name for name in noisy if not name.startswith("true_")]
    assert sorted(plain) == ["speed", "speed_rate", "steering_wheel_angle", "time", "yaw_rate_trailer"]
    assert {"true_articulation_angle", "true_coupling_force", "true_yaw_rate_trailer"} <= set(noisy)
    assert np.std(noisy["yaw_rate_trailer"] - noisy["true_yaw_rate_trailer"]) == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["semitrailr", "--drive", "sine"], "unknown vehicle 'semitrailr'; closest: semitrailer"),
        (["semitrailer", "--drive", "sin"], "drive 'sin': kind: unknown drive 'sin'; closest: sine"),
        (["semitrailer", "--drive", "sine", "--option", "speed"], "--option 'speed': write NAME=VALUE"),
        (
            ["semitrailer", "--drive", "sine", "--option", "sped=3"],
            "sped: drive 'sine' has no option 'sped'; closest: speed",
        ),
        (
            ["semitrailer", "--drive", "sine", "--set", "trailer_mass=-8 t"],
            "trailer_mass: trailer_mass = -8000 kg lies below 1000 kg",
        ),
        (
            ["semitrailer", "--drive", "sine", "--set", "trailer_mass=24,5 t"],
            "trailer_mass: '24,5 t' may mean '24.5 t' or '245 t'",
        ),
        (
            ["semitrailer", "--drive", "sine", "--option", "speed=12,5 m/s"],
            "drive 'sine', speed: '12,5 m/s' may mean '12.5 m/s' or '125 m/s'",
        ),
        (["semitrailer", "--drive", "sine", "--option", "speed=1_2"], "drive 'sine', speed: '1_2' means '12'"),
        (
            ["semitrailer", "--drive", "sine", "--option", "speed=nan"],
            "drive 'sine', speed: nan is not a finite number",
        ),
        (["semitrailer", "--drive", "sine", "--signal", "coupling_forc"], "closest: coupling_force"),
        (["semitrailer", "--drive", "sine", "--parameters", "x"], "unknown parameter 'x'"),
    ],
)
def test_simulate_refuses(harness, tmp_path, arguments, message):
    status, _, err = harness("simulate", *arguments, "--out", tmp_path / "a.csv")
    assert status == 2
    assert message in err
    assert not list(tmp_path.iterdir())


def test_simulate_refuses_a_file_it_cannot_write_first(harness, tmp_path):
    run = ("simulate", "semitrailer", "--drive", "sine", "--out")
    assert "use one of .csv, .parquet, .nc" in harness(*run, tmp_path / "a.txt")[2]
    status, _, err = harness(*run, tmp_path / "none" / "a.csv")
    assert status == 2
    assert "there is no folder" in err


def test_observability_gets_the_resolved_model(harness, tmp_path, monkeypatch):
    import harness.cli.observability_report as stage

    seen = []
    monkeypatch.setattr(stage, "report", lambda *args: seen.append(args))
    status, _, err = harness(
        "observability", "semitrailer", "--unknown-input", "steering_wheel_angle", "--set", "constraint_rate=0",
        "--drive", "step", "--out", tmp_path,
    )  # fmt: skip
    assert status == 0, err
    spec, unknown, out, profile = seen[0]
    assert (spec.vehicle, spec.parameters, spec.tyre, spec.sensors) == (
        "semitrailer",
        "ziaukas_2023",
        "magic_formula",
        "series",
    )
    assert (unknown, out, spec.values["constraint_rate"]) == (["steering_wheel_angle"], tmp_path, 0.0)
    assert isinstance(profile, Profile)
    assert (
        "--option belongs to a drive"
        in harness("observability", "semitrailer", "--option", "speed=3", "--out", tmp_path)[2]
    )


def test_schema_to_stdout_and_to_a_file(harness, tmp_path):
    status, out, _ = harness("schema")
    assert status == 0
    assert harness("schema", "--out", tmp_path / "s.json")[0] == 0
    assert json.loads(out) == json.loads((tmp_path / "s.json").read_text())
    assert harness("schema", "--out", tmp_path / "none" / "s.json")[0] == 2


def test_cache_is_shown_and_only_what_was_generated_is_cleared(harness, tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "semitrailer_0123456789abcdef.py").write_text("x = 1")
    (folder / "__pycache__" / "semitrailer_0123456789abcdef.step-1.py311.nbi").write_text("x")
    (folder / "model_0123456789abcdee.py").mkdir()
    (folder / "letter_to_my_aunt.txt").write_text("kept")
    monkeypatch.setenv("HARNESS_CACHE", str(folder))
    status, out, _ = harness("cache")
    assert (status, out) == (0, f"2 files, 0.0 MiB in {folder}\n")
    assert harness("cache", "--clear")[1] == f"2 files, 0.0 MiB deleted from {folder}\n"
    assert sorted(p.name for p in folder.iterdir()) == ["letter_to_my_aunt.txt", "model_0123456789abcdee.py"]
    (folder / "letter_to_my_aunt.txt").unlink()
    (folder / "model_0123456789abcdee.py").rmdir()
    assert harness("cache", "--clear")[1].startswith("0 files")
    assert not folder.exists()
    assert harness("cache")[1].startswith("0 files")
