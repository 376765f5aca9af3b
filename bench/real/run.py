"""One case of the realistic plants, traced by the command that an engineer would give.

Whatever is there already is kept, and the fits of an interrupted trace are, so a run goes on where it stopped.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

from bench.attribution.score import FAILED, SECONDS
from harness.common.files import write_files

TRACE = Path("trace") / "trace.json"
"""In a case's folder."""

ROLES = {
    "baseline": (("baseline", "monday"), ("baseline", "tuesday"), ("train", "today"), ("test", "today2")),
    "alone": (("train", "today"), ("train", "today_too"), ("test", "today2")),
}
"""Option of each drive, by design."""


def trace_command(folder: Path, threads: int | None = None) -> list[str]:
    """Return the command that traces what stands in a folder; the seal is not read."""
    design = "baseline" if (folder / "monday.csv").exists() else "alone"
    vehicle = json.loads((folder / "belief.json").read_text(encoding="utf-8"))["vehicle"]
    command = [sys.executable, "-m", "harness", "trace", "--model", vehicle]
    command += ["--parameters", str(folder / "nominal.toml"), "--channels", str(folder / "channels.toml")]
    for option, name in ROLES[design]:
        command += [f"--{option}", str(folder / f"{name}.csv")]
    command += ["--estimator", "", "--out", str((folder / TRACE).parent)]
    return [*command, *(["--jobs", str(threads)] if threads else [])]


def trace_case(folder: Path, threads: int | None = None) -> str:
    """Trace a case that was not traced; return what went wrong, or nothing.

    A trace that ends in an error is a wrong answer, so that is noted in the folder.

    Args:
        folder: Of the case.
        threads: Of the trace; all cores by default.
    """
    if (folder / TRACE).exists():
        return ""
    begun, whole = time.perf_counter(), not (folder / TRACE).parent.exists()
    done = subprocess.run(trace_command(folder, threads), capture_output=True, text=True, check=False)
    if not (folder / TRACE).exists():
        problem = done.stderr.strip() or f"harness trace ended with status {done.returncode} and no trace.json"
        write_files(folder, {FAILED: problem + "\n"})
        return problem.splitlines()[-1]
    (folder / FAILED).unlink(missing_ok=True)
    if whole:
        write_files(folder, {SECONDS: f"{time.perf_counter() - begun:.1f}\n"})
    return ""
