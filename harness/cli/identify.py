"""``harness identify``: parameters from recordings, with a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    MOST,
    EffectOption,
    JobsOption,
    ParametersOption,
    RecordedSensorsOption,
    SetOption,
    TyreOption,
)
from harness.cli.recorded_options import IntegratorOption
from harness.common.stages import showing


def identify(
    model: Annotated[str, typer.Option("--model", "-m", help="Vehicle; harness list vehicles shows them.")],
    data: Annotated[
        list[Path], typer.Option("--data", "-d", help="Recording to fit, or a part: lap.csv@0s:200s; repeatable.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of parameters.toml, identify.json and the report.")],
    free: Annotated[
        list[str] | None,
        typer.Option("--free", "-f", help="Parameters to estimate, comma-separated; repeatable; empty lists them."),
    ] = None,
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
    integrator: IntegratorOption = "rk4",
    substeps: Annotated[int, typer.Option("--substeps", min=1, max=MOST, help="Integration steps per sample.")] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the method's random numbers.")] = 0,
    jobs: JobsOption = None,
) -> None:
    """Identify parameters of a model from recordings, with their uncertainty.

    The search begins at the values of the parameter set. All measured outputs of the sensors are fitted.
    Writes a parameter set that studies load, identify.json, and a report on the fitted and the held-out drives.
    """
    from harness.api.identification import identify as identified
    from harness.api.recordings import read_recording
    from harness.cli.options import ModelOptions, command, listed, model_of, pairs

    chosen = model_of(
        ModelOptions(model, parameters, tyre, effect, sensors, values), integrator=integrator, substeps=substeps
    )
    found = identified(
        chosen,
        [read_recording(path, channels) for path in data],
        listed(free or []),
        test=[read_recording(path, channels) for path in test or []],
        method=method,
        settings=pairs(setting, "--setting"),
        seed=seed,
        jobs=jobs,
    )
    for note in found.notes:
        Console(stderr=True).print(Text(f"warning: {note}", style="yellow"), soft_wrap=True)
    with showing(Console(stderr=True), "writing the report"):
        written = found.report(out, command())
    console, estimates = Console(), found.estimates
    console.print(Text(found.answer, style="bold"), soft_wrap=True)
    for name, e in estimates[estimates.index.isin(listed(free or []))].iterrows():
        unit = f" {e.unit}" if e.unit and e.unit != "dimensionless" else ""
        interval = f"95 % interval {e.lower:.4g} to {e.upper:.4g}" if e.lower < e.upper else "no interval"
        console.print(Text(f"{name}: {e.start:.4g} to {e.value:.4g}{unit}, {interval}; {e.verdict}"), soft_wrap=True)
    for path in written:
        console.print(Text(str(path)), soft_wrap=True)
