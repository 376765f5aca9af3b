"""The command ``harness export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

DURATION = "20 s"


def export(
    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")],
    estimator: Annotated[
        str | None,
        typer.Option("--estimator", "-e", help="Name of an estimator of the study; the first if absent."),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            help="Parameter file that it believes in place of the study's belief: belief.toml of harness remedy, "
            "amended.toml of harness trace.",
        ),
    ] = None,
    precision: Annotated[
        Literal["double", "float"], typer.Option("--precision", help="Of the numbers in C.")
    ] = "double",
    name: Annotated[
        str | None,
        typer.Option("--name", help="What everything in C begins with; names of study and estimator if absent."),
    ] = None,
    drive: Annotated[
        str | None,
        typer.Option(
            "--drive", help="Drive of the run that is recorded for the test; the first of the study if absent."
        ),
    ] = None,
    duration: Annotated[
        str, typer.Option("--duration", help='How much of the drive is recorded: 20 or "20 s".')
    ] = DURATION,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; results/export-<name in C> if absent.")
    ] = None,
) -> None:
    """Print an estimator of a study as C99, with a test that replays a recorded run.

    It is printed from the kernels that the study runs. The folder builds by itself, with make or CMake; its library
    takes part in studies as an external estimator.
    """
    from harness.api.export import export_estimator
    from harness.api.study import read_study
    from harness.cli.options import RESULTS, printed, quantity, study_path

    seconds = quantity(duration, "s", "--duration")
    exported = export_estimator(
        read_study(study_path(study)),
        estimator,
        parameters=parameters,
        precision=precision,
        name=name,
        drive=drive,
        duration=seconds,
    )
    files = exported.write(RESULTS / f"export-{exported.name}" if out is None else out)
    printed(exported.answer, files)
