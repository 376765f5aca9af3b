"""``harness simulate``: one drive to a file, for a quick look."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import DriveOption, SignalOption, VehicleOptions, drive_of, model_of


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """A drive to simulate."""

    model: VehicleOptions
    drive: Annotated[str, typer.Option("--drive", help="Kind of drive; harness list drives shows them.")]
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv, .parquet or .nc.")]
    options: DriveOption = None
    signals: SignalOption = None
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Seed of process and measurement noise; none if absent."),
    ] = None


@takes(SimulateOptions)
def simulate(task: SimulateOptions) -> None:
    """Simulate one drive and write it to a file.

    One column per signal, in SI units, under the names that harness list signals shows. Inputs run straight from sample
    to sample and equations are integrated finely, as harness estimate, identify and trace take a recording.
    """
    from harness.api.recordings import simulate as simulated
    from harness.identification.measured_file import FINE
    from harness.recordings.read.write import check_target, write_recording

    check_target(task.out)
    model = model_of(task.model.named, integrator=FINE)
    recording = simulated(model, drive_of(task.drive, task.options), task.seed, task.signals or [])
    write_recording(recording, task.out)
    samples, signals = recording.sizes["time"], len(recording.data_vars)
    Console().print(Text(f"{task.out}: {samples} samples of {signals} signals"), soft_wrap=True)
