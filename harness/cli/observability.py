"""``harness observability``: can the states be determined from the measurements?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.declared import takes
from harness.cli.options import (
    DriveOption,
    ParameterOption,
    UnknownOption,
    VehicleOptions,
    drive_of,
    model_of,
)
from harness.cli.recorded_options import uncertain
from harness.common.errors import UserError


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
