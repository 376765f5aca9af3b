"""``harness realtime``: how long a step of each estimator takes on one core, against the cycle of a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

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
    from harness.cli.options import RESULTS, quantity, study_path
    from harness.config import load_study
    from harness.realtime.measure import contestants, measure
    from harness.realtime.outcome import judge, write
    from harness.realtime.report import answer, report
    from harness.reporting.hooks import first_page

    seconds = quantity(duration, "s", "--duration")
    loaded = load_study(study_path(study))
    chosen, cycle = drive if drive is not None else loaded.drives[0].name, loaded.belief.step
    console = Console()
    with showing(console, "building models and drives") as show:
        field = contestants(loaded, chosen, seconds)
        times = measure(field, round(seconds / cycle) + 1, cycle, show)
        outcome = judge(times, loaded, chosen)
        folder = out if out is not None else RESULTS / f"realtime-{loaded.name}"
        write(outcome, folder)
        show("writing the report")
        paths = report(outcome, first_page("times", outcome, folder)).write(folder)
    console.print(Text(answer(outcome), style="bold"), soft_wrap=True)
    for path in paths:
        console.print(Text(str(path)), soft_wrap=True)
