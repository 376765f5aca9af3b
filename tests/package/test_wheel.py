"""The package as users get it: built, installed in a fresh environment, used from a folder that holds nothing of ours.

The environment borrows the dependencies of the one that runs the tests; the harness in it is the wheel's. Where
``HARNESS_SECOND_PYTHON`` names an interpreter of another version with the packages of requirements.lock, all is tried
on it as well.
"""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pandas as pd
import pytest

from support.plugins import example, project

ROOT = Path(__file__).parents[2]
HOSTILE = "raise SystemExit('{} of the user was imported')\n"
OWN = "robustness_harness"
"""Begins the names of what pip keeps of an installed checkout: the harness and what lies beside it."""
BIN = "Scripts" if os.name == "nt" else "bin"
PYTHONS = [sys.executable, *filter(None, [os.environ.get("HARNESS_SECOND_PYTHON")])]

pytestmark = pytest.mark.wheel


def run(*command, cwd, expect=0):
    """Run a command without any path to the checkout; return what it prints."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=environment, capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert done.returncode == expect, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """The sdist, and the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    return next(folder.glob("*.tar.gz")), next(folder.glob("*.whl"))


def test_two_builds_of_the_wheel_have_the_same_bits(built, tmp_path, monkeypatch):
    """From the same files at another time, in another place; SOURCE_DATE_EPOCH stands for the clock."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    wheels = []
    for place, changed in (("here", 1_600_000_000), ("elsewhere", 1_650_000_000)):
        with tarfile.open(built[0]) as sdist:
            sdist.extractall(tmp_path / place, filter="data")
        source = next((tmp_path / place).iterdir())
        for file in source.rglob("*"):
            os.utime(file, (changed, changed))
        out = tmp_path / f"wheel-{place}"
        run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, source, cwd=tmp_path)
        wheels += [file.read_bytes() for file in out.glob("*.whl")]
    assert len(wheels) == 2
    assert wheels[0] == wheels[1]


@pytest.fixture(scope="session", params=PYTHONS, ids=lambda path: "the-same" if path == sys.executable else "second")
def fresh(built, tmp_path_factory, request):
    """An environment with the wheel; its folder of programs."""
    folder = tmp_path_factory.mktemp("fresh")
    run(request.param, "-m", "venv", "--without-pip", folder / "venv", cwd=folder)
    programs = folder / "venv" / BIN
    python = programs / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", built[1], cwd=folder)
    paths = "import sysconfig; print(*(sysconfig.get_path(p) for p in ('purelib', 'platlib')), sep=chr(10))"
    here, borrowed = (run(p, "-c", paths, cwd=folder).split("\n")[:2] for p in (python, request.param))
    for installed in (p for place in dict.fromkeys(borrowed) for p in Path(place).iterdir()):
        if OWN not in installed.name and not (Path(here[0]) / installed.name).exists():
            (Path(here[0]) / installed.name).symlink_to(installed)
    return programs


@pytest.fixture(scope="module")
def empty(fresh, tmp_path_factory):
    """A folder of the user, with modules that must not be touched."""
    folder = tmp_path_factory.mktemp("user")
    for name in ("models", "tests", "support", "bench", "studies"):
        (folder / f"{name}.py").write_text(HOSTILE.format(name), encoding="utf-8")
    return folder


@pytest.fixture
def harness(fresh, empty):
    """Run the command of the wheel in the user's folder."""
    return lambda *arguments, **further: run(fresh / "harness", *arguments, cwd=empty, **further)


def test_sdist_and_wheel_hold_the_same_package(built):
    with tarfile.open(built[0]) as sdist, zipfile.ZipFile(built[1]) as wheel:
        assert not any(member.issym() or member.islnk() for member in sdist)
        sources = {m.name.split("/", 1)[1] for m in sdist.getmembers() if m.isfile()}
        files = {name for name in wheel.namelist() if not name.split("/")[0].endswith(".dist-info")}
    tracked = [
        p for p in (ROOT / "harness").rglob("*") if p.suffix in (".py", ".typ", ".css", ".js", ".html", ".npz", ".h")
    ]
    tracked += [ROOT / "harness" / p.relative_to(ROOT) for p in (ROOT / "models").rglob("*.py")]
    tracked += [ROOT / "harness" / "config" / p.relative_to(ROOT) for p in (ROOT / "studies").rglob("*.toml")]
    tracked += [
        ROOT / "harness" / "config" / "studies" / "study.schema.json",
        *(ROOT / "harness" / "cli" / "templates").glob("*"),
        *(ROOT / "harness" / "realtime" / "export" / "templates").glob("*"),
    ]
    assert {p.relative_to(ROOT).as_posix() for p in tracked} == files
    assert files <= sources


