"""``harness tune``: the noise that estimators believe, from the drives of a study or from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    EffectOption,
    ModelOptions,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
    command,
    study_path,
)
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
    budget: Annotated[int, typer.Option("--budget", min=1, help="Candidates per estimator of a study.")] = 240,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Noise realisations of each drive of a study.")] = 1,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", help="Estimator of a study, by name; repeatable; all if absent."),
    ] = None,
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
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Tune the noise that estimators believe: of a study on its training drives, or with --data on recordings.

    A study: factors on process noise, random walk of the unknown inputs and measurement noise of every estimator
    maximise the likelihood of the innovations on drives simulated at the nominal plant, within one budget.

    Recordings, without a truth: the variances of process and measurement noise maximise the likelihood of the
    innovations. Those that the recordings do not determine stay as stated.
    """
    if data is None:
        if study is None or drives is None:
            raise UserError(
                "tune a study (harness tune STUDY --drives ...) or recordings (harness tune --data ... --model ...)"
            )
        _study(study, drives, budget, repeats, only or (), out)
        return
    if study is not None or drives is not None or only:
        raise UserError("--data tunes on recordings; leave out the study, --drives and --only")
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
    training = dataclasses.replace(loaded, drives=load_drives(drives, loaded.path.parent))
    console = Console(stderr=True)
    with console.status("tuning") as status:
        found = search(training, budget, repeats, lambda name: status.update(f"tuning {name}"), only)
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


def _recordings(given: RecordedOptions, by: Literal["state", "unit"], out: Path) -> None:
    """Tune on recordings and write the parameter file, its numbers and the report."""
    from harness.api.estimator import believed_on
    from harness.recorded.tuning import tune_noise
    from harness.recorded.tuning_report import answer, document, write_tuning
    from harness.reporting.document import write

    if out.suffix != ".toml":
        raise UserError(f"--out {out}: name a TOML file, such as tuned.toml")
    console = Console(stderr=True)
    with console.status("reading") as status:
        recordings = given.recordings()
        believed = believed_on(given.believed(recordings), recordings, inputs=given.inputs, jobs=given.jobs)
        status.update("compiling")
        found = tune_noise(believed, recordings, by, status.update)
        status.update("report")
        files = write_tuning(out, found)
        files += write(document(found, command()), out.parent, out.stem)
    Console().print(Text(answer(found), style="bold"), soft_wrap=True)
    for path in files:
        Console().print(Text(str(path)), soft_wrap=True)
