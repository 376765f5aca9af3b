"""Faults that strike a job: each function does so once and returns what it did; the job then runs again to its end."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from bench.faults.jobs import Job
from harness.common.errors import UserError
from harness.study.results import read

Fault = Callable[[Job, Path, random.Random], str]
"""Takes the job, its finished reference and a source of random numbers."""


class Unexpected(Exception):
    """A fault had an effect that it must not have."""


def _units(job: Job) -> int:
    """Return how many units of a study are finished."""
    return sum(1 for p in job.out.glob("scores.zarr/checksums/*/c/**/*") if p.is_file())


def _wait(job: Job, reference: Path, process: subprocess.Popen[str], random: random.Random) -> str:
    """Wait for a random moment of the job's work, and return which."""
    whole = sum(1 for p in reference.glob("scores.zarr/checksums/*/c/**/*") if p.is_file())
    if whole:
        wanted = random.randrange(whole)
        while process.poll() is None and _units(job) < wanted:
            time.sleep(0.005)
        time.sleep(random.uniform(0.0, 0.05))
        return f"after {_units(job)} of {whole} units"
    took = float((reference / "seconds").read_text())
    moment = random.uniform(0.1, 0.95) * took
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(moment)
    return f"after {moment:.1f} of {took:.1f} s"


def killed(job: Job, reference: Path, random: random.Random) -> str:
    """Kill the runner, and all that it has started."""
    process = job.start()
    when = _wait(job, reference, process, random)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    return f"killed with -9 {when}"


def interrupted(job: Job, reference: Path, random: random.Random) -> str:
    """Press Ctrl-C; nothing half finished stays, and no lock."""
    process = job.start()
    when = _wait(job, reference, process, random)
    process.send_signal(signal.SIGINT)
    said = process.communicate()[1]
    halves = [p.name for p in job.out.rglob("*") if p.suffix in (".part", ".partial", ".new", ".lock")]
    if process.returncode not in (0, 130, -signal.SIGINT) or "Traceback" in said or halves:
        raise Unexpected(f"Ctrl-C ended with {process.returncode}, {halves}: {said[-300:]}")
    return f"interrupted {when}"


def suspended(job: Job, reference: Path, random: random.Random) -> str:
    """Suspend the runner for a moment and let it go on."""
    process = job.start()
    when = _wait(job, reference, process, random)
    process.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    process.send_signal(signal.SIGCONT)
    if process.wait() and process.stderr is not None:
        raise Unexpected(f"ended with {process.returncode}: {process.stderr.read()[-300:]}")
    return f"suspended and continued {when}"


def disk_full(job: Job, reference: Path, random: random.Random) -> str:
    """Let the disk be full after a random number of files."""
    count = sum(1 for p in reference.rglob("*") if p.is_file())
    files = random.randrange(count)
    process = job.start(f"full:{files}")
    said = process.communicate()[1]
    if process.returncode == 0 and files < count // 2:
        raise Unexpected("a full disk went unnoticed")
    if "Traceback" in said or process.returncode not in (0, 1, 2):
        raise Unexpected(f"a full disk ended with {process.returncode}: {said[-300:]}")
    return f"disk full after {files} files"


def clock_jumps(job: Job, reference: Path, random: random.Random) -> str:
    """Let the clock jump all the time."""
    process = job.start(f"clock:{random.randrange(1000)}")
    said = process.communicate()[1]
    if process.returncode:
        raise Unexpected(f"ended with {process.returncode}: {said[-300:]}")
    return "clock jumping by up to a day"


def two_runners(job: Job, reference: Path, random: random.Random) -> str:
    """Start a second runner on the same folder."""
    first = job.start()
    when = _wait(job, reference, first, random)
    second = job.start()
    said = second.communicate()[1]
    if first.poll() is None and (second.returncode != 2 or "being written by another process" not in said):
        raise Unexpected(f"the second runner ended with {second.returncode}: {said[-300:]}")
    if first.wait() and first.stderr is not None:
        raise Unexpected(f"the first runner ended with {first.returncode}: {first.stderr.read()[-300:]}")
    return f"a second runner {when}"


def _finished_copy(job: Job, reference: Path) -> list[Path]:
    """Put the finished reference into the folder and return the files of its store."""
    job.clear()
    shutil.copytree(reference, job.out)
    (job.out / "seconds").unlink()
    return sorted(p for p in (job.out / "scores.zarr").rglob("*") if p.is_file())


def _must_be_refused(job: Job, file: Path) -> None:
    try:
        read(job.out)
    except UserError as error:
        if len(str(error).splitlines()) != 1 or "'harness run'" not in str(error):
            raise Unexpected(f"{file} lost, and the message is {error}") from None
    else:
        raise Unexpected(f"{file} lost, and nobody noticed")


def truncated(job: Job, reference: Path, random: random.Random) -> str:
    """Cut a file of the finished store."""
    file = random.choice(_finished_copy(job, reference))
    with file.open("rb+") as stream:
        stream.truncate(random.randrange(file.stat().st_size))
    _must_be_refused(job, file)
    return f"{file.relative_to(job.out)} cut"


