"""A finished study with names that no page may take for code, and its page."""

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from harness.config import build_study
from harness.study.run import run_study

NASTY = "\"><img src=x onerror='window.hit=1'><script>window.hit=1</script>"
STUDY = {
    "name": "car",
    "title": f"How heavy may it be? {NASTY}",
    "seed": 11,
    "targets": ["lateral_velocity"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"},
    "drive": [
        {"name": f"weave {NASTY}", "kind": "sine", "duration": 6, "amplitude": "20 deg"},
        {"name": "fast", "kind": "sine", "duration": 4, "amplitude": "30 deg", "speed": "30 m/s"},
    ],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": NASTY, "kind": "ukf", "alpha": 0.5}],
    "design": [
        {"name": "mass", "repeats": 6, "factor": [{"parameter": "mass", "levels": ["1.5 t", "1.9 t"]}]},
        {
            "name": "all",
            "sampling": "saltelli",
            "samples": 16,
            "factor": [
                {"parameter": "mass", "range": ["1.4 t", "1.9 t"]},
                {"parameter": "process_noise_scale", "range": [0.1, 10], "scale": "log"},
            ],
        },
    ],
}


@pytest.fixture(scope="package")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("view") / "car"
    run_study(build_study(STUDY), out, jobs=1, console=Console(file=io.StringIO()))
    return out


@contextlib.contextmanager
def served(folder):
    """Serve the page of a result folder as a user does, and give its address."""
    command = [sys.executable, "-m", "harness", "view", str(folder), "--no-browser"]
    root = str(Path(__file__).parents[3])
    environment = os.environ | {"PYTHONPATH": root}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


@pytest.fixture(scope="package")
def address(folder):
    with served(folder) as found:
        assert found.startswith("http://127.0.0.1:")
        yield found
