"""``harness remedy``: what helps against parameters that are not as believed, tried on the runs of a study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.cli.options import MOST
from harness.common.stages import showing


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
