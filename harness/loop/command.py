"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.command_line import study_path
from harness.errors import UserError

if TYPE_CHECKING:
    import xarray as xr

    from harness.configure import ModelSpec


def trace(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    train: Annotated[list[Path], typer.Option("--train", help="Recording to fit; repeatable.")],
    test: Annotated[list[Path], typer.Option("--test", "-t", help="Recording to judge on; repeatable.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of trace.json, the amended model and the report.")],
    channels: Annotated[
        Path | None, typer.Option("--channels", "-c", help="Channel map of the recordings; signal names if absent.")
    ] = None,
    parameters: Annotated[
        str | None, typer.Option("--parameters", help="Nominal values: a set or a TOML file; the vehicle's only set.")
    ] = None,
    tyre: Annotated[str | None, typer.Option("--tyre", help="Tyre; magic_formula where the vehicle needs one.")] = None,
    effect: Annotated[list[str] | None, typer.Option("--effect", help="Effect the model has; repeatable.")] = None,
    sensors: Annotated[
        str | None, typer.Option("--sensors", help="Sensors; if absent, those that use most of the recordings.")
    ] = None,
    values: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Value that differs from the set.")
    ] = None,
    free: Annotated[
        str, typer.Option("--free", help="Nominal parameters that are fitted anyway; cornering stiffnesses if absent.")
    ] = "",
    estimators: Annotated[
        str, typer.Option("--estimators", help="Estimators run on the test drives before and after; empty for none.")
    ] = "ekf,ukf,cdkf",
    study: Annotated[
        str | None, typer.Option("--study", help="Study that says what the amendment is worth, of the same vehicle.")
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Its runs of each level with other noise.")] = 8,
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Find the physical effect or parameter that a model lacks, and how much better it is with it.

    Writes trace.json, the nominal and the amended model as parameter files, and a report.
    """
    from harness.loop.report import document
    from harness.loop.run import Task, run_trace
    from harness.measured.study import fitted_parameters
    from harness.report.document import write

    _refuse_the_same(train, test)
    fitted, held_out = ([_load(path, channels) for path in paths] for paths in (train, test))
    spec, notes = _nominal(model, fitted + held_out, parameters, tyre, effect, sensors, values)
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
    """A drive that was fitted says nothing about drives that were not; by content, so a copy is no other drive."""
    for path in [*train, *test]:
        if not path.exists():
            raise UserError(f"{path}: there is no such recording")
    fitted = {_content(path): path for path in train}
    for path in test:
        if _content(path) in fitted:
            raise UserError(f"--test {path}: is the drive --train {fitted[_content(path)]}; keep another one aside")


def _content(path: Path) -> bytes | Path:
    return path.read_bytes() if path.is_file() else path.resolve()


def _load(path: Path, channels: Path | None) -> xr.Dataset:
    from harness.measured import load_recording

    return load_recording(path, channels).assign_attrs(name=path.name.split(".")[0])


def _nominal(
    model: str,
    recordings: list[xr.Dataset],
    parameters: str | None,
    tyre: str | None,
    effects: list[str] | None,
    sensors: str | None,
    values: list[str] | None,
) -> tuple[ModelSpec, tuple[str, ...]]:
    """Return the nominal model, and what cannot be traced because a sensor is missing."""
    from harness.command_line import model_table
    from harness.identify.recordings import step_of
    from harness.measured.study import finely

    table = model_table(model, parameters, tyre, effects, sensors, values)
    notes: tuple[str, ...] = ()
    if sensors is None:
        table["sensors"], notes = _most_sensors(model, table.get("tyre"), recordings)
    return finely(table, step_of(recordings[0]), "command line"), notes


def _most_sensors(model: str, tyre: str | None, recordings: list[xr.Dataset]) -> tuple[str, tuple[str, ...]]:
    """Return the set of sensors that uses most signals of the recordings, and what a larger one would need.

    Raises:
        UserError: If there is none; with the signals that each lacks.
    """
    from models import registry

    there = set.intersection(*({str(v).removeprefix("measured_") for v in r} for r in recordings))
    names = [n for n in registry.names("models.sensors") if _fits(model, tyre, n)]
    needs = {n: set(registry.load("models.sensors", n).OUTPUTS) for n in names}
    complete = [n for n in names if needs[n] <= there]
    if not complete:
        lacking = "; ".join(f"'{n}' also needs {', '.join(sorted(needs[n] - there))}" for n in names)
        raise UserError(f"--sensors: the recordings hold no set of sensors of '{model}' whole: {lacking}")
    best, largest = (max(some, key=lambda n: len(needs[n])) for some in (complete, names))
    if len(needs[best]) == len(needs[largest]):
        return best, ()
    note = (
        f"the recordings lack {', '.join(sorted(needs[largest] - there))}, so sensors '{best}' are traced with "
        f"({', '.join(sorted(needs[best]))}), and effects that only '{largest}' would show are not found"
    )
    return best, (note,)


def _fits(model: str, tyre: str | None, sensors: str) -> bool:
    """Whether a vehicle publishes what a set of sensors measures."""
    from models.assemble import assemble
    from models.contracts import ModelError

    try:
        assemble(model, tyre, (), sensors)
    except ModelError:
        return False
    return True


def _listed(given: str) -> tuple[str, ...]:
    return tuple(n for n in (part.strip() for part in given.split(",")) if n)


def _kinds(given: str) -> tuple[str, ...]:
    """Return the estimators to run, each known."""
    from harness.estimate import load_estimator

    kinds = _listed(given)
    for kind in kinds:
        load_estimator(kind)
    return kinds
