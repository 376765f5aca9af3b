"""The commands ``harness verify`` and ``harness status``: what a result folder holds, and whether it is whole."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.cli.options import place, study_path
from harness.common.errors import WorkError

if TYPE_CHECKING:
    from harness.config import StudySpec
    from harness.study.checksums import Fault

_SHOWN = 20
"""Files that are listed; of the others it is told how many there are."""

FolderArgument = Annotated[Path, typer.Argument(parser=place, help="Result folder of a study, or its URL.")]


def verify(
    folder: FolderArgument,
    study: Annotated[
        str | None,
        typer.Option("--study", help="Study of the result; the one that the result keeps if absent."),
    ] = None,
    sample: Annotated[
        int, typer.Option("--sample", min=0, help="How many units to compute again and compare bit for bit.")
    ] = 3,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Of the draw of these units; random if absent.")
    ] = None,
) -> None:
    """Check a result: every file against its checksum, and some units computed again.

    Exit status 1 if a file is lost or a score differs.
    """
    from harness.config import load_study
    from harness.study.stored import study_of
    from harness.study.verify import verify as check

    def find() -> StudySpec:
        return study_of(folder) if study is None else load_study(study_path(study))

    verification = check(folder, find, sample, seed)
    console = Console()

    def say(words: str, style: str = "") -> None:
        console.print(Text(words, style=style), soft_wrap=True)

    if verification.lost:
        raise WorkError(_lost(verification.lost))
    say(f"{verification.files:,} files: all as they were written", "green")
    if verification.other_code:
        say(f"note: it {verification.other_code}; bits may differ for that reason", "yellow")
    if verification.differing:
        raise WorkError("\n".join(verification.differing))
    if sample:
        count = (
            f"{len(verification.recomputed)} of {verification.finished:,} finished units ({verification.runs:,} runs)"
        )
        say(f"{count} computed again: the same bits", "green")


def status(folder: FolderArgument) -> None:
    """Say how far a study is: done, diverged, lost and to come, who is at work, rate and time left."""
    from harness.study.plan import in_time
    from harness.study.progress import progress

    state, console = progress(folder), Console()
    missing = state.planned - state.done
    console.print(
        Text(f"study '{state.name}': {state.done:,} of {state.planned:,} runs done, {missing:,} missing", style="bold"),
        soft_wrap=True,
    )
    table = Table("design", "estimator", "done", "estimator diverged", "out of control", "missing", box=None)
    for count in state.counts:
        numbers = (count.done, count.diverged, count.plant_left, count.planned - count.done)
        table.add_row(count.design, count.estimator, *(f"{n:,}" for n in numbers))
    console.print(table)
    if state.lost:
        console.print(Text(_lost(state.lost), style="red"), soft_wrap=True)
    for sentence in state.beside:
        console.print(Text(sentence, style="red"), soft_wrap=True)
    if state.writer is None:
        console.print("nobody is at work" + ("; 'harness run' goes on with it" if missing else ""))
        return
    speed = f"{state.rate:,.1f} runs/s, {in_time(state.left)} left" if state.rate and state.left is not None else ""
    console.print(Text(f"at work: {state.writer}{'; ' + speed if speed else ''}"), soft_wrap=True)


def _lost(faults: Sequence[Fault]) -> str:
    """Return the files that are lost, one per line, and the remedy."""
    more = len(faults) - _SHOWN
    shown = [str(fault) for fault in faults[:_SHOWN]] + ([f"and {more} more"] if more > 0 else [])
    return "\n".join([*shown, "'harness run' with its study computes what is lost again, and nothing else"])
