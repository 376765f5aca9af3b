"""Plant faults, check, and score what was named and whether the mended map passes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path
from time import perf_counter

import numpy as np

from bench.recording_faults import drives
from bench.recording_faults.drives import Drive
from bench.recording_faults.planted import Planted, planted
from harness.recordings.check.run import CheckResult, check_tables
from harness.recordings.motion.consistency import DISAGREES

CLEAN = "nothing planted"
Key = tuple[str, str, tuple[str, ...]]
"""Drive, kind and signals of a check."""


@dataclass(frozen=True)
class Scored:
    """One check.

    Attributes:
        drive, kind: Which drive, and what was planted in it.
        signals: Of which any one names it.
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
    signals: tuple[str, ...]
    measured: bool
    size: float
    named: bool
    listed: bool
    passes: bool
    further: int
    found: tuple[str, ...]
    seconds: float


def check_drive(drive: Drive) -> tuple[CheckResult, float]:
    """Check a drive; a warning of NumPy is an error."""
    begin = perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = check_tables(drive.tables, drive.name, drive.mapping)
    return result, perf_counter() - begin


def _keys(result: CheckResult) -> set[tuple[str, tuple[str, ...]]]:
    return {(f.kind, tuple(sorted(f.signals))) for f in result.findings}


def _names(fault: Planted, kind: str, signals: Sequence[str]) -> bool:
    meant = set(fault.signals)
    return kind in fault.named and (not meant or bool(meant & set(signals)))


def scored(drive: Drive, clean: CheckResult, fault: Planted, measured: bool) -> Scored:
    """Plant one fault in a drive and score the check; one that ends without an answer has named nothing."""
    try:
        result, seconds = check_drive(fault.into(drive))
    except Exception as error:
        said = (f"ended without an answer: {type(error).__name__}: {error}",)
        return Scored(drive.name, fault.kind, fault.signals, measured, fault.size, False, False, False, 0, said, np.nan)
    before = _keys(clean)
    named = any(_names(fault, f.kind, f.signals) for f in result.findings)
    others = [f for h in result.examination.hypotheses[1:] for f in h.faults]
    alternatives = named or any(_names(fault, f.kind, f.signals) for f in others)
    wrong = {f.name for f in (result.remedy.fits if result.remedy else result.fits) if f.verdict == DISAGREES}
    passes = not wrong - {f.name for f in clean.fits if f.verdict == DISAGREES}
    if fault.named == ("still",):  # nothing mends a channel that is dead
        passes = True
    further = [
        f
        for f in result.findings
        if (f.kind, tuple(sorted(f.signals))) not in before
        and not _names(fault, f.kind, f.signals)
        and f.kind not in fault.also
    ]
    return Scored(drive.name, fault.kind, fault.signals, measured, fault.size, named, alternatives, passes,
                  len(further), tuple(map(str, result.findings)), seconds)  # fmt: skip


def score_drive(make: Callable[[], Drive], seed: int, measured: bool, there: Collection[Key] = ()) -> Iterator[Scored]:
    """Check a drive as it is and with every fault that it can show, but for what is there already; one by one."""
    drive = make()
    faults = planted(drive, np.random.default_rng([seed, 7]))
    faults = [f for f in faults if (drive.name, f.kind, f.signals) not in there]
    if not faults and (drive.name, CLEAN, ()) in there:
        return
    clean, seconds = check_drive(drive)
    if (drive.name, CLEAN, ()) not in there:
        silent = not clean.findings
        yield Scored(drive.name, CLEAN, (), measured, 0.0, silent, silent, silent, len(clean.findings),
                     tuple(map(str, clean.findings)), seconds)  # fmt: skip
    for fault in faults:
        yield scored(drive, clean, fault, measured)


def _check_all(task: tuple[str, int, Path, Sequence[Key]]) -> list[Scored]:
    """Check one drive and append every check to the file at once."""
    kind, number, path, there = task
    is_measured = kind == "measured"
    make = drives.measured()[number] if is_measured else partial(getattr(drives, kind), number)
    scores = []
    for each in score_drive(make, number, is_measured, there):
        scores.append(each)
        with path.open("a", encoding="utf-8") as file:
            file.write(line_of(each))
    return scores


def run(seeds: Iterable[int], jobs: int, path: Path, with_measured: bool = True) -> Iterator[list[Scored]]:
    """Check drives of every vehicle for every seed, and the measured ones that are there; yields drive by drive.

    Args:
        seeds: Of the simulated drives.
        jobs: Processes.
        path: File with a line for every check, appended to as soon as it is done; what it holds is not done again.
        with_measured: Whether measured drives are checked.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    there = kept(path)
    path.write_text("".join(map(line_of, there)), encoding="utf-8")
    keys = tuple((s.drive, s.kind, s.signals) for s in there)
    measured = [("measured", n) for n in range(len(drives.measured()) if with_measured else 0)]
    simulated = [(vehicle, seed) for seed in seeds for vehicle in ("car", "semitrailer")]
    by_turns = [t for pair in zip_longest(measured, simulated) for t in pair if t is not None]
    tasks = [(*task, path, keys) for task in by_turns]
    yield there
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_check_all, tasks)


def line_of(check: Scored) -> str:
    """Return a check as a line of the file."""
    return json.dumps(asdict(check), ensure_ascii=False) + "\n"


def kept(path: Path) -> list[Scored]:
    """Return the checks that a file holds; a line that an interruption cut off is none."""
    scores = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        scores.append(Scored(**{**row, "signals": tuple(row["signals"]), "found": tuple(row["found"])}))
    return scores
