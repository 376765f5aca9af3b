"""Commands on recordings: ``harness estimate``, ``identify`` and ``trace``, each with a report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import (
    MOST,
    JobsOption,
    MaybeModelOptions,
    ParameterOption,
    SeedOption,
    SignalOption,
    command,
    listed,
    pairs,
    printed,
    study_path,
)
from harness.cli.recorded_options import MeasuredOptions, RecordedOptions, uncertain
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.api.estimator import Estimator
    from harness.identification.measured_file import MeasuredStudy


@dataclass(frozen=True, kw_only=True)
class EstimateOptions(RecordedOptions):
    """Estimators to run on recordings."""

    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the estimates, estimate.json and the report.")]
    estimators: Annotated[
        list[str],
        typer.Option(
            "--estimator",
            "-e",
            metavar="KIND[,NAME=VALUE...]",
            help="Estimator with its settings, e.g. ukf,alpha=0.5; repeatable. harness list estimators shows them.",
        ),
    ]
    signals: SignalOption = None
    references: Annotated[
        list[str] | None,
        typer.Option(
            "--reference",
            metavar="SIGNAL=CHANNEL",
            help="State or port, and the signal of the recording it is compared with, where the names differ.",
        ),
    ] = None
    unknown_parameters: ParameterOption = None
    considered_parameters: Annotated[
        list[str] | None,
        typer.Option(
            "--considered-parameter",
            metavar="NAME[,prior=..]",
            help="Parameter whose uncertainty is reckoned with and whose value is left alone; repeatable.",
        ),
    ] = None
    form: Annotated[
        Literal["csv", "parquet", "nc", "mf4", "mcap"],
        typer.Option("--format", help="Of the files with the estimates over time."),
    ] = "csv"
    seed: SeedOption = 0

    @property
    def unsure(self) -> dict[str, Any]:
        """Keys of the model for parameters that are not known for sure."""
        return {
            "unknown_parameters": uncertain(self.unknown_parameters, "--unknown-parameter"),
            "considered_parameters": uncertain(self.considered_parameters, "--considered-parameter"),
        }


@takes(EstimateOptions)
def estimate(task: EstimateOptions) -> None:
    """Run estimators on recordings: estimates and standard deviations of every state, innovations, NIS, errors.

    Missing samples are skipped. A signal of the recording that the estimators do not measure is the reference of the
    state or port of its name. Writes one file for each estimator and recording, estimate.json and a report.
    """
    from harness.api.estimates import estimate as estimated
    from harness.recordings.read.write import check_packages

    check_packages(task.form)
    estimators = [_estimator(text) for text in task.estimators]
    references = {k: str(v) for k, v in pairs(task.references, "--reference").items()}
    with showing(Console(stderr=True), "reading"):
        recordings = task.recordings()
    estimates = estimated(
        task.believed(recordings),
        recordings,
        estimators,
        signals=task.signals or (),
        references=references,
        inputs=task.inputs,
        seed=task.seed,
        jobs=task.jobs,
    )
    with showing(Console(stderr=True), "writing the report"):
        written = estimates.report(task.out, command(), task.form)
    for note in estimates.notes:
        Console(stderr=True).print(Text(f"note: {note}"), soft_wrap=True)
    printed(estimates.answer, written)


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


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(MeasuredOptions):
    """A model to fit to recordings."""

    method: Annotated[
        str | None,
        typer.Option("--method", help="likelihood, swarm or em; of a plant of somebody else least-squares or swarm."),
    ] = None
    settings: Annotated[
        list[str] | None, typer.Option("--setting", metavar="NAME=VALUE", help="Setting of the method; repeatable.")
    ] = None
    integrator: Annotated[
        Literal["euler", "heun", "rk4"] | None,
        typer.Option("--integrator", help="How the model's equations are integrated; rk4 if absent."),
    ] = None
    substeps: Annotated[
        int | None, typer.Option("--substeps", min=1, max=MOST, help="Integration steps per sample; 1 if absent.")
    ] = None
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of what draws random numbers.")] = None
    fmu: Annotated[str | None, typer.Option("--fmu", metavar="FILE", help="FMU in place of --model.")] = None
    map: Annotated[
        str | None, typer.Option("--map", metavar="FILE", help="Which of its variables is which signal.")
    ] = None
    python: Annotated[
        str | None, typer.Option("--python", metavar="MODULE:CLASS", help="Plant in Python in place of --model.")
    ] = None

    @property
    def plant(self) -> dict[str, Any]:
        """A plant of somebody else as keys of ``[plant]``; empty where none is named."""
        stated = {"fmu": self.fmu, "map": self.map, "python": self.python}
        keys: dict[str, Any] = {name: value for name, value in stated.items() if value is not None}
        return {**keys, "integrator": self.integrator or "rk4", "substeps": self.substeps or 1} if keys else {}


@takes(IdentifyOptions)
def identify(task: IdentifyOptions) -> None:
    """Identify parameters of a model from recordings, with their uncertainty.

    Takes a file of measured drives, such as studies/identify/genesis.toml, or a model and recordings. The search begins
    at the values of the parameter set. All measured outputs of the sensors are fitted. With --fmu or --python a plant
    of somebody else is fitted by its simulation error. With --after the drives that were planned behind an earlier
    identification are fitted together with its own.
    Writes a parameter set that studies load, identify.json, and a report on the fitted and the held-out drives.
    """
    from harness.api.identification import identified_file, identified_plant
    from harness.api.identification import identify as identified

    if (of_file := task.of_file("identify")) is not None:
        study, out = of_file
        if study.absent:
            Console().print(Text(study.absent), soft_wrap=True)
            return
        fit = identified_file(study, task.jobs)
    elif task.plant:
        if task.after is not None:
            raise UserError("--after: drives are planned for models of the library, not for a plant of somebody else")
        out = task.folder
        train, test = task.drives()
        fit = identified_plant(
            task.plant,
            train,
            listed(task.free or []),
            test=test,
            method=task.method or "least-squares",
            settings=pairs(task.settings, "--setting"),
            seed=task.seed or 0,
            jobs=task.jobs,
        )
    else:
        out, free = task.folder, listed(task.free or [])
        model = task.nominal(integrator=task.integrator, substeps=task.substeps)
        train, test = task.drives()
        fit = identified(
            model,
            train,
            free,
            test=test,
            method=task.method,
            settings=pairs(task.settings, "--setting"),
            seed=task.seed,
            jobs=task.jobs,
            after=task.after,
        )
    for note in fit.notes:
        Console(stderr=True).print(Text(f"warning: {note}", style="yellow"), soft_wrap=True)
    with showing(Console(stderr=True), "writing the report"):
        written = fit.report(out, command())
    sentences = []
    for name, e in fit.estimates[fit.estimates.index.isin(fit.free)].iterrows():
        unit = f" {e.unit}" if e.unit and e.unit != "dimensionless" else ""
        interval = f"95 % interval {e.lower:.4g} to {e.upper:.4g}" if e.lower < e.upper else "no interval"
        sentences.append(f"{name}: {e.start:.4g} to {e.value:.4g}{unit}, {interval}; {e.verdict}")
    printed(fit.answer, [*sentences, *written])
    _next(written)


@dataclass(frozen=True, kw_only=True)
class TraceOptions(MeasuredOptions):
    """A model that may lack something, and recordings that may show it."""

    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimator",
            "-e",
            help="Estimators run on the test drives before and after; repeatable; ekf,ukf,cdkf if absent.",
        ),
    ] = None
    study: Annotated[
        str | None, typer.Option("--study", help="Study of the same vehicle that measures the gain of the amendment.")
    ] = None
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, max=MOST, help="Noise realisations of each level of that study.")
    ] = 8
    baseline: Annotated[
        list[Path] | None,
        typer.Option("--baseline", help="Earlier recording of the vehicle; two or more: what changed since?"),
    ] = None

    @property
    def needed(self) -> dict[str, Any]:
        """What is needed further without a file, by its option."""
        return {"--test": self.test}


@takes(TraceOptions)
def trace(task: TraceOptions) -> None:
    """Find the physical effect that a model lacks or the parameter that is wrong, and how much the model improves.

    Takes a file of measured drives, such as studies/loops/genesis.toml, or a model and recordings. Parameters to fit
    are the cornering stiffnesses if none are named. Writes trace.json, the nominal and the amended model as parameter
    files, and a report; of a file also loop.json, each held-out drive with the published, refitted and amended model.
    With --after the drives that were planned behind an earlier trace are traced together with its own.
    """
    from harness.api.diagnosis import Diagnosis
    from harness.diagnosis.earlier_trace import TRACE, models_left
    from harness.identification.earlier_result import read_json

    if (of_file := task.of_file("trace")) is not None:
        _trace_file(*of_file, task.jobs)
        return
    out = task.folder
    study = None if task.study is None else study_path(task.study)
    estimators = None if task.estimators is None else listed(task.estimators)
    diagnosis = Diagnosis(listed(task.free or []), estimators, study, task.repeats, task.jobs)
    model = task.nominal()
    train, test = task.drives()
    baseline = task.read(task.baseline or [])
    diagnosis.fit(model, train, test, out, baseline, task.after)
    with showing(Console(stderr=True), "writing the report"):
        written = diagnosis.report(out, command())
    printed(diagnosis.answer_, written)
    _next(written)
    if models_left(read_json(out / TRACE)) > 1:
        Console().print(Text(f"next: harness next-drive {out}"), style="bold", soft_wrap=True)


def _next(written: Sequence[Path]) -> None:
    """Print the command that goes on from a result, if a study of what it leaves open was written."""
    for path in written:
        if path.name == "posterior.toml":
            line = f"next: harness run {path} --out {path.with_suffix('')}"
            Console().print(Text(line), style="bold", soft_wrap=True)


def loop(
    file: Annotated[Path, typer.Argument(help="File of measured drives, such as studies/loops/genesis.toml.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder of the results; results/loop-<name> if absent.")
    ] = None,
    jobs: JobsOption = None,
) -> None:
    """Trace a file of measured drives: former name of harness trace FILE."""
    Console(stderr=True).print(Text("note: harness loop FILE is called harness trace FILE"), soft_wrap=True)
    task = MeasuredOptions(file=file, model=MaybeModelOptions(), out=out, jobs=jobs)
    if (of_file := task.of_file("loop")) is not None:
        _trace_file(*of_file, jobs)


def _trace_file(study: MeasuredStudy, out: Path, jobs: int | None) -> None:
    """Trace the drives of a file, and its changed drives; say so where their folder is absent."""
    from harness.diagnosis.measured_study import trace_study

    if study.absent:
        Console().print(Text(study.absent), soft_wrap=True)
        return
    console = Console(stderr=True)
    with showing(console, "reading the recordings"):
        drives = study.drives()
    *answers, last = trace_study(study, drives, out, jobs, console)
    for answer in answers:
        printed(answer, ())
    printed(last, [out / "report.html"])
