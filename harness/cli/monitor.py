"""The command ``harness monitor``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.cli.options import MOST, pairs
from harness.common.stages import showing


def monitor(
    study: Annotated[str, typer.Argument(help="Study file, or the name of a study; harness list studies shows them.")],
    estimator: Annotated[
        str | None,
        typer.Option("--estimator", "-e", help="Name of an estimator of the study; the first if absent."),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--limit",
            metavar="TARGET=VALUE",
            help='Error of a target that matters: lateral_force_axle_21="2 kN"; limits of the study if absent.',
        ),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters", help="Parameter file that it believes in place of the study's belief, as of harness export."
        ),
    ] = None,
    window: Annotated[str, typer.Option("--window", help='Over which innovations are averaged: 2 or "2 s".')] = "2 s",
    false_alarms: Annotated[
        float, typer.Option("--false-alarms", min=0.01, help="An hour that are allowed where all is as believed.")
    ] = 1.0,
    within: Annotated[str, typer.Option("--within", help='In which an error has to be said: 3 or "3 s".')] = "3 s",
    runs: Annotated[
        int, typer.Option("--runs", min=1, max=MOST, help="Of each level and drive that are counted, at most.")
    ] = 40,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, max=MOST, help="Worker threads; all cores if absent.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Result folder; results/monitor-<study>_<estimator> if absent."),
    ] = None,
) -> None:
    """Count when an estimator says that it is not to be trusted, and write that monitor for harness export.

    Its bounds are those of a rate of false alarms, from runs as believed; its detections are counted at every level of
    the study's designs against the errors that matter.
    """
    from harness.api.monitor import count_monitor
    from harness.api.study import read_study
    from harness.cli.options import command, printed, quantity, study_path

    counted = count_monitor(
        read_study(study_path(study)),
        estimator,
        limits=pairs(limits, "--limit") or None,
        parameters=parameters,
        window=quantity(window, "s", "--window"),
        false_alarms=false_alarms,
        within=quantity(within, "s", "--within"),
        runs=runs,
        jobs=jobs,
    )
    with showing(Console(stderr=True), "writing the report"):
        files = counted.report(out, command())
    printed(counted.answer, files)
