"""``harness simulate``: one drive to a file, for a quick look."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.options import (
    DriveOption,
    EffectOption,
    ModelOptions,
    ParametersOption,
    SensorsOption,
    SetOption,
    TyreOption,
    drive_of,
    model_of,
)


def simulate(
    vehicle: Annotated[str, typer.Argument(help="Vehicle; harness list vehicles shows them.")],
    drive: Annotated[str, typer.Option("--drive", help="Kind of drive; harness list drives shows them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv, .parquet or .nc.")],
    option: DriveOption = None,
    values: SetOption = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: SensorsOption = None,
    signal: Annotated[list[str] | None, typer.Option("--signal", help="Further quantity to write; repeatable.")] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Seed of process and measurement noise; none if absent."),
    ] = None,
) -> None:
    """Simulate one drive and write it to a file.

    One column per signal, in SI units, under the names that harness list signals shows. Inputs run straight from sample
    to sample and equations are integrated finely, as harness estimate, identify and trace take a recording.
    """
    from harness.api.recordings import simulate as simulated
    from harness.identification.measured_file import FINE
    from harness.recordings.read.write import check_target, write_recording

    check_target(out)
    model = model_of(ModelOptions(vehicle, parameters, tyre, effect, sensors, values), integrator=FINE)
    recording = simulated(model, drive_of(drive, option), seed, signal or [])
    write_recording(recording, out)
    samples, signals = recording.sizes["time"], len(recording.data_vars)
    Console().print(Text(f"{out}: {samples} samples of {signals} signals"), soft_wrap=True)
