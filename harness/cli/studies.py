"""Commands on studies and their results: ``harness remedy``, ``realtime``, ``verify``, ``status`` and ``view``."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.cli.options import MOST, place, study_path
from harness.common.errors import UserError, WorkError
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.config import StudySpec
    from harness.study.checksums import Fault


def remedy(
    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")],
    estimator: Annotated[
        str | None, typer.Option("--estimator", "-e", help="Name of an estimator of the study; its EKF if absent.")
    ] = None,
    equipment: Annotated[
        int,
        typer.Option("--equipment", min=0, max=MOST, help="How many larger sets of sensors, those of most promise."),
    ] = 2,
    trace: Annotated[
        Path | None,
        typer.Option(
            "--trace",
            help="Folder that harness trace wrote: remedies where the vehicle has the named effect, the belief not.",
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, max=MOST, help="Worker threads; all cores if absent.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Result folder; results/remedy-<name of the study> if absent.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A first look: fewer drives, repeats and Sobol points.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Begin without asking what takes above an hour or 10 GB.")
    ] = False,
    restart: Annotated[bool, typer.Option("--restart", help="Throw away the results that are in the folder.")] = False,
) -> None:
    """Try what helps where a parameter is not as believed, and say which remedy is worth it.

    Estimate the parameters that drive the error, consider them, other noise, measure more, and together: on the very
    same points, drives and noise. With --trace the vehicle is the amended model, and remedies are those that need no
    model of the effect. What is finished is kept. Writes a report, belief.toml for studies and harness
    estimate, and study.toml.
    """
    from harness.api.remedy import try_remedies
    from harness.api.study import read_study
    from harness.cli.options import agree_to, command, printed, study_path

    remedies = try_remedies(
        read_study(study_path(study), quick),
        out,
        trace=trace,
        estimator=estimator,
        equipment=equipment,
        jobs=jobs,
        agree=None if yes else agree_to,
        restart=restart,
    )
    with showing(Console(stderr=True), "writing the report"):
        files = remedies.report(command())
    printed(remedies.answer, files)


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
    from harness.study.plan import in_time, progress

    state, console = progress(folder), Console()
    missing = state.planned - state.done
    console.print(
        Text(f"study '{state.name}': {state.done:,} of {state.planned:,} runs done, {missing:,} missing", style="bold"),
        soft_wrap=True,
    )
    lost = ["lost by the plant's code"] if any(count.lost for count in state.counts) else []
    table = Table("design", "estimator", "done", "estimator diverged", "out of control", *lost, "missing", box=None)
    for count in state.counts:
        of_code = [count.lost] if lost else []
        numbers = (count.done, count.diverged, count.plant_left, *of_code, count.planned - count.done)
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


DURATION = "30 s"
"""As Ziaukas 2023, Bild 6.9."""


def realtime(
    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")],
    drive: Annotated[
        str | None, typer.Option("--drive", help="Name of a drive of the study; its first one if absent.")
    ] = None,
    duration: Annotated[
        str, typer.Option("--duration", help='How much of the drive is timed: 30 or "30 s".')
    ] = DURATION,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Result folder; results/realtime-<name of the study> if absent.")
    ] = None,
) -> None:
    """Time single steps of every estimator of a study on one core.

    One run, one step per cycle as on a controller; the report compares load and ratios with the dissertation's.
    """
    from harness.api.realtime import time_steps
    from harness.api.study import read_study
    from harness.cli.options import printed, quantity, study_path

    seconds = quantity(duration, "s", "--duration")
    times = time_steps(read_study(study_path(study)), drive=drive, duration=seconds)
    with showing(Console(stderr=True), "writing the report"):
        paths = times.report(out)
    printed(times.answer, paths)


def view(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Result folder, a folder of several, or several studies."),
    ],
    study: Annotated[
        Path | None,
        typer.Option("--study", help="Study file of the result, if recordings or networks lie next to it."),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; a free one if absent.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Walk through results in the browser: a study, several side by side, a trace, an identification or a check.

    The page is for one browser on this machine: the address opens once. In a study
    a click on a box computes the run again from its seeds; nothing is written to the folder.
    """
    try:
        import bokeh  # noqa: F401
    except ImportError:
        raise UserError("harness view needs Bokeh: pip install 'robustness-harness[view]'") from None
    from harness.common.files import refuse_url
    from harness.view.pages import pages
    from harness.view.server import Page

    for folder in folders:
        refuse_url(folder)
    console = Console(stderr=True)
    with showing(console, "reading the results and building the models"):
        page = Page(pages(folders, study), port)
    Console().print(Text(page.address), soft_wrap=True)
    console.print("Ctrl-C ends it")
    if browser:
        webbrowser.open(page.address)
    try:
        page.serve()
    except KeyboardInterrupt:
        console.print("ended")