def flipped(job: Job, reference: Path, random: random.Random) -> str:
    """Flip a bit of a chunk of the finished store."""
    file = random.choice([p for p in _finished_copy(job, reference) if p.name != "zarr.json"])
    content = bytearray(file.read_bytes())
    content[random.randrange(len(content))] ^= 1 << random.randrange(8)
    file.write_bytes(content)
    _must_be_refused(job, file)
    return f"a bit of {file.relative_to(job.out)} flipped"


def deleted(job: Job, reference: Path, random: random.Random) -> str:
    """Delete a file of the finished store."""
    file = random.choice(_finished_copy(job, reference))
    file.unlink()
    _must_be_refused(job, file)
    return f"{file.relative_to(job.out)} deleted"


def array_deleted(job: Job, reference: Path, random: random.Random) -> str:
    """Delete a whole array or group of the finished store."""
    folders = sorted({p.parent for p in _finished_copy(job, reference) if p.name == "zarr.json"})
    folder = random.choice(folders[1:])
    shutil.rmtree(folder)
    _must_be_refused(job, folder)
    return f"{folder.relative_to(job.out)} deleted"


def linked(job: Job, reference: Path, random: random.Random) -> str:
    """Put a link out of the folder, or a pipe, in the place of something in the finished store; it is not followed."""
    whole = _finished_copy(job, reference)
    place = random.choice(sorted({*whole, *(p.parent for p in whole), job.out / "run.lock", job.out / "run.json"}))
    elsewhere, is_pipe = job.out.with_name("elsewhere"), random.random() < 0.5
    shutil.rmtree(elsewhere, ignore_errors=True)
    elsewhere.mkdir()
    is_folder = place.is_dir()
    shutil.rmtree(place) if is_folder else place.unlink(missing_ok=True)
    os.mkfifo(place) if is_pipe else place.symlink_to(elsewhere if is_folder else elsewhere / "file")
    said = job.finish()
    if any(elsewhere.iterdir()):
        raise Unexpected(f"{place} led elsewhere")
    if place.name != "run.json" and ("remove it" not in said or str(place) not in said):
        raise Unexpected(f"{place} is a link or a pipe, and the message is '{said}'")
    place.unlink()  # as the message says
    return f"{place.relative_to(job.out)} {'a pipe' if is_pipe else 'a link'}"


def other_format(job: Job, reference: Path, random: random.Random) -> str:
    """Say in the metadata of an array or a group of the finished store that it is of another version of Zarr."""
    file = random.choice([p for p in _finished_copy(job, reference) if p.name == "zarr.json"][1:])
    file.write_text(file.read_text().replace('"zarr_format": 3', '"zarr_format": 2'))
    _must_be_refused(job, file)
    return f"{file.relative_to(job.out)} of version 2"


def worker_killed(job: Job, reference: Path, random: random.Random) -> str:
    """Kill a worker process of a local Dask cluster; the run must get over it."""
    process = job.start(further=("dask",))
    when = _wait(job, reference, process, random)
    below = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    workers = [p for p in below if not p.children() and "spawn_main" in " ".join(p.cmdline())]
    if workers:
        random.choice(workers).kill()
    said = process.communicate()[1]
    if process.returncode:
        raise Unexpected(f"a lost worker ended the run with {process.returncode}: {said[-300:]}")
    return f"a Dask worker killed with -9 {when}"


def scheduler_killed(job: Job, reference: Path, random: random.Random) -> str:
    """Kill the scheduler of a Dask cluster."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    address = f"tcp://127.0.0.1:{port}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), str(Path.cwd() / "tests")])}
    dask = [sys.executable, "-m", "dask"]
    words = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", *words], **quiet)  # type: ignore[call-overload]
    worker = subprocess.Popen([*dask, "worker", address, "--nthreads", "2", "--no-dashboard"], env=environment, **quiet)  # type: ignore[call-overload]
    try:
        process = job.start(further=("scheduler", address))
        when = _wait(job, reference, process, random)
        os.killpg(scheduler.pid, signal.SIGKILL)
        said = process.communicate()[1]
    finally:
        for each in (scheduler, worker):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(each.pid, signal.SIGKILL)
            each.wait()
    if process.returncode not in (0, 1) or "Traceback" in said:
        raise Unexpected(f"a lost scheduler ended the run with {process.returncode}: {said[-300:]}")
    return f"the Dask scheduler killed with -9 {when}"


PLAN: dict[str, dict[Fault, int]] = {
    "study": {
        killed: 8, interrupted: 2, suspended: 2, disk_full: 4, clock_jumps: 2, two_runners: 2, truncated: 4,
        flipped: 4, deleted: 4, array_deleted: 3, linked: 6, other_format: 2, worker_killed: 2, scheduler_killed: 2,
    },
    "campaign": {killed: 2, interrupted: 1, disk_full: 1},
    "identify": {killed: 2, interrupted: 1, disk_full: 1, suspended: 1},
    "tune": {killed: 2, interrupted: 1, disk_full: 1},
    "trace": {killed: 10, interrupted: 1, clock_jumps: 1, disk_full: 1},
    "remedy": {killed: 10, interrupted: 1, clock_jumps: 1, disk_full: 1},
}  # fmt: skip
"""How often each job is struck by what."""

SHORT: dict[str, dict[Fault, int]] = {
    "study": {killed: 1, disk_full: 1, two_runners: 1, flipped: 1, array_deleted: 1, linked: 2},
}
"""The short form, for the tests."""
