"""``harness trace``: what does the model lack that these drives can show?"""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.errors import UserError

if TYPE_CHECKING:
    import xarray as xr

    from harness.configure import ModelSpec

SHORTEST = 20.0
"""s; what shorter drives show is as much the first state as the vehicle."""


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
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Find the physical effect or parameter that a model lacks, and how much better it is with it.

    Writes trace.json, the amended model as a parameter set (amended.toml), and a report.
    """
    from harness.loop.amend import estimators_on
    from harness.loop.outcome import outcome_of, write_outcome
    from harness.loop.report import document
    from harness.loop.trace import trace as search
    from harness.loop.whole import Whole
    from harness.report.document import write

    _refuse_the_same(train, test)
    fitted, held_out = ([_load(path, channels) for path in paths] for paths in (train, test))
    spec = _nominal(model, fitted + held_out, parameters, tyre, effect, sensors, values)
    chosen, kinds = _free(spec, free), _kinds(estimators)
    console = Console(stderr=True)
    with console.status("compiling the library of effects") as status:
        whole = Whole(spec, set.intersection(*({str(v) for v in r} for r in fitted + held_out)), jobs)
        drives = [whole.drive(r, Path(str(r.attrs["file"])).stem) for r in fitted + held_out]
        found = search(whole, drives[: len(fitted)], drives[len(fitted) :], chosen, status.update)
        outcome = outcome_of(found)
        tried = estimators_on(found, outcome.amended, held_out, kinds, status.update)
        outcome = replace(outcome, estimators=tried)
        status.update("writing the report")
        command = " ".join(["harness", *map(shlex.quote, sys.argv[1:])])
        written = [*write_outcome(outcome, out), *write(document(outcome, command), out)]
    Console().print(Text(outcome.answer, style="bold"), soft_wrap=True)
    for path in written:
        Console().print(Text(str(path)), soft_wrap=True)


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

    recording = load_recording(path, channels)
    time = recording["time"].to_numpy()
    if time[-1] - time[0] < SHORTEST:
        raise UserError(
            f"{path}: lasts {time[-1] - time[0]:.1f} s, too short to decide what is missing; record at least "
            f"{SHORTEST:.0f} s, better two minutes with lane changes, a steady circle and quick steering"
        )
    return recording


def _nominal(
    model: str,
    recordings: list[xr.Dataset],
    parameters: str | None,
    tyre: str | None,
    effects: list[str] | None,
    sensors: str | None,
    values: list[str] | None,
) -> ModelSpec:
    """Return the nominal model; integrated finely, because errors of integration look like a lag of the steering."""
    from harness.command_line import pairs, parameter_set
    from harness.configure import resolve_single
    from harness.identify.recordings import step_of
    from models import registry

    if tyre is None and registry.load("models.vehicles", model).AXLES:
        tyre = "magic_formula"
    table = {
        "vehicle": model,
        "parameters": parameter_set(model, parameters),
        "tyre": tyre,
        "effects": effects or [],
        "sensors": sensors or _most_sensors(model, tyre, recordings),
        "values": pairs(values, "--set"),
        "integrator": "rk4",
        "step": step_of(recordings[0]),
    }
    return resolve_single({k: v for k, v in table.items() if v is not None}, "command line")


def _most_sensors(model: str, tyre: str | None, recordings: list[xr.Dataset]) -> str:
    """Return the set of sensors that uses most signals of the recordings.

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
    return max(complete, key=lambda n: len(needs[n]))


def _fits(model: str, tyre: str | None, sensors: str) -> bool:
    """Whether a vehicle publishes what a set of sensors measures."""
    from models.assemble import assemble
    from models.contracts import ModelError

    try:
        assemble(model, tyre, (), sensors)
    except ModelError:
        return False
    return True


def _free(spec: ModelSpec, given: str) -> tuple[str, ...]:
    """Return the nominal parameters that are fitted in any case."""
    from models.registry import closest

    known = spec.model().parameter_names
    names = tuple(n for n in (part.strip() for part in given.split(",")) if n)
    for name in names:
        if name not in known:
            raise UserError(f"--free: the model has no parameter '{name}'{closest(name, known)}")
    return names or tuple(p.name for p in spec.model().parameters if p.unit in ("N/rad", "1/rad"))


def _kinds(given: str) -> tuple[str, ...]:
    """Return the estimators to run, each known."""
    from harness.estimate import load_estimator

    kinds = tuple(k for k in (part.strip() for part in given.split(",")) if k)
    for kind in kinds:
        load_estimator(kind)
    return kinds
