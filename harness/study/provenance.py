"""Where a result comes from: code, package versions, commit and processor; and how two results differ in it."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from harness.common import sources
from harness.common.errors import UserError
from harness.common.files import parse_toml
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
    """Return what scores depend on, to the bit, besides the study: ``engine`` and ``versions`` of the packages."""
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
    components = [ESTIMATORS.load(e.kind) for e in study.estimators]
    for spec in (study.plant, study.belief):
        if spec.external is None:
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


_SHOWN = 5
"""Differences that a message lists; of the others it tells how many there are."""

_ABSENT = object()


def differences(stored: Mapping[str, Any], now: Mapping[str, Any], study: StudySpec) -> str:
    """Return how a stored result differs from what a study would give, as a predicate; empty if it does not.

    Args:
        stored: Attributes of the root of the store.
        now: What they would be now.
        study: The study.
    """
    if stored.get("study_name") != study.name:
        return f"holds the result of study '{stored.get('study_name')}', not of '{study.name}'"
    if stored.get("study_hash") != study.hash:
        return f"holds the result of another study called '{study.name}': {_of_studies(stored, now)}"
    causes = []
    if stored.get("versions") != now["versions"]:
        here, there = _decoded(now["versions"]), _decoded(stored.get("versions"))
        causes.append(f"with other package versions or on another device ({_listed(_of_values(there, here))})")
    if stored.get("engine") != now["engine"]:
        commits = f"{_short(stored.get('commit'))} there, {_short(now['commit'])} here"
        causes.append(f"by other code of this project or of a component from outside (commit {commits})")
    return f"was computed {' and '.join(causes)}" if causes else ""


def _of_studies(stored: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return what differs in the text of two studies, else in what their files say, else in the digests of files."""
    try:
        for name in ("study", "self_contained_study"):
            there, here = (parse_toml(str(a.get(name, "")), where) for a, where in ((stored, "there"), (now, "here")))
            if changed := list(_of_values(there, here)) if there or name == "study" else []:
                return _listed(iter(changed))
    except UserError:
        return "its stored text cannot be read"
    files = [json.loads(attributes.get("files", "{}")) for attributes in (stored, now)]
    return _listed(_of_values(*files)) or (
        "the texts agree, so that a file differs that it names: drives, parameters, tuning, a recording, an estimator "
        "or the plant"
    )


def _of_values(there: Any, here: Any, key: str = "") -> Iterator[str]:
    """Go through what differs in two nested values."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for name in dict.fromkeys([*there, *here]):
            below = f"{key}.{name}" if key else str(name)
            if not key and name in ("title", "limits"):  # they decide no score
                continue
            yield from _of_values(there.get(name, _ABSENT), here.get(name, _ABSENT), below)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for i, pair in enumerate(zip(there, here, strict=True)):
            yield from _of_values(*pair, f"{key}[{i}]")
    elif there != here:
        yield f"{key} {_written(there)} there, {_written(here)} here"


def _listed(changed: Iterator[str]) -> str:
    every = list(changed)
    more = len(every) - _SHOWN
    return "; ".join(every[:_SHOWN]) + (f"; and {more} more" if more > 0 else "")


def _written(value: Any) -> str:
    if value is _ABSENT:
        return "absent"
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _decoded(versions: Any) -> dict[str, Any]:
    try:
        return dict(json.loads(versions))
    except (TypeError, ValueError):
        return {}


def _short(commit: Any) -> str:
    first, _, rest = str(commit).partition(" ")
    return f"{first[:10]} {rest}".strip()
