"""``harness realtime``: how long a step of each estimator takes on one core, against the cycle of a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.common.stages import showing

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
