"""``harness next-drive``: the drives that tell most of what a result left open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.cli.declared import takes
from harness.cli.options import MOST, JobsOption, SeedOption, command, listed, pairs, printed, quantity
from harness.common.errors import UserError
from harness.common.stages import showing


@dataclass(frozen=True, kw_only=True)
class NextDriveOptions:
    """A result that left something open, and what may be driven."""

    result: Annotated[Path, typer.Argument(help="Folder of harness identify, trace or run.")]
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder of the drives and the report; RESULT/next-drive if absent."),
    ] = None
    wanted: Annotated[
        list[str] | None,
        typer.Option(
            "--for",
            metavar="NAME[=WEIGHT]",
            help="Parameters that count, with weights in the combination of c; the undetermined if absent. Of a trace "
            "effects whose detection limits count. Of a study targets and estimators, all if absent, and a design. "
            "Repeatable.",
        ),
    ] = None
    criterion: Annotated[
        Literal["D", "A", "c"],
        typer.Option(
            "--criterion", help="D: volume of the confidence ellipsoid; A: sum of variances; c: a combination."
        ),
    ] = "D"
    limits: Annotated[Path | None, typer.Option("--limits", help="TOML file with limits by name.")] = None
    single: Annotated[
        list[str] | None,
        typer.Option("--limit", metavar="NAME=VALUE", help='Limit, besides the file: road_width="12 m"; repeatable.'),
    ] = None
    budget: Annotated[str, typer.Option("--budget", help="Driving time, in s or with a unit.")] = "60 s"
    manoeuvres: Annotated[
        list[str] | None, typer.Option("--manoeuvre", help="Manoeuvre to choose from; all if absent; repeatable.")
    ] = None
    effort: Annotated[int, typer.Option("--effort", min=1, max=MOST, help="Drives that are tried of each.")] = 24
    sensors: Annotated[
        bool, typer.Option("--sensors", help="Also judge the drives with every set of sensors of the vehicle.")
    ] = False
    seed: SeedOption = 0
    jobs: JobsOption = None


@takes(NextDriveOptions)
def next_drive(task: NextDriveOptions) -> None:
    """Plan the drives that tell most of what an identification, a trace or a study left open.

    Of an identification they make the errors of parameters small, of a trace they tell the confusable models apart, of
    a study they make the errors of its estimators small.
    Manoeuvres of the standards, each with its free quantities, within the limits that are stated. Drives that some
    vehicle that is still possible would not survive within the limits are refused. Writes the drives for studies and
    for a steering robot, next_drive.json, and a report whose first page is for the driver.
    """
    from rich.console import Console
    from rich.text import Text

    from harness.experiment.files import once_driven
    from harness.experiment.kept_drives import TRIED
    from harness.experiment.limits import limits_of
    from harness.experiment.report import answer, limits_words, write_design
    from harness.experiment.run import DesignTask, design_drives
    from harness.identification.earlier_result import FOLDER

    out = task.out or task.result / FOLDER
    asked = DesignTask(
        task.result,
        _weights(task.wanted or ()),
        task.criterion,
        limits_of(task.limits, pairs(task.single, "--limit")),
        quantity(task.budget, "s", "--budget"),
        listed(task.manoeuvres or ()),
        task.effort,
        task.sensors,
        task.seed,
        task.jobs,
        out,
    )
    console = Console(stderr=True)
    try:
        with showing(console, "reading the result") as show:
            designed = design_drives(asked, show)
            show("writing the report")
            written = write_design(designed, out, command())
    except KeyboardInterrupt:
        if (kept := out / TRIED).is_dir():
            said = f"interrupted: the drives that were tried are kept in {kept}; the same command goes on from there"
            console.print(Text(said), soft_wrap=True)
        raise
    ranked = [
        f"{t.manoeuvre.name}, {round(t.seconds, 1):g} s: {expected.words}"
        for t, expected in zip(designed.plan.ranked, designed.alone, strict=True)
    ]
    refused = [
        f"{name}: no drive keeps to the limits and the budget ({why})" for name, why in designed.plan.refused.items()
    ]
    lines = [
        f"limits: {limits_words(designed)}",
        *(f"open: {text}" for text in designed.expectation.open),
        *ranked,
        *refused,
    ]
    printed(answer(designed), [*lines, *written])
    if then := once_driven(designed, out):
        Console().print(Text(f"once driven: {then}", style="bold"), soft_wrap=True)


def _weights(given: Sequence[str]) -> dict[str, float]:
    """Return the parameters of ``--for`` with their weights, 1 where none is stated."""
    weights = {}
    for word in listed(given):
        name, equals, _ = word.partition("=")
        value = pairs([word], "--for")[name] if equals else 1.0
        if not isinstance(value, float):
            raise UserError(f"--for {word}: write the weight as a number")
        weights[name] = value
    return weights
