"""``harness identify``: parameters from recordings, with a report."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    EffectOption,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
)
from harness.common.errors import UserError

if TYPE_CHECKING:
    import xarray as xr

    from harness.config import ModelSpec
    from harness.identification.contract import Problem
    from harness.identification.data import Drive


def identify(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    data: Annotated[list[Path], typer.Option("--data", "-d", help="Recording to fit; repeatable.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of parameters.toml, identify.json and the report.")],
    free: Annotated[
        str, typer.Option("--free", "-f", help="Parameters to estimate, comma-separated; empty lists them.")
    ] = "",
    test: Annotated[
        list[Path] | None, typer.Option("--test", "-t", help="Held-out recording to validate the fit on; repeatable.")
    ] = None,
    method: Annotated[str, typer.Option("--method", help="File in harness/identification/methods.")] = "likelihood",
    channels: Annotated[
        Path | None, typer.Option("--channels", "-c", help="Channel map of the recordings; signal names if absent.")
    ] = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: RecordedSensorsOption = None,
    values: SetOption = None,
    setting: Annotated[
        list[str] | None, typer.Option("--setting", metavar="NAME=VALUE", help="Setting of the method; repeatable.")
    ] = None,
    integrator: Annotated[str, typer.Option("--integrator", help="euler, heun or rk4.")] = "euler",
    substeps: Annotated[int, typer.Option("--substeps", min=1, help="Integration steps per sample.")] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the method's random numbers.")] = 0,
    jobs: Annotated[int | None, typer.Option("--jobs", "-j", min=1, help="Threads; all cores if absent.")] = None,
) -> None:
    """Identify parameters of a model from recordings, with their uncertainty.

    The search begins at the values of the parameter set. All measured outputs of the sensors are fitted.
    Writes a parameter set that studies load, identify.json, and a report on the fitted and the held-out drives.
    """
    from harness.cli.options import ModelOptions, model_spec, pairs
    from harness.identification.contract import load_method, settings_of
    from harness.identification.data import step_of
    from harness.recordings import load_recording

    chosen = load_method(method)
    settings = settings_of(chosen, pairs(setting, "--setting"))
    _refuse_the_same(data, test or [])
    fitted, held_out = ([load_recording(path, channels) for path in paths] for paths in (data, test or []))
    options = ModelOptions(model, parameters, tyre, effect, sensors, values)
    step = step_of(fitted[0])
    spec = model_spec(options, fitted + held_out, integrator=integrator, substeps=substeps, step=step)
    problem, tests = _problem(spec, fitted, held_out, free, seed, jobs)
    console = Console(stderr=True)
    with console.status("compiling") as status:
        fit = chosen.identify(problem, settings, lambda text: status.update(f"{method}: {text}"))
        status.update("report")
        written = _write(problem, fit, tests, out)
    from harness.identification.report import answer

    Console().print(Text(answer(fit), style="bold"), soft_wrap=True)
    for path in written:
        Console().print(Text(str(path)), soft_wrap=True)


def _refuse_the_same(data: list[Path], test: list[Path]) -> None:
    """Refuse a held-out drive that is fitted as well."""
    fitted = {path.resolve() for path in data}
    for path in test:
        if path.resolve() in fitted:
            raise UserError(f"--test {path}: is fitted as well; validate the fit on a drive that was not fitted")


def _problem(
    spec: ModelSpec,
    fitted: list[xr.Dataset],
    held_out: list[xr.Dataset],
    free: str,
    seed: int,
    jobs: int | None,
) -> tuple[Problem, tuple[Drive, ...]]:
    """Return the problem and the held-out recordings."""
    from harness.identification.contract import Problem
    from harness.identification.innovations import Innovations

    names = tuple(name for name in (part.strip() for part in free.split(",")) if name)
    _check_free(spec, names)
    innovations = Innovations(spec, jobs=jobs)
    drives, tests = (
        tuple(innovations.drive(r, Path(str(r.attrs["file"])).stem) for r in group) for group in (fitted, held_out)
    )
    return Problem(innovations, drives, names, seed), tests


def _check_free(spec: ModelSpec, names: tuple[str, ...]) -> None:
    """Refuse names that the model does not have before anything is compiled."""
    from harness.common.registry import closest

    known = spec.model().parameter_names
    if not names:
        raise UserError(f"--free: name the parameters to estimate; the model has: {', '.join(known)}")
    for name in names:
        if name not in known:
            raise UserError(f"--free: the model has no parameter '{name}'{closest(name, known)}")


def _write(problem: Problem, fit: Any, tests: tuple[Drive, ...], out: Path) -> list[Path]:
    from harness.common.failures import Failures
    from harness.identification.report import document
    from harness.identification.result import judge, write_outcome
    from harness.reporting.document import Prose, plain, write

    failures = Failures(out)
    judged = failures.attempt(
        "the comparison with the recordings", lambda: list(judge(problem, fit, tests)), lambda _: []
    )
    not_made = [Prose(plain(sentence)) for sentence in failures.sentences]
    names = ", ".join(drive.name for drive in problem.drives)
    command = " ".join(["harness", *map(shlex.quote, sys.argv[1:])])
    return [
        *write_outcome(out, fit, judged, f"harness identify, method {fit.method}, on {names}"),
        *write(document(fit, judged, command, evidence=not_made or None), out, failures=failures),
    ]
