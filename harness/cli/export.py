"""The command ``harness export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.cli.declared import takes
from harness.common.errors import UserError

DURATION = "20 s"


@dataclass(frozen=True)
class ExportOptions:
    """An estimator or plant to print, and where to."""

    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")]
    estimator: Annotated[
        str | None,
        typer.Option("--estimator", "-e", help="Name of an estimator of the study; the first if absent."),
    ] = None
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            help="Parameter file that it believes in place of the study's belief: belief.toml of harness remedy, "
            "amended.toml of harness trace.",
        ),
    ] = None
    precision: Annotated[Literal["double", "float"], typer.Option("--precision", help="Of the numbers in C.")] = (
        "double"
    )
    name: Annotated[
        str | None,
        typer.Option("--name", help="What everything in C begins with; names of study and estimator if absent."),
    ] = None
    drive: Annotated[
        str | None,
        typer.Option(
            "--drive", help="Drive of the run that is recorded for the test; the first of the study if absent."
        ),
    ] = None
    duration: Annotated[str, typer.Option("--duration", help='How much of the drive is recorded: 20 or "20 s".')] = (
        DURATION
    )
    plant: Annotated[
        bool, typer.Option("--plant", help="The study's plant, or that of --parameters, in place of an estimator.")
    ] = False
    fmi: Annotated[
        Literal["2", "3"] | None,
        typer.Option("--fmi", help="An FMU for co-simulation as well, of this version of FMI."),
    ] = None
    monitor: Annotated[
        Path | None,
        typer.Option("--monitor", help="monitor.toml of harness monitor: the trust monitor is printed next to it."),
    ] = None
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder; results/export-<name in C> if absent.")] = (
        None
    )


@takes(ExportOptions)
def export(task: ExportOptions) -> None:
    """Print an estimator or the plant of a study as C99 and as an FMU.

    They are printed from the kernels that the study runs. The folder of an estimator builds by itself, with make or
    CMake, and has a test that replays a recorded run; its library takes part in studies as an external estimator. An
    FMU has the sources and the binary of this machine.
    """
    from harness.api.export import ExportedEstimator, ExportedPlant, export_estimator, export_plant
    from harness.api.study import read_study
    from harness.cli.options import RESULTS, printed, quantity, study_path

    version: Literal[2, 3] | None = None if task.fmi is None else 2 if task.fmi == "2" else 3
    exported: ExportedEstimator | ExportedPlant
    seconds = quantity(task.duration, "s", "--duration")
    of_an_estimator = {"--estimator": task.estimator, "--drive": task.drive, "--monitor": task.monitor}
    given = [option for option, value in of_an_estimator.items() if value is not None]
    if task.plant and given:
        raise UserError(f"--plant: has no {given[0]}; leave one of them out")
    read = read_study(study_path(task.study))
    if task.plant:
        exported = export_plant(read, parameters=task.parameters, precision=task.precision, name=task.name, fmi=version)
    else:
        exported = export_estimator(
            read,
            task.estimator,
            parameters=task.parameters,
            precision=task.precision,
            name=task.name,
            drive=task.drive,
            duration=seconds,
            fmi=version,
            monitor=task.monitor,
        )
    files = exported.write(RESULTS / f"export-{exported.name}" if task.out is None else task.out)
    printed(exported.answer, files)
