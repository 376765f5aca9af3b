"""The harness at work in a folder with other people's ``models`` and ``tests``: modules, or packages as of Django.

Others are named as what the harness imports, be it a package that it depends on or one of Python's own.
"""

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from support.probe_study import STUDY

ROOT = Path(__file__).parents[2]
NAMES = {"models", "tests", "support", "bench", "typing", "resource", "multiprocessing", "socket"}
NAMES |= {name for name in packages_distributions() if name.isidentifier()} - {"harness"}
HOSTILE = "raise SystemExit('{} of the user was imported')\n"


@pytest.fixture
def harness(tmp_path):
    """Run ``python -m harness`` in a folder whose modules must not be touched; return what it prints."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(HOSTILE.format(name))

    def run(*arguments):
        command = [sys.executable, "-m", "harness", *map(str, arguments)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.mark.parametrize("packages", [False, True], ids=["modules", "packages"])
def test_one_drive_is_simulated(harness, tmp_path, packages):
    for path in list(tmp_path.glob("*.py")) if packages else ():
        path.unlink()
        for name in ("__init__", "vehicles", "contracts"):
            (tmp_path / path.stem).mkdir(exist_ok=True)
            (tmp_path / path.stem / f"{name}.py").write_text(HOSTILE.format(f"{path.stem}/{name}.py"))
    harness("simulate", "semitrailer", "--drive", "sine", "--option", "speed=12", "--out", "drive.csv")
    assert (tmp_path / "drive.csv").read_text().startswith("time")


def test_studies_of_the_package_are_found_by_name_and_those_of_the_user_come_first(harness, tmp_path):
    assert "heavier or lighter" in harness("list", "studies")
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "mass.toml").write_text(STUDY.replace("Does the runner keep its promises?", "Mine?"))
    listed = harness("list", "studies")
    assert "Mine?" in listed
    assert listed.count("\nmass ") == 1
    assert "joint-loading" in listed


@pytest.mark.parametrize("workers", [("--jobs", 1), ("--dask", "local", "--jobs", 1)], ids=["thread", "process"])
def test_a_study_is_run_with_its_report(harness, tmp_path, workers):
    (tmp_path / "probe.toml").write_text(STUDY)
    assert "report.html" in harness("run", "probe.toml", *workers)
    assert (tmp_path / "results" / "probe" / "report.html").is_file()


def test_a_quick_look_at_a_study_of_the_package_has_a_name_of_its_own(harness, tmp_path):
    """By its name, from a folder that holds nothing of ours; a quick look is never taken for the whole study."""
    assert "kalman-lecture-quick" in harness("run", "kalman-lecture", "--quick", "--jobs", 1)
    assert [p.name for p in (tmp_path / "results").iterdir()] == ["kalman-lecture-quick"]


def test_a_shell_completes_commands():
    """As bash asks for it; ``--show-completion`` looks at the shell it runs in, which tests need not have."""
    asked = {"_HARNESS_COMPLETE": "complete_bash", "COMP_WORDS": "harness id", "COMP_CWORD": "1"}
    assert "identify" in CliRunner().invoke(app, [], env=asked, prog_name="harness").output.split()


def test_a_console_without_greek_letters_gets_the_answer(harness, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    assert "noise scale" in harness("run", "kalman-lecture", "--quick", "--jobs", 1)
