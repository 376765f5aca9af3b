"""Cases traced with one number of ``harness/diagnosis/criteria.py`` replaced.

``python -m bench.attribution.changed_criteria MOST:doubled FOLDER...`` is a process of its own: the number is replaced
before any other module of the harness is imported, so whatever takes it from there, as it is, as a default or as a part
of another constant, has the other value. Nothing in the harness knows of it. For each case a line of JSON is written.
"""

from __future__ import annotations

import json
import math
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.diagnosis import criteria

STATED = "stated"
"""What nothing is replaced of."""

FOLDER = "changed"
"""Of the latest of these traces, in that of the case."""

FITS = "fits"
"""Folder in that of a case which keeps fits. A fit is found again by everything that decides it, so that it is the same
whichever number is changed, and most of the time of a trace is spent once."""


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {key: factor * v for key, v in value.items()}
    return tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value


def _odds(share: float, factor: float) -> float:
    odds = factor * share / (1.0 - share)
    return odds / (1.0 + odds)


def _below_one(value: float, factor: float) -> float:
    return 1.0 - factor * (1.0 - value)


def _count(value: int, factor: float) -> int:
    return math.ceil(factor * value)


def _decade(value: float, factor: float) -> float:
    return value * (10.0 if factor > 1.0 else 0.1)


HOW: dict[Callable[[Any, float], Any], tuple[str, tuple[str, ...]]] = {
    _times: (
        "the number itself, of a table or a list each of its numbers",
        (
            *("BIC_NEEDED", "HOPEFUL", "CALM", "ERROR_NEEDED", "EXCESS", "LITTLE", "FARTHER", "FURTHER_CHANGE"),
            *("HORIZONS", "BLOCK", "STRONG", "CORRELATED", "INDEPENDENT"),
            *(
                "PRIORS.odds",
                "PRIORS.stated",
                "PRIORS.length",
                "PRIORS.implausible",
                "PRIORS.beside_curves",
                "PRIORS.gain",
                "PRIORS.intensity",
                "PRIORS.likeness",
            ),
        ),
    ),
    _odds: ("the odds of a share", ("MOST",)),
    _below_one: ("the distance from one", ("SAME", "MASS", "PRIORS.misfit")),
    _count: ("a count, rounded up", ("TRIED", "ROUNDS", "DIFFERENCES")),
    _decade: ("a p-value by a decade", ("WHITE",)),
}
"""What is halved and doubled of a number, in words, and of which numbers; a field of a table stands behind a point."""

WAYS = {"halved": 0.5, "doubled": 2.0}


@dataclass(frozen=True)
class Change:
    """A number of the criteria with another value.

    Attributes:
        number: Name of the constant, or of a field of it behind a point.
        way: ``halved`` or ``doubled``.
        before: As stated.
        value: What it is then.
    """

    number: str
    way: str
    before: Any
    value: Any

    @property
    def label(self) -> str:
        """Name of the change on the command line and in the results."""
        return f"{self.number}:{self.way}"


def changes() -> list[Change]:
    """Return every number halved and doubled, in the order in which the criteria state them."""
    scaled = {number: scale for scale, (_, numbers) in HOW.items() for number in numbers}
    order = list(vars(criteria))
    stated = {n: _stated(n) for n in sorted(scaled, key=lambda n: order.index(n.partition(".")[0]))}
    return [Change(n, way, v, scaled[n](v, factor)) for n, v in stated.items() for way, factor in WAYS.items()]


def _stated(number: str) -> Any:
    constant, _, field = number.partition(".")
    value = getattr(criteria, constant)
    return getattr(value, field) if field else value


def make(change: Change) -> None:
    """Replace a number for the rest of this process.

    Raises:
        RuntimeError: If something that takes it from the criteria has been imported already.
    """
    taken = sorted(n for n in sys.modules if n.startswith(f"{criteria.__package__}.") and n != criteria.__name__)
    if taken:
        raise RuntimeError(f"{taken[0]} was imported before {change.number} was replaced")
    constant, _, field = change.number.partition(".")
    value = replace(getattr(criteria, constant), **{field: change.value}) if field else change.value
    setattr(criteria, constant, value)


def main(arguments: Sequence[str]) -> None:
    """Trace the cases of some folders, and write a line of each: its folder, and what went wrong, or nothing."""
    label, *folders = arguments
    if label != STATED:
        make({change.label: change for change in changes()}[label])
    trace = _tracing()
    for folder in map(Path, folders):
        print(json.dumps({"folder": str(folder), "problem": trace(folder)}), flush=True)


def _tracing() -> Callable[[Path], str]:
    """Return what traces a case, as ``run_trace`` does but with fits that stay; the harness is imported here."""
    from rich.console import Console
    from threadpoolctl import threadpool_limits

    from bench.attribution.run import Tracer
    from harness.common.failures import Failures
    from harness.diagnosis.fitting import KeptFits
    from harness.diagnosis.result.outcome import outcome_of
    from harness.diagnosis.result.record import write_outcome
    from harness.diagnosis.run import drives_of
    from harness.diagnosis.selection.forward_selection import trace

    tracer = Tracer(threads=1)

    def traced(folder: Path) -> str:
        """Trace a case, and return the traceback of what ended it, or nothing."""
        written = folder / FOLDER
        (written / "trace.json").unlink(missing_ok=True)
        try:
            with threadpool_limits(1):
                failures = Failures(written, Console(quiet=True))
                task, augmented = tracer.model(folder)
                drives = drives_of(task, augmented)
                kept = KeptFits(folder / FITS)
                judged = trace(augmented, *drives, task.free, rounds=task.rounds, failures=failures, kept=kept)
                write_outcome(outcome_of(judged, failures=failures), written)
        except Exception:  # a trace that ends in an error is a wrong answer, and the others go on
            return traceback.format_exc()
        return ""

    return traced


if __name__ == "__main__":
    main(sys.argv[1:])
