"""Where a result comes from: code, package versions, commit and processor."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import subprocess
from pathlib import Path
from types import ModuleType

from harness.common import sources
from harness.config import StudySpec
from harness.config.roles import ESTIMATORS
from harness.estimation.contract import load_estimator
from harness.models.assembly.placement import load_effect
from harness.models.drive_options import options_of
from harness.models.roles import DRIVES, SENSORS, TYRES, VEHICLES
from harness.recordings import readers
from harness.study import evaluate
from harness.study.devices import device

PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "sympy", "xarray", "zarr", "SALib", "robustness-harness")


def code_state(study: StudySpec) -> dict[str, str]:
    """Return what scores depend on, to the bit, beside the study: ``engine`` and ``versions`` of the packages."""
    versions = {"python": platform.python_version(), **{p: importlib.metadata.version(p) for p in PACKAGES}}
    if study.device != "cpu":
        versions |= {"device": study.device, **device(study.device).versions()}
    return {"versions": json.dumps(versions), "engine": engine_hash(study)}


def engine_hash(study: StudySpec) -> str:
    """Return a hash of the code and the networks that decide a study's scores, whatever their files are called.

    Raises:
        UserError: If an estimator's file is not there.
    """
    components = parts(study)
    evaluated = [evaluate] if study.device == "cpu" else [evaluate, device(study.device)]
    total = hashlib.sha256(sources.digest([*evaluated, *(m for m in components if sources.has_file(m))]).encode())
    for module in components:
        if not sources.has_file(module):  # registered in a notebook
            total.update(sources.object_digest(module).encode())
    for spec in study.estimators:
        file = load_estimator(spec.kind)
        for path in file.files(file.Settings(**spec.settings), spec.base):
            total.update(path.read_bytes())
    return total.hexdigest()


def parts(study: StudySpec) -> list[ModuleType]:
    """Return the components that a study uses, which ``evaluate`` finds by name and does not import."""
    components = [ESTIMATORS.load(e.kind, ()) for e in study.estimators]
    for spec in (study.plant, study.belief):
        if spec.external is not None:
            components.append(SENSORS.load(spec.sensors))
            continue
        components.append(VEHICLES.load(spec.vehicle))
        components += [TYRES.load(spec.tyre)] if spec.tyre else []
        components += [load_effect(name) for name in spec.effects]
        components.append(SENSORS.load(spec.sensors))
    for drive in study.drives:
        components.append(DRIVES.load(drive.kind))
        for option in options_of(drive.kind):
            named = drive.options.get(option.name)
            if option.unit == "text" and isinstance(named, str):  # it may be a recording
                reader = readers.reader_of(drive.base / named)
                components += [] if reader is None else [reader]
    return list(dict.fromkeys(components))


def commit() -> str:
    """Return the commit of the checkout, marked if there are changes, or ``unknown`` outside one."""
    head, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain")
    return "unknown" if head is None else head + (" with changes" if changes else "")


def _git(*arguments: str) -> str | None:
    here = Path(__file__).resolve().parents[2]
    try:
        done = subprocess.run(["git", "-C", here, *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def processor() -> str:
    """Return the name of the processor, for the record of a result."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"
