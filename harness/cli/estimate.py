"""``harness estimate``: estimators run on recordings, with a report."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    EffectOption,
    JobsOption,
    ModelOptions,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
    command,
    pairs,
)
from harness.cli.recorded_options import (
    BankOption,
    ChannelsOption,
    ConsideredOption,
    DataOption,
    InputsOption,
    IntegratorOption,
    MeasurementOption,
    ParameterOption,
    ProcessOption,
    RecordedOptions,
    StepOption,
    SubstepsOption,
    UnknownOption,
)
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.api.estimator import Estimator


def estimate(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    data: DataOption,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the estimates, estimate.json and the report.")],
    estimator: Annotated[
        list[str],
        typer.Option(
            "--estimator",
            "-e",
            metavar="KIND[,NAME=VALUE...]",
            help="Estimator with its settings, e.g. ukf,alpha=0.5; repeatable. harness list estimators shows them.",
        ),
    ],
    channels: ChannelsOption = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: RecordedSensorsOption = None,
    values: SetOption = None,
    signal: Annotated[
        list[str] | None,
        typer.Option("--signal", help="Further quantity of the model to estimate, such as a tyre force; repeatable."),
    ] = None,
    reference: Annotated[
        list[str] | None,
        typer.Option(
            "--reference",
            metavar="SIGNAL=CHANNEL",
            help="State or port, and the signal of the recording it is compared with, where the names differ.",
        ),
    ] = None,
    unknown_input: UnknownOption = None,
    unknown_parameter: ParameterOption = None,
    considered_parameter: ConsideredOption = None,
    process_noise: ProcessOption = None,
    measurement_noise: MeasurementOption = None,
    step: StepOption = None,
    bank_map: BankOption = None,
    inputs: InputsOption = "joined",
    integrator: IntegratorOption = "rk4",
    substeps: SubstepsOption = None,
    form: Annotated[
        Literal["csv", "parquet", "nc"], typer.Option("--format", help="Of the files with the estimates over time.")
    ] = "csv",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of estimators that draw random numbers.")] = 0,
    jobs: JobsOption = None,
) -> None:
    """Run estimators on recordings: estimates and standard deviations of every state, innovations, NIS, errors.

    Missing samples are skipped. A signal of the recording that the estimators do not measure is the reference of the
    state or port of its name. Writes one file for each estimator and recording, estimate.json and a report.
    """
    given = RecordedOptions(
        ModelOptions(model, parameters, tyre, effect, sensors, values),
        data, channels, step, unknown_input, process_noise, measurement_noise, inputs, integrator, substeps,
        bank_map or (), jobs, unknown_parameter, considered_parameter,
    )  # fmt: skip
    from harness.api.estimates import estimate as estimated

    chosen = [_estimator(text) for text in estimator]
    references = {k: str(v) for k, v in pairs(reference, "--reference").items()}
    with showing(Console(stderr=True), "reading"):
        recordings = given.recordings()
    found = estimated(
        given.believed(recordings),
        recordings,
        chosen,
        signals=signal or (),
        references=references,
        inputs=inputs,
        seed=seed,
        jobs=jobs,
    )
    with showing(Console(stderr=True), "writing the report"):
        written = found.report(out, command(), form)
    for note in found.notes:
        Console(stderr=True).print(Text(f"note: {note}"), soft_wrap=True)
    Console().print(Text(found.answer, style="bold"), soft_wrap=True)
    for path in written:
        Console().print(Text(str(path)), soft_wrap=True)


def _estimator(text: str) -> Estimator:
    """Return an estimator that is asked for as ``KIND[,NAME=VALUE...]``; tables and lists are written as in TOML."""
    from harness.api.estimator import Estimator

    kind, *settings = (part.strip() for part in _outside_brackets(text))
    option = f"--estimator {kind},"
    return Estimator(kind, **{name: _entry(value, option) for name, value in pairs(settings, option).items()})


def _outside_brackets(text: str) -> Iterator[str]:
    """Split a text at the commas that stand in no brackets."""
    depth, begin = 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth <= 0:
            yield text[begin:at]
            begin = at + 1
    yield text[begin:]


def _entry(value: Any, option: str) -> Any:
    """Return a setting; a text in brackets is a list or table of TOML."""
    if not isinstance(value, str) or not value.startswith(("[", "{")):
        return value
    try:
        return parse_toml(f"entry = {value}", "it")["entry"]
    except UserError as error:
        raise UserError(
            f"{option} '{value}': write it as in a study file, texts in quotes, "
            f'e.g. \'hypotheses={{trailer_mass=["8 t", "24 t"]}}\' ({error})'
        ) from error
