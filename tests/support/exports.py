"""Exported estimators for tests: on small models, and of a study of a car."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from harness.engine.compile import CompiledModel
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.realtime.export.interface import interface_of
from harness.realtime.export.library import library_of
from harness.realtime.export.source import Export
from harness.realtime.export.steps import Region
from support.observers import C_COMPILER

COMPILER = C_COMPILER or ""


def of_small(kind: str, compiled: CompiledModel, precision="double", **settings) -> tuple[Export, CompiledEstimator]:
    """Return an estimator on a small model as C, and itself."""
    estimator = CompiledEstimator(kind, compiled, settings)
    nx, ny = compiled.nx, compiled.ny
    values = {"process_noise": [1e-3] * nx, "measurement_noise": [1e-2] * ny}
    values |= {"first": [0.0] * nx, "first_variance": [1.0] * nx}
    parameters = [0.7] * len(compiled.model.parameters)
    face, library = interface_of(compiled, parameters), library_of(kind, estimator)
    return Export(f"of_{kind}", kind, library, face, precision, compiled.step_size, values, {}, "none", ""), estimator


def region_of_small(compiled: CompiledModel) -> Region:
    """Return where states, inputs and noise of a small model may lie."""
    nx, nu, ny = compiled.nx, compiled.nu, compiled.ny
    parameters = np.full(len(compiled.model.parameters), 0.7)
    noise = np.full(nx, 1e-3), np.full(ny, 1e-2)
    return Region(np.zeros(nx), np.ones(nx), np.full(nx, 0.1), np.zeros(nu), np.ones(nu), parameters, *noise)


def made(folder: Path, *arguments: str) -> str:
    """Run make in a folder; return what it says.

    Raises:
        AssertionError: If it fails.
    """
    done = subprocess.run(["make", "-s", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