def test_the_package_of_the_wheel_is_the_one_that_runs(fresh, empty):
    where = run(fresh / "python", "-c", "import harness.models; print(harness.models.__file__)", cwd=empty).strip()
    assert Path(where).is_relative_to(fresh.parent)


def test_studies_are_listed_by_both_ways_to_call_the_command(harness, fresh, empty):
    listed = harness("list", "studies")
    assert "mass " in listed
    assert run(fresh / "python", "-m", "harness", "list", "studies", cwd=empty) == listed


def test_a_study_of_the_package_is_run_by_its_name(harness, empty):
    said = harness("run", "mass", "--quick")
    assert "trailer mass" in said
    assert (empty / "results" / "mass-quick" / "report.pdf").stat().st_size > 10_000


def test_what_a_checkout_alone_has_is_said(harness, empty):
    said = harness("campaign", expect=2)
    assert "come with a checkout" in said
    assert "Traceback" not in said
    assert "dissertation" not in (empty / "results" / "mass-quick" / "report.html").read_text(encoding="utf-8")


def test_a_drive_is_simulated(harness, empty):
    harness("simulate", "semitrailer", "--drive", "sine", "--seed", "1", "--out", "sine.csv")
    assert (empty / "sine.csv").read_text(encoding="utf-8").startswith("time")


def test_a_wrong_word_gets_one_line(harness):
    said = harness("run", "mas", expect=2)
    assert "closest: mass" in said
    assert "Traceback" not in said


CAR = ("--parameters", "blanco_2021", "--tyre", "linear", "--sensors", "car_navigation")
WEAVE = ("--drive", "random_sequence", "--option", "duration=25 s", "--option", "speed=20 m/s", "--option",
         "amplitude=3 deg", "--option", "lateral_acceleration_limit=9")  # fmt: skip


@pytest.fixture(scope="module")
def logs(fresh, empty):
    """Three logs of a car whose steering lags, generated in the user's folder."""
    lag = ("--effect", "steering_lag", "--set", "steering_lag=0.12")
    for seed in (1, 2, 3):
        out = ("--seed", seed, "--option", f"seed={seed}", "--out", f"log{seed}.csv")
        run(fresh / "harness", "simulate", "car", *CAR, *lag, *WEAVE, *out, cwd=empty)
    return ["log1.csv", "log2.csv", "log3.csv"]


def test_estimators_run_on_a_generated_log(harness, logs, empty):
    said = harness("estimate", "--model", "car", *CAR, "--data", logs[0], "-e", "ekf", "-e", "ukf", "--out", "est")
    assert "of NIS in its 95 % band" in said
    table = pd.read_csv(empty / "est" / "estimates" / "log1-UKF.csv")
    assert table["lateral_velocity_std"].gt(0).iloc[1:].all()
    assert (empty / "est" / "report.pdf").stat().st_size > 10_000


def test_a_trace_finds_the_lag_that_nobody_told_it_of(harness, logs, empty):
    drives = ("--train", logs[0], "--train", logs[1], "--test", logs[2])
    said = harness("trace", "--model", "car", *CAR, *drives, "--estimator", "ekf", "--out", "trace")
    assert "steering" in said
    assert "steering_lag" in (empty / "trace" / "amended.toml").read_text(encoding="utf-8")


def test_a_vehicle_effect_and_estimator_of_the_user_in_a_study(fresh, empty):
    """Files touched to add a vehicle: its own, axle names and signals included."""
    package = Path(run(fresh / "python", "-c", "import harness; print(*harness.__path__)", cwd=empty).strip())
    before = {p: p.stat().st_mtime_ns for p in package.rglob("*.*") if "__pycache__" not in p.parts}
    lab = project(empty / "lab", example())
    (lab / "models.py").write_text(HOSTILE.format("models"), encoding="utf-8")
    run(fresh / "harness", "new", "estimator", "forgetful", cwd=lab)
    listed = run(fresh / "harness", "list", "vehicles", cwd=lab)
    assert "rigid_truck" in listed
    run(fresh / "harness", "run", "worn-tag", "--quick", cwd=lab)
    page = (lab / "results" / "worn-tag-quick" / "report.html").read_text(encoding="utf-8")
    assert "forgets" in page
    assert {p: p.stat().st_mtime_ns for p in package.rglob("*.*") if "__pycache__" not in p.parts} == before
