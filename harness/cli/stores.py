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
    from harness.config import Study
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

    def find() -> Study:
        return study_of(folder) if study is None else load_study(study_path(study))

    found = check(folder, find, sample, seed)
    console = Console()

    def say(words: str, style: str = "") -> None:
        console.print(Text(words, style=style), soft_wrap=True)

    if found.lost:
        raise WorkError(_lost(found.lost))
    say(f"{found.files:,} files: all as they were written", "green")
    if found.other_code:
        say(f"note: it {found.other_code}; bits may differ for that reason", "yellow")
    if found.differing:
        raise WorkError("\n".join(found.differing))
    if sample:
        count = f"{len(found.recomputed)} of {found.finished:,} finished units ({found.runs:,} runs)"
        say(f"{count} computed again: the same bits", "green")


def status(folder: FolderArgument) -> None:
    """Say how far a study is: done, diverged, lost and to come, who is at work, rate and time left."""
    from harness.study.plan import in_time
    from harness.study.progress import progress

    found, console = progress(folder), Console()
    missing = found.planned - found.done
    console.print(
        Text(f"study '{found.name}': {found.done:,} of {found.planned:,} runs done, {missing:,} missing", style="bold"),
        soft_wrap=True,
    )
    table = Table("design", "estimator", "done", "estimator diverged", "out of control", "missing", box=None)
    for count in found.counts:
        numbers = (count.done, count.diverged, count.plant_left, count.planned - count.done)
        table.add_row(count.design, count.estimator, *(f"{n:,}" for n in numbers))
    console.print(table)
    if found.lost:
        console.print(Text(_lost(found.lost), style="red"), soft_wrap=True)
    for sentence in found.beside:
        console.print(Text(sentence, style="red"), soft_wrap=True)
    if found.writer is None:
        console.print("nobody is at work" + ("; 'harness run' goes on with it" if missing else ""))
        return
    speed = f"{found.rate:,.1f} runs/s, {in_time(found.left)} left" if found.rate and found.left is not None else ""
    console.print(Text(f"at work: {found.writer}{'; ' + speed if speed else ''}"), soft_wrap=True)


def _lost(faults: Sequence[Fault]) -> str:
    """Return the files that are lost, one per line, and the remedy."""
    more = len(faults) - _SHOWN
    shown = [str(fault) for fault in faults[:_SHOWN]] + ([f"and {more} more"] if more > 0 else [])
    return "\n".join([*shown, "'harness run' with its study computes what is lost again, and nothing else"])
