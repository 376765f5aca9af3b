"""``harness tune``: the noise that estimators believe, from the drives of a study or from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    MOST,
    EffectOption,
    JobsOption,
    ModelOptions,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
    command,
    study_path,
)
from harness.cli.outputs import refuse_input
from harness.cli.recorded_options import (
    BankOption,
    ChannelsOption,
    InputsOption,
    IntegratorOption,
    MeasurementOption,
    ProcessOption,
    RecordedOptions,
    StepOption,
    SubstepsOption,
    UnknownOption,
)
from harness.common.errors import UserError
from harness.common.stages import showing

ObjectiveOption = Annotated[
    Literal["likelihood", "worst-case"],
    typer.Option(
        "--objective",
        help="Of a study: the likelihood of the innovations at the nominal plant, or the error of the worst twentieth "
        "of the runs in the box of a design.",
    ),
]
DesignOption = Annotated[
    str | None,
    typer.Option("--design", help="Design whose box the worst case is sought in; the study's first if absent."),
]
BudgetOption = Annotated[int, typer.Option("--budget", min=1, max=MOST, help="Candidates per estimator of a study.")]
RepeatsOption = Annotated[
    int, typer.Option("--repeats", min=1, max=MOST, help="Noise realisations of each drive of a study.")
]
PointsOption = Annotated[
    int, typer.Option("--points", min=8, max=MOST, help="Points of that box; powers of two fill it best.")
]


def tune(
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="TOML file to write: tuning = ... of a study, or with --data a parameter file."
        ),
    ],
    study: Annotated[
        str | None, typer.Argument(help="Study file, or the name of one in studies/; none with --data.")
    ] = None,
    drives: Annotated[
        str | None, typer.Option("--drives", help="Training drives: a name in studies/drives or a TOML file.")
    ] = None,
    budget: BudgetOption = 240,
    repeats: RepeatsOption = 1,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="Estimator of a study, by name; repeatable; all if absent."),
    ] = None,
    objective: ObjectiveOption = "likelihood",
    design: DesignOption = None,
    points: PointsOption = 32,
    data: Annotated[
        list[Path] | None, typer.Option("--data", "-d", help="Recording; repeatable. Tunes without a truth.")
    ] = None,
    model: Annotated[
        str | None, typer.Option("--model", "-m", help="Vehicle of the recordings; harness list vehicles shows them.")
    ] = None,
    channels: ChannelsOption = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: RecordedSensorsOption = None,
    values: SetOption = None,
    unknown_input: UnknownOption = None,
    process_noise: ProcessOption = None,
    measurement_noise: MeasurementOption = None,
    by: Annotated[
        Literal["state", "unit"],
        typer.Option("--by", help="Every state its own process noise, or one factor for all states of a unit."),
    ] = "state",
    step: StepOption = None,
    bank_map: BankOption = None,
    inputs: InputsOption = "joined",
    integrator: IntegratorOption = "rk4",
    substeps: SubstepsOption = None,
    jobs: JobsOption = None,
) -> None:
    """Tune the noise that estimators believe: of a study on its training drives, or with --data on recordings.

    A study: factors on process noise, random walk of the unknown inputs and measurement noise of every estimator
    maximise the likelihood of the innovations on drives simulated at the nominal plant, within one budget. With
    --objective worst-case they minimise the mean error of the worst twentieth of the runs in the box of a design
    (conditional value at risk); a report shows the front between nominal and worst-case error.

    Recordings, without a truth: the variances of process and measurement noise maximise the likelihood of the
    innovations. Those that the recordings do not determine stay as stated.
    """
    if data is None:
        if study is None or drives is None:
            raise UserError(
                "tune a study (harness tune STUDY --drives ...) or recordings (harness tune --data ... --model ...)"
            )
        if objective == "worst-case":
            _worst_case(study, drives, budget, design, points, only or (), jobs, out)
        elif design is not None:
            raise UserError("--design belongs to --objective worst-case: the likelihood is that of the nominal plant")
        else:
            _study(study, drives, budget, repeats, only or (), out)
        return
    if study is not None or drives is not None or only or design is not None or objective != "likelihood":
        raise UserError("--data tunes on recordings; leave out the study, --drives, --only, --objective and --design")
    if model is None:
        raise UserError("--data needs --model: the vehicle of the recordings")
    given = RecordedOptions(
        ModelOptions(model, parameters, tyre, effect, sensors, values),
        data, channels, step, unknown_input, process_noise, measurement_noise, inputs, integrator, substeps,
        bank_map or (), jobs,
    )  # fmt: skip
    _recordings(given, by, out)


def _study(study: str, drives: str, budget: int, repeats: int, only: Sequence[str], out: Path) -> None:
    """Tune the estimators of a study that state a covariance."""
    import dataclasses

    from rich.table import Table

    from harness.config import load_drives, load_study
    from harness.study.tune import tune as search
    from harness.study.tune import write_tuning

    loaded = load_study(study_path(study), tuned=False)
    refuse_input(out, loaded.path, Path(drives))
    training = dataclasses.replace(loaded, drives=load_drives(drives, loaded.path.parent))
    console = Console(stderr=True)
    with showing(console, "tuning") as show:
        found = search(training, budget, repeats, lambda name: show(f"tuning {name}"), only)
    write_tuning(out, training, budget, repeats, found, command())
    table = Table("estimator", "process", "unknown inputs", "measurement", "log-likelihood before", "after", box=None)
    for name, tuning in found.items():
        factors = [f"{tuning.factors[group]:.3g}" for group in ("process", "unknown_inputs", "measurement")]
        table.add_row(name, *factors, f"{tuning.before:.1f}", f"{tuning.after:.1f}")
    Console().print(table)
    for name, tuning in found.items():
        for group in tuning.at_the_edge:
            console.print(f"{name}: the factor on {group} lies at the end of the search; state that noise anew")
    typer.echo(out)


def _worst_case(
    study: str,
    drives: str,
    budget: int,
    design: str | None,
    points: int,
    only: Sequence[str],
    jobs: int | None,
    out: Path,
) -> None:
    """Tune the estimators of a study for the worst case in the box of a design, and write file and report."""
    import dataclasses

    from harness.common.registry import closest
    from harness.config import load_drives, load_study
    from harness.study import worst_case, worst_case_report

    if out.suffix != ".toml":
        raise UserError(f"--out {out}: name a TOML file, such as tuned.toml")
    loaded = load_study(study_path(study), tuned=False)
    refuse_input(out, loaded.path, Path(drives))
    names = [d.name for d in loaded.designs]
    if design is not None and design not in names:
        raise UserError(f"--design {design}: study '{loaded.name}' has no such design{closest(design, names)}")
    box = loaded.design(design or names[0])
    training = dataclasses.replace(loaded, drives=load_drives(drives, loaded.path.parent))
    console = Console(stderr=True)
    with showing(console, "simulating the training runs") as show:
        found = worst_case.tune_for_worst_case(
            training, box, budget, points, only, jobs=jobs, progress=lambda name: show(f"tuning {name}")
        )
        worst_case.write_worst_case(out, training, box, budget, points, found, command())
        show("report")
        files = worst_case_report.report(training, box, found, command()).write(out.parent, out.stem)
    Console().print(Text(worst_case_report.answer(found), style="bold"), soft_wrap=True)
    for path in (out, *files):
        typer.echo(path)


def _recordings(given: RecordedOptions, by: Literal["state", "unit"], out: Path) -> None:
    """Tune on recordings and write the parameter file, its numbers and the report."""
    from harness.api.estimator import believed_on
    from harness.recorded.tuning import tune_noise
    from harness.recorded.tuning_report import report, write_tuning

    if out.suffix != ".toml":
        raise UserError(f"--out {out}: name a TOML file, such as tuned.toml")
    console = Console(stderr=True)
    with showing(console, "reading") as show:
        recordings = given.recordings()
        believed = believed_on(given.believed(recordings), recordings, inputs=given.inputs, jobs=given.jobs)
        show("compiling")
        found = tune_noise(believed, recordings, by, show)
        show("report")
        files = write_tuning(out, found)
        files += report(found, command()).write(out.parent, out.stem)
    Console().print(Text(found.answer, style="bold"), soft_wrap=True)
    for path in files:
        Console().print(Text(str(path)), soft_wrap=True)
