"""Where a result comes from: code, package versions, commit and processor."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import platform
import subprocess
from pathlib import Path

PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "sympy", "xarray", "zarr", "SALib", "robustness-harness")


def code_state() -> dict[str, str]:
    """Return what the bits of a score depend on beside the study: ``engine`` and ``versions`` of the packages."""
    versions = {"python": platform.python_version(), **{p: importlib.metadata.version(p) for p in PACKAGES}}
    return {"versions": json.dumps(versions), "engine": engine_hash()}


@functools.cache  # of the code that this process runs, whatever becomes of the files
def engine_hash() -> str:
    """Return a hash of what numbers depend on: models, committed networks, the harness but for report and CLI."""
    root = Path(__file__).resolve().parents[1]
    skipped = (
        *("harness/report", "harness/realtime", "harness/cli.py", "harness/cluster.py"),
        *("harness/run.py", "harness/statistics.py"),
    )
    digest = hashlib.sha256()
    for path in sorted(
        p for pattern in ("models/**/*.py", "harness/**/*.py", "harness/networks/*.npz") for p in root.glob(pattern)
    ):
        name = path.relative_to(root).as_posix()
        if not name.startswith(skipped):
            digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def commit() -> str:
    """Return the commit of the checkout, marked if there are changes, or ``unknown`` outside one."""
    head, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain")
    return "unknown" if head is None else head + (" with changes" if changes else "")


def _git(*arguments: str) -> str | None:
    here = Path(__file__).resolve().parents[1]
    try:
        done = subprocess.run(["git", "-C", here, *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def processor() -> str:
    """Return the name of the processor, for the record of a result."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"
