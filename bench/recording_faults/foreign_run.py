"""Score ``harness check`` on foreign drives: what it names, what it says beyond that, and what its intervals hold."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from bench.recording_faults.foreign import PLANTED, STYLES, Fault, draw
from harness.recordings.check.examine import Finding
from harness.recordings.check.run import check_tables

NAMED, RIVAL, SILENT, WRONG = "named", "a rival", "not stated", "misnamed"
_INTERVAL = 1.96
"""Standard errors of an interval of 95 %."""


@dataclass(frozen=True)
class ForeignScore:
    """One check of a foreign drive.

    Attributes:
        seed, planted, style: Which drive.
        words: Rates, clocks, and what was planted.
        outcomes: Of every fault ``NAMED``; ``RIVAL``, stated as what may be in place of what is named; ``SILENT``; or
            ``WRONG``, its signals were said to have another one.
        false: What was said beyond what was planted.
        away: How many standard errors every stated value is from what was planted.
        said: All findings.
    """

    seed: int
    planted: str
    style: str
    words: str
    outcomes: tuple[str, ...]
    false: tuple[str, ...]
    away: tuple[float, ...]
    said: tuple[str, ...]


def score(task: tuple[int, str]) -> ForeignScore:
    """Draw one drive, check it, and score what was said."""
    seed, planted = task
    drive = draw(seed, planted)
    words = "; ".join([drive.words, *(f"{f.kind} of {', '.join(f.signals)} {f.size:.4g}" for f in drive.faults)])
    try:
        result = list(check_tables(drive.tables, f"foreign {seed}", drive.mapping).findings)
    except Exception as error:
        said = f"ended without an answer: {type(error).__name__}: {error}"
        return ForeignScore(seed, planted, drive.style, words, (WRONG,) * len(drive.faults), (said,), (), (said,))
    outcomes, away = [], []
    explained: list[Finding] = []
    for fault in drive.faults:
        by = [f for f in result if _names(fault, f)]
        by_rival = [f for f in result if f.kind == fault.kind and set(fault.signals) in map(set, f.rivals)]
        about = [f for f in result if set(f.signals) & set(fault.signals) and f not in explained]
        wrong = about and not _others(about, drive.faults, fault)
        outcomes.append(NAMED if by else RIVAL if by_rival else WRONG if wrong else SILENT)
        explained += by[:1] or by_rival[:1]
        away += [abs(f.value - fault.size) / f.std for f in by[:1] if np.isfinite(f.std)]
    false = tuple(str(f) for f in result if f not in explained)
    said = tuple(map(str, result))
    return ForeignScore(seed, planted, drive.style, words, tuple(outcomes), false, tuple(away), said)


def _names(fault: Fault, finding: Finding) -> bool:
    """Tell whether a finding is a fault: its kind and exactly its signals."""
    return finding.kind == fault.kind and set(finding.signals) == set(fault.signals)


def _others(about: Sequence[Finding], faults: Sequence[Fault], fault: Fault) -> bool:
    """Tell whether all that is said of some signals is another fault's."""
    return all(any(_names(other, f) for other in faults if other is not fault) for f in about)


def run(seeds: Sequence[int], jobs: int, path: Path) -> Iterator[ForeignScore]:
    """Check every kind of drive for every seed; what the file holds is not done again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    there = _kept(path)
    path.write_text("".join(json.dumps(asdict(s)) + "\n" for s in there), encoding="utf-8")
    done = {(s.seed, s.planted) for s in there}
    yield from (s for s in there if s.seed in seeds)
    tasks = [(seed, planted) for seed in seeds for planted in PLANTED if (seed, planted) not in done]
    with ProcessPoolExecutor(jobs) as pool, path.open("a", encoding="utf-8") as file:
        for each in pool.map(score, tasks):
            file.write(json.dumps(asdict(each)) + "\n")
            file.flush()
            yield each


def _kept(path: Path) -> list[ForeignScore]:
    """Return the checks that a file holds; a line that an interruption cut off is none."""
    result = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        try:
            result.append(
                ForeignScore(**{k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(line).items()})
            )
        except json.JSONDecodeError:
            continue
    return result


def table(scores: Sequence[ForeignScore]) -> str:
    """Return the table of docs/tables/check.md: a row per style and what was planted."""
    rows = [
        "| driven | planted | drives | all named | named or a rival | not stated | misnamed | a false finding |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for style in STYLES:
        for planted in PLANTED:
            own = [s for s in scores if s.style == style and s.planted == planted]
            named = sum(bool(s.outcomes) and set(s.outcomes) == {NAMED} for s in own)
            either = sum(bool(s.outcomes) and set(s.outcomes) <= {NAMED, RIVAL} for s in own)
            silent = sum(SILENT in s.outcomes and WRONG not in s.outcomes for s in own)
            counts = [
                len(own),
                named,
                either,
                silent,
                sum(WRONG in s.outcomes for s in own),
                sum(bool(s.false) for s in own),
            ]
            cells = [str(n) for n in counts] if planted != "nothing" else [str(len(own)), *[""] * 4, str(counts[-1])]
            rows.append(f"| {style} | {planted} | {' | '.join(cells)} |")
    return "\n".join(rows)


def coverage(scores: Sequence[ForeignScore]) -> str:
    """Say how many stated intervals of 95 % hold what was planted."""
    away = np.array([a for s in scores for a in s.away])
    inside = int((away < _INTERVAL).sum())
    return f"{inside} of {len(away)} stated intervals of 95 % hold the planted value ({inside / max(len(away), 1):.1%})"
