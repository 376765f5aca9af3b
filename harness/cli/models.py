"""Commands on models alone: ``harness simulate`` and ``observability``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.cli.declared import takes
from harness.cli.options import (
    DriveOption,
    ParameterOption,
    SignalOption,
    UnknownOption,
    VehicleOptions,
    drive_of,
    model_of,
)
from harness.cli.recorded_options import uncertain
from harness.common.errors import UserError


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """A drive to simulate."""

    model: VehicleOptions
    drive: Annotated[str, typer.Option("--drive", help="Kind of drive; harness list drives shows them.")]
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv, .parquet, .nc, .mf4 or .mcap.")]
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


@dataclass(frozen=True, kw_only=True)
class ObservabilityOptions:
    """A model, and the drive along which its states are to be determined."""

    model: VehicleOptions
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the figure.")]
    unknown_inputs: UnknownOption = None
    unknown_parameters: ParameterOption = None
    drive: Annotated[str | None, typer.Option("--drive", help="Kind of drive; straight, sine, straight if absent.")] = (
        None
    )
    options: DriveOption = None


@takes(ObservabilityOptions)
def observability(task: ObservabilityOptions) -> None:
    """Check structural observability along a drive.

    Can the states be determined from the measurements? Straight ahead and under lateral excitation. With unknown
    parameters, also how well these can be known at best along the drive, and which of them it does not tell apart.
    """
    unsure = uncertain(task.unknown_parameters, "--unknown-parameter")
    inputs = task.unknown_inputs or []
    if unsure:
        spec = model_of(task.model.named, unknown_inputs=inputs or None, unknown_parameters=unsure).spec
    else:
        spec = model_of(task.model.named).spec
    profile = None
    if task.drive is not None:
        from harness.simulation.drives import profile_of

        profile = profile_of(spec, drive_of(task.drive, task.options))
    elif task.options:
        raise UserError("--option belongs to a drive; name it with --drive")
    from harness.cli.observability_report import report

    report(spec, [] if unsure else inputs, task.out, profile)
