"""Plant faults, check, and score what was named and whether the mended map passes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from bench.recording_faults import drives
from bench.recording_faults.drives import Drive
from bench.recording_faults.planted import Planted, planted
from harness.recordings.check import Findings, check_tables
from harness.recordings.consistency import DISAGREES

CLEAN = "nothing planted"


@dataclass(frozen=True)
class Scored:
    """One check.

    Attributes:
        drive, kind: Which drive, and what was planted in it.
        measured: Whether the drive is a measured one.
        size: Of the fault.
        named: Whether it was named first: its kind and its signal.
        listed: Whether it was named, or stated as an alternative.
        passes: Whether nothing disagrees with the mended map that did not before.
        further: Findings beyond what was planted and what the drive had before.
        found: What was said.
        seconds: It took.
    """

    drive: str
    kind: str
    measured: bool
    size: float
    named: bool
    listed: bool
    passes: bool
    further: int
    found: tuple[str, ...]
    seconds: float


def check_drive(drive: Drive) -> tuple[Findings, float]:
    """Check a drive; a warning of NumPy is an error."""
    begin = perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = check_tables(drive.tables, drive.name, drive.mapping)
    return found, perf_counter() - begin


def _keys(found: Findings) -> set[tuple[str, tuple[str, ...]]]:
    return {(f.kind, tuple(sorted(f.signals))) for f in found.found}


def _names(fault: Planted, kind: str, signals: Sequence[str]) -> bool:
    meant = set(fault.signals)
    return kind in fault.named and (not meant or bool(meant & set(signals)))


def scored(drive: Drive, clean: Findings, fault: Planted, measured: bool) -> Scored:
    """Plant one fault in a drive and score the check; one that ends without an answer has named nothing."""
    try:
        found, seconds = check_drive(fault.into(drive))
    except Exception as error:
        said = (f"ended without an answer: {type(error).__name__}: {error}",)
        return Scored(drive.name, fault.kind, measured, fault.size, False, False, False, 0, said, np.nan)
    before = _keys(clean)
    named = any(_names(fault, f.kind, f.signals) for f in found.found)
    others = [f for h in found.examination.hypotheses[1:] for f in h.faults]
    alternatives = named or any(_names(fault, f.kind, f.signals) for f in others)
    wrong = {f.name for f in (found.remedy.fits if found.remedy else found.fits) if f.verdict == DISAGREES}
    passes = not wrong - {f.name for f in clean.fits if f.verdict == DISAGREES}
    if fault.named == ("still",):  # nothing mends a channel that is dead
        passes = True
    further = [
        f
        for f in found.found
        if (f.kind, tuple(sorted(f.signals))) not in before
        and not _names(fault, f.kind, f.signals)
        and f.kind not in fault.also
    ]
    return Scored(drive.name, fault.kind, measured, fault.size, named, alternatives, passes, len(further),
                  tuple(map(str, found.found)), seconds)  # fmt: skip


def score_drive(make: Callable[[], Drive], seed: int, measured: bool) -> list[Scored]:
    """Check a drive as it is, and with every fault that it can show."""
    drive = make()
    clean, seconds = check_drive(drive)
    silent = not clean.found
    found = [Scored(drive.name, CLEAN, measured, 0.0, silent, silent, silent, len(clean.found),
                    tuple(map(str, clean.found)), seconds)]  # fmt: skip
    return found + [scored(drive, clean, f, measured) for f in planted(drive, np.random.default_rng([seed, 7]))]


def _simulated(task: tuple[str, int]) -> list[Scored]:
    vehicle, seed = task
    return score_drive(lambda: getattr(drives, vehicle)(seed), seed, False)


def _measured(number: int) -> list[Scored]:
    return score_drive(drives.measured()[number], number, True)


def run(seeds: Iterable[int], jobs: int, with_measured: bool = True) -> Iterable[list[Scored]]:
    """Check drives of every vehicle for every seed, and the measured ones that are there; yields drive by drive."""
    tasks = [(v, s) for s in seeds for v in ("car", "semitrailer")]
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_simulated, tasks)
        if with_measured:
            yield from pool.map(_measured, range(len(drives.measured())))


def save(found: Sequence[Scored], path: Path) -> None:
    """Keep every check as a line of JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(json.dumps(asdict(s), ensure_ascii=False) + "\n" for s in found), encoding="utf-8")
