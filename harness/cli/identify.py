"""``harness identify``: parameters from recordings, with a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import MOST, SeedOption, command, listed, model_of, pairs, printed
from harness.cli.recorded_options import IntegratorOption, MeasuredOptions
from harness.common.stages import showing


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(MeasuredOptions):
    """A model to fit to recordings."""

    method: Annotated[str, typer.Option("--method", help="likelihood, swarm or em.")] = "likelihood"
    settings: Annotated[
        list[str] | None, typer.Option("--setting", metavar="NAME=VALUE", help="Setting of the method; repeatable.")
    ] = None
    integrator: IntegratorOption = "rk4"
    substeps: Annotated[int, typer.Option("--substeps", min=1, max=MOST, help="Integration steps per sample.")] = 1
    seed: SeedOption = 0


@takes(IdentifyOptions)
def identify(task: IdentifyOptions) -> None:
    """Identify parameters of a model from recordings, with their uncertainty.

    Takes a file of measured drives, such as studies/identify/genesis.toml, or a model and recordings. The search begins
    at the values of the parameter set. All measured outputs of the sensors are fitted.
    Writes a parameter set that studies load, identify.json, and a report on the fitted and the held-out drives.
    """
    from harness.api.identification import identified_file
    from harness.api.identification import identify as identified
    from harness.api.recordings import read_recording

    if (of_file := task.of_file("identify")) is not None:
        study, out = of_file
        if study.absent:
            Console().print(Text(study.absent), soft_wrap=True)
            return
        fit = identified_file(study, task.jobs)
    else:
        assert task.out is not None
        out, free = task.out, listed(task.free or [])
        fit = identified(
            model_of(task.model, integrator=task.integrator, substeps=task.substeps),
            [read_recording(path, task.channels) for path in task.train],
            free,
            test=[read_recording(path, task.channels) for path in task.test],
            method=task.method,
            settings=pairs(task.settings, "--setting"),
            seed=task.seed,
            jobs=task.jobs,
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
