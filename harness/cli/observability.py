"""``harness observability``: can the states be determined from the measurements?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
from harness.cli.recorded_options import ParameterOption, uncertain
from harness.common.errors import UserError


def observability(
    vehicle: Annotated[str, typer.Argument(help="Vehicle; harness list vehicles shows them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the figure.")],
    unknown_input: Annotated[
        list[str] | None, typer.Option("--unknown-input", help="Input to be estimated; repeatable.")
    ] = None,
    unknown_parameter: ParameterOption = None,
    drive: Annotated[
        str | None, typer.Option("--drive", help="Kind of drive; straight, sine, straight if absent.")
    ] = None,
    option: DriveOption = None,
    values: SetOption = None,
    parameters: ParametersOption = None,
    tyre: TyreOption = None,
    effect: EffectOption = None,
    sensors: SensorsOption = None,
) -> None:
    """Check structural observability along a drive.

    Can the states be determined from the measurements? Straight ahead and under lateral excitation. With unknown
    parameters, also how well these can be known at best along the drive, and which of them it does not tell apart.
    """
    options = ModelOptions(vehicle, parameters, tyre, effect, sensors, values)
    unknown = uncertain(unknown_parameter, "--unknown-parameter")
    inputs = unknown_input or []
    if unknown:
        spec = model_of(options, unknown_inputs=inputs or None, unknown_parameters=unknown).spec
    else:
        spec = model_of(options).spec
    profile = None
    if drive is not None:
        from harness.simulation.drives import profile_of

        profile = profile_of(spec, drive_of(drive, option))
    elif option:
        raise UserError("--option belongs to a drive; name it with --drive")
    from harness.cli.observability_report import report

    report(spec, [] if unknown else inputs, out, profile)
