"""Estimators of somebody else for tests: the observers of the templates, in C and in Python, and a study of a car."""

from __future__ import annotations

import shutil
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from harness.external.estimators.library import HEADER

C_COMPILER = shutil.which("cc") or shutil.which("gcc")

needs_compiler = pytest.mark.skipif(C_COMPILER is None, reason="there is no C compiler")

OF_THE_LIBRARY = {
    "inputs": ["steering_wheel_angle", "speed"],
    "measurements": ["yaw_rate"],
    "estimates": ["lateral_velocity", "yaw_rate"],
    "values": ["mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle", "steering_ratio"],
}

MASS = {"parameter": "mass", "of": "both", "levels": [1000.0, 1600.0]}

CONTENT: dict[str, Any] = {
    "name": "foreign",
    "seed": 3,
    "targets": ["lateral_velocity", "yaw_rate"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "design": [{"name": "mass", "repeats": 11, "factor": [MASS]}],
}


def source(template: str, name: str = "observer") -> str:
    """Return a template of ``harness new`` under a name."""
    text = resources.files("harness.cli").joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    return text.replace("@NAME@", name).replace("@TITLE@", name)


def compiled(folder: Path, text: str, name: str = "observer", *flags: str) -> Path:
    """Write a C file beside the header and return the library that it is compiled to."""
    (folder / HEADER.name).write_text(HEADER.read_text())
    (folder / f"{name}.c").write_text(text)
    library = folder / f"lib{name}.so"
    command = [C_COMPILER, "-O2", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-shared", "-fPIC", *flags]
    subprocess.run([*command, f"{name}.c", "-o", library, "-lm"], cwd=folder, check=True)
    return library
