"""``harness estimate``: estimators run on recordings, with a report."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from harness.cli.options import (
    EffectOption,
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
    DataOption,
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

if TYPE_CHECKING:
    import xarray as xr

    from harness.recorded.run import RecordedEstimator, RecordedModel


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
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Run estimators on recordings: estimates and standard deviations of every state, innovations, NIS, errors.

    Missing samples are skipped. A signal of the recording that the estimators do not measure is the reference of the
    state or port of its name. Writes one file for each estimator and recording, estimate.json and a report.
    """
    given = RecordedOptions(
        ModelOptions(model, parameters, tyre, effect, sensors, values),
        data, channels, step, unknown_input, process_noise, measurement_noise, inputs, integrator, substeps,
        bank_map or (), jobs,
    )  # fmt: skip
    chosen = _estimators(estimator)
    references = {k: str(v) for k, v in pairs(reference, "--reference").items()}
    console = Console(stderr=True)
    with console.status("reading"):
        recordings = given.recordings()
        believed = given.believed(recordings, signal or (), references)
        estimators = [_compiled(believed, name, kind, settings) for name, kind, settings in chosen]
    runs = _run(believed, estimators, recordings, seed, jobs, console)
    _report(believed, runs, recordings, out, form, console)


def _estimators(given: Sequence[str]) -> list[tuple[str, str, dict[str, Any]]]:
    """Return name, kind and settings of the estimators asked for.

    Raises:
        UserError: If one is asked for twice or its settings cannot be read.
        ModelError: If there is no such estimator.
    """
    from harness.estimation.contract import load_estimator

    found: list[tuple[str, str, dict[str, Any]]] = []
    for text in given:
        kind, *settings = (part.strip() for part in text.split(","))
        load_estimator(kind)
        name = kind.upper() if not settings else f"{kind.upper()} {' '.join(settings)}"
        if name in [n for n, _, _ in found]:
            raise UserError(f"--estimator {text}: is asked for twice")
        found.append((name, kind, pairs(settings, f"--estimator {kind},")))
    return found


def _compiled(model: RecordedModel, name: str, kind: str, settings: dict[str, Any]) -> RecordedEstimator:
    from harness.recorded.run import RecordedEstimator

    return RecordedEstimator(model, kind, settings, name=name)


def _run(
    model: RecordedModel,
    estimators: Sequence[RecordedEstimator],
    recordings: Sequence[xr.Dataset],
    seed: int,
    jobs: int | None,
    console: Console,
) -> list[xr.Dataset]:
    """Return the runs by recording, then by estimator."""
    from harness.recorded.run import name_of

    drives = [model.drive(r, name_of(r)) for r in recordings]
    tasks = [(i, e) for i in range(len(recordings)) for e in range(len(estimators))]
    found: dict[tuple[int, int], xr.Dataset] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress, ThreadPoolExecutor(jobs) as pool:
        bar = progress.add_task("compiling and estimating", total=len(tasks))
        futures = {pool.submit(estimators[e].run, recordings[i], seed, drives[i]): (i, e) for i, e in tasks}
        for future in as_completed(futures):
            found[futures[future]] = future.result()
            progress.advance(bar)
    return [found[task] for task in tasks]


def _report(
    model: RecordedModel,
    runs: Sequence[xr.Dataset],
    recordings: Sequence[xr.Dataset],
    out: Path,
    form: Literal["csv", "parquet", "nc"],
    console: Console,
) -> None:
    """Write everything, and print the answer, the files and what is odd about the recordings."""
    from harness.recorded.report import Estimated, answer, document
    from harness.recorded.run import EXACT
    from harness.recorded.summary import summary
    from harness.recorded.write import write_estimates, write_numbers
    from harness.reporting.document import write

    warnings = [f"{r.attrs['name']}: {w}" for r in recordings for w in r.attrs.get("warnings", [])]
    found = Estimated(model.spec.vehicle, runs, [summary(r) for r in runs], warnings)
    with console.status("writing"):
        files = write_estimates(out / "estimates", runs, form)
        numbers = write_numbers(out, found.summaries, EXACT)
        pages = write(document(found, command()), out)
    for warning in warnings:
        console.print(Text(f"note: {warning}"), soft_wrap=True)
    console.print(Text(f"note: {EXACT}"), soft_wrap=True)
    Console().print(Text(answer(found), style="bold"), soft_wrap=True)
    for path in (*pages, numbers, *files):
        Console().print(Text(str(path)), soft_wrap=True)
