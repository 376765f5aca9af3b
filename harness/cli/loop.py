"""``harness loop``: a loop file, traced, with the published model beside the fitted ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import JobsOption
from harness.common.stages import showing


def loop(
    file: Annotated[Path, typer.Argument(help="Loop file, such as studies/loops/genesis.toml.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results; results/loop-<name> if absent.")
    ] = None,
    jobs: JobsOption = None,
) -> None:
    """Trace what a model lacks in the drives that a loop file names.

    Writes what harness trace does, and loop.json: each held-out drive with the published, the refitted and the
    amended model. Where the folder of the recordings is absent the loop is skipped.
    """
    from harness.cli.options import RESULTS
    from harness.diagnosis.measured_study import trace_study
    from harness.identification.measured_file import MeasuredStudy

    study = MeasuredStudy.read(file)
    if study.absent:
        Console().print(Text(study.absent), soft_wrap=True)
        return
    folder, console = out if out is not None else RESULTS / f"loop-{file.stem}", Console(stderr=True)
    with showing(console, "reading the recordings"):
        drives = study.drives()
    answers = trace_study(study, drives, folder, jobs, console)
    for answer in answers:
        Console().print(Text(answer, style="bold"), soft_wrap=True)
    Console().print(Text(str(folder / "report.html")), soft_wrap=True)
