"""``harness estimate``: estimators run on recordings, with a report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import ParameterOption, SeedOption, SignalOption, command, pairs, printed
from harness.cli.recorded_options import RecordedOptions, uncertain
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.common.stages import showing

if TYPE_CHECKING:
    from harness.api.estimator import Estimator


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
        Literal["csv", "parquet", "nc"], typer.Option("--format", help="Of the files with the estimates over time.")
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
