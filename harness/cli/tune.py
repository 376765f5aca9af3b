"""``harness tune``: the noise that estimators believe, from the drives of a study or from recordings."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from harness.cli.declared import takes
from harness.cli.options import MOST, ModelOptions, command, printed, study_path
from harness.cli.outputs import refuse_input
from harness.cli.recorded_options import RECORDING, RecordedOptions
from harness.common.errors import UserError
from harness.common.stages import showing


@dataclass(frozen=True)
class ModelOfRecordings(ModelOptions):
    """A model that only recordings need."""

    vehicle: Annotated[
        str, typer.Option("--model", "-m", help="Vehicle of the recordings; harness list vehicles shows them.")
    ] = ""


@dataclass(frozen=True, kw_only=True)
class TuneTask(RecordedOptions):
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
    model: ModelOfRecordings
    data: Annotated[
        list[Path], typer.Option("--data", "-d", help=f"Recording, tuned on without a truth, or {RECORDING}")
    ] = field(default_factory=list)
    by: Annotated[
        Literal["state", "unit"],
        typer.Option("--by", help="Every state its own process noise, or one factor for all states of a unit."),
    ] = "state"


@takes(TuneTask)
def tune(task: TuneTask) -> None:
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
        if task.objective == "worst-case":
            _worst_case(task, task.study)
        elif task.design is not None:
            raise UserError("--design belongs to --objective worst-case: the likelihood is that of the nominal plant")
        else:
            _study(task, task.study)
        return
    if any(of_study):
        raise UserError(
            "--data tunes on recordings; leave out the study, --drive, --estimator, --objective and --design"
        )
    if not task.model.vehicle:
        raise UserError("--data needs --model: the vehicle of the recordings")
    _recordings(task)


def _study(task: TuneTask, study: str) -> None:
    """Tune the estimators of a study that state a covariance."""
    from rich.table import Table

    from harness.config import load_drives, load_study
    from harness.study.tune import tune as search
    from harness.study.tune import write_tuning

    loaded = load_study(study_path(study), tuned=False)
    refuse_input(task.out, loaded.path, Path(task.drives))
    training = dataclasses.replace(loaded, drives=load_drives(task.drives, loaded.path.parent))
    console = Console(stderr=True)
    with showing(console, "tuning") as show:
        tuned = search(training, task.budget, task.repeats, lambda name: show(f"tuning {name}"), task.estimators)
    write_tuning(task.out, training, task.budget, task.repeats, tuned, command())
    table = Table("estimator", "process", "unknown inputs", "measurement", "log-likelihood before", "after", box=None)
    for name, tuning in tuned.items():
        factors = [f"{tuning.factors[group]:.3g}" for group in ("process", "unknown_inputs", "measurement")]
        table.add_row(name, *factors, f"{tuning.before:.1f}", f"{tuning.after:.1f}")
    Console().print(table)
    for name, tuning in tuned.items():
        for group in tuning.at_the_edge:
            console.print(f"{name}: the factor on {group} lies at the end of the search; state that noise anew")
    typer.echo(task.out)


def _worst_case(task: TuneTask, study: str) -> None:
    """Tune the estimators of a study for the worst case in the box of a design, and write file and report."""
    from harness.common.registry import closest
    from harness.config import load_drives, load_study
    from harness.study import worst_case, worst_case_report

    out, budget, points = _toml(task.out), task.budget, task.points
    loaded = load_study(study_path(study), tuned=False)
    refuse_input(out, loaded.path, Path(task.drives))
    names = [d.name for d in loaded.designs]
    if task.design is not None and task.design not in names:
        raise UserError(
            f"--design {task.design}: study '{loaded.name}' has no such design{closest(task.design, names)}"
        )
    box = loaded.design(task.design or names[0])
    training = dataclasses.replace(loaded, drives=load_drives(task.drives, loaded.path.parent))
    with showing(Console(stderr=True), "simulating the training runs") as show:
        tuned = worst_case.tune_for_worst_case(
            training, box, budget, points, task.estimators, jobs=task.jobs, progress=lambda n: show(f"tuning {n}")
        )
        worst_case.write_worst_case(out, training, box, budget, points, tuned, command())
        show("report")
        files = worst_case_report.report(training, box, tuned, command()).write(out.parent, out.stem)
    printed(worst_case_report.answer(tuned), (out, *files))


def _recordings(task: TuneTask) -> None:
    """Tune on recordings and write the parameter file, its numbers and the report."""
    from harness.api.estimator import believed_on
    from harness.recorded.tuning import tune_noise
    from harness.recorded.tuning_report import report, write_tuning

    out = _toml(task.out)
    with showing(Console(stderr=True), "reading") as show:
        recordings = task.recordings()
        believed = believed_on(task.believed(recordings), recordings, inputs=task.inputs, jobs=task.jobs)
        show("compiling")
        tuned = tune_noise(believed, recordings, task.by, show)
        show("report")
        files = write_tuning(out, tuned)
        files += report(tuned, command()).write(out.parent, out.stem)
    printed(tuned.answer, files)


def _toml(out: Path) -> Path:
    """Return a file to write to.

    Raises:
        UserError: If its name is none of a TOML file.
    """
    if out.suffix != ".toml":
        raise UserError(f"--out {out}: name a TOML file, such as tuned.toml")
    return out
