"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    EffectOption,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
    study_path,
)
from harness.common.errors import UserError

if TYPE_CHECKING:
    import xarray as xr


def trace(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    train: Annotated[list[Path], typer.Option("--train", help="Recording to fit; repeatable.")],
    test: Annotated[list[Path], typer.Option("--test", "-t", help="Held-out recording to validate on; repeatable.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of trace.json, the amended model and the report.")],
    channels: Annotated[
        Path | None, typer.Option("--channels", "-c", help="Channel map of the recordings; signal names if absent.")
    ] = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: RecordedSensorsOption = None,
    values: SetOption = None,
    free: Annotated[
        str, typer.Option("--free", help="Nominal parameters that are always fitted; cornering stiffnesses if absent.")
    ] = "",
    estimators: Annotated[
        str, typer.Option("--estimators", help="Estimators run on the test drives before and after; empty for none.")
    ] = "ekf,ukf,cdkf",
    study: Annotated[
        str | None, typer.Option("--study", help="Study of the same vehicle that measures the gain of the amendment.")
    ] = None,
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, help="Noise realisations of each level of that study.")
    ] = 8,
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Find the physical effect that a model lacks or the parameter that is wrong, and how much the model improves.

    Writes trace.json, the nominal and the amended model as parameter files, and a report.
    """
    from harness.cli.options import ModelOptions, model_table
    from harness.diagnosis.report.report import document
    from harness.diagnosis.run import Task, run_trace
    from harness.identification.data import step_of
    from harness.identification.measured_file import finely, fitted_parameters
    from harness.reporting.document import write

    _refuse_the_same(train, test)
    fitted, held_out = ([_load(path, channels) for path in paths] for paths in (train, test))
    table, notes = model_table(ModelOptions(model, parameters, tyre, effect, sensors, values), fitted + held_out)
    spec = finely(table, step_of(fitted[0]), "command line")
    chosen = fitted_parameters(spec, _listed(free), "--free")
    path = None if study is None else study_path(study)
    task = Task(spec, fitted, held_out, chosen, _kinds(estimators), path, repeats, jobs=jobs, notes=notes)
    console = Console(stderr=True)
    outcome = run_trace(task, out, console)
    with console.status("writing the report"):
        command = " ".join(["harness", *map(shlex.quote, sys.argv[1:])])
        write(document(outcome, command), out, failures=outcome.failures)
    Console().print(Text(outcome.answer, style="bold"), soft_wrap=True)
    for name in ("report.html", "report.pdf", "trace.json", "nominal.toml", "amended.toml"):
        Console().print(Text(str(out / name)), soft_wrap=True)


def _refuse_the_same(train: list[Path], test: list[Path]) -> None:
    """Refuse a held-out drive that is fitted as well, by content, so that a copy is recognised."""
    for path in [*train, *test]:
        if not path.exists():
            raise UserError(f"{path}: there is no such recording")
    fitted = {_content(path): path for path in train}
    for path in test:
        if _content(path) in fitted:
            raise UserError(f"--test {path}: is the drive --train {fitted[_content(path)]}; hold out another one")


def _content(path: Path) -> bytes | Path:
    return path.read_bytes() if path.is_file() else path.resolve()


def _load(path: Path, channels: Path | None) -> xr.Dataset:
    from harness.recordings import load_recording

    return load_recording(path, channels).assign_attrs(name=path.name.split(".")[0])


def _listed(given: str) -> tuple[str, ...]:
    return tuple(n for n in (part.strip() for part in given.split(",")) if n)


def _kinds(given: str) -> tuple[str, ...]:
    """Return the estimators to run, each known."""
    from harness.estimation.contract import load_estimator

    kinds = _listed(given)
    for kind in kinds:
        load_estimator(kind)
    return kinds
