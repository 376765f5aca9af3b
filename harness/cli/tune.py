"""``harness tune``: the noise that estimators believe, from the drives of a study or from recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console

from harness.cli.declared import takes
from harness.cli.options import MOST, MaybeModelOptions, command, printed, study_path
from harness.cli.outputs import refuse_input
from harness.cli.recorded_options import RECORDING, RecordedOptions
from harness.common.errors import UserError
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.api.tune import TunedStudy


@dataclass(frozen=True, kw_only=True)
class TuneOptions(RecordedOptions):
    """Noise to tune, of a study or on recordings."""

    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="TOML file to write: tuning = ... of a study, or with --data a parameter file."
        ),
    ]
    study: Annotated[
        str | None, typer.Argument(help="Study file, or the name of one in studies/; none with --data.")
    ] = None
    drives: Annotated[
        str, typer.Option("--drive", help="Training drives: a name in studies/drives or a TOML file.")
    ] = ""
    budget: Annotated[int, typer.Option("--budget", min=1, max=MOST, help="Candidates per estimator of a study.")] = 240
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, max=MOST, help="Noise realisations of each drive of a study.")
    ] = 1
    estimators: Annotated[
        list[str],
        typer.Option("--estimator", "-e", help="Estimator of a study, by name; repeatable; all if absent."),
    ] = field(default_factory=list)
    objective: Annotated[
        Literal["likelihood", "worst-case"],
        typer.Option(
            "--objective",
            help="Of a study: the likelihood of the innovations at the nominal plant, or the error of the worst "
            "twentieth of the runs in the box of a design.",
        ),
    ] = "likelihood"
    design: Annotated[
        str | None,
        typer.Option("--design", help="Design whose box the worst case is sought in; the study's first if absent."),
    ] = None
    points: Annotated[
        int, typer.Option("--points", min=8, max=MOST, help="Points of that box; powers of two fill it best.")
    ] = 32
    model: MaybeModelOptions
    data: Annotated[
        list[Path], typer.Option("--data", "-d", help=f"Recording, tuned on without a truth, or {RECORDING}")
    ] = field(default_factory=list)
    by: Annotated[
        Literal["state", "unit"],
        typer.Option("--by", help="Every state its own process noise, or one factor for all states of a unit."),
    ] = "state"


@takes(TuneOptions)
def tune(task: TuneOptions) -> None:
    """Tune the noise that estimators believe: of a study on its training drives, or with --data on recordings.

    A study: factors on process noise, random walk of the unknown inputs and measurement noise of every estimator
    maximise the likelihood of the innovations on drives simulated at the nominal plant, within one budget. With
    --objective worst-case they minimise the mean error of the worst twentieth of the runs in the box of a design
    (conditional value at risk); a report shows the front between nominal and worst-case error.

    Recordings, without a truth: the variances of process and measurement noise maximise the likelihood of the
    innovations. Those that the recordings do not determine stay as stated.
    """
    of_study = task.study, task.drives, *task.estimators, task.design, task.objective != "likelihood"
    if not task.data:
        if not task.study or not task.drives:
            raise UserError(
                "tune a study (harness tune STUDY --drive ...) or recordings (harness tune --data ... --model ...)"
            )
        if task.design is not None and task.objective == "likelihood":
            raise UserError("--design belongs to --objective worst-case: the likelihood is that of the nominal plant")
        return _study(task, task.study)
    if any(of_study):
        raise UserError(
            "--data tunes on recordings; leave out the study, --drive, --estimator, --objective and --design"
        )
    if not task.model.vehicle:
        raise UserError("--data needs --model: the vehicle of the recordings")
    return _recordings(task)


def _study(task: TuneOptions, study: str) -> None:
    """Tune the estimators of a study that state a covariance; of the likelihood show the factors."""
    from harness.api.tune import toml_file
    from harness.api.tune import tune as tuned

    path, of_likelihood = study_path(study), task.objective == "likelihood"
    out = task.out if of_likelihood else toml_file(task.out)
    refuse_input(out, path, Path(task.drives))
    tuning = tuned(
        path,
        task.drives,
        estimators=task.estimators,
        budget=task.budget,
        repeats=task.repeats,
        objective=task.objective,
        design=task.design,
        points=task.points,
        jobs=task.jobs,
    )
    written = tuning.write(out, command())
    if of_likelihood:
        _show_factors(tuning)
    else:
        printed(tuning.answer, ())
    for file in written:
        typer.echo(file)


def _show_factors(tuning: TunedStudy) -> None:
    from rich.table import Table

    table = Table("estimator", "process", "unknown inputs", "measurement", "log-likelihood before", "after", box=None)
    for name, (*factors, before, after) in tuning.factors.iterrows():
        table.add_row(str(name), *(f"{f:.3g}" for f in factors), f"{before:.1f}", f"{after:.1f}")
    Console().print(table)
    for note in tuning.notes:
        Console(stderr=True).print(note)


def _recordings(task: TuneOptions) -> None:
    """Tune on recordings and write the parameter file, its numbers and the report."""
    from harness.api.tune import toml_file, tune_noise

    out = toml_file(task.out)
    with showing(Console(stderr=True), "reading"):
        recordings = task.recordings()
    tuning = tune_noise(task.believed(recordings), recordings, by=task.by, inputs=task.inputs, jobs=task.jobs)
    printed(tuning.answer, tuning.write(out, command()))
