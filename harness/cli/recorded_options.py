"""What ``harness estimate`` and ``harness tune --data`` share: recordings, and the model that estimators believe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from harness.cli.options import MOST, ModelOptions, model_of, pairs, quantity
from harness.common.errors import UserError

if TYPE_CHECKING:
    import xarray as xr

    from harness.api.model import Model
    from harness.recorded.run import Inputs

BANK = "bank_angle"
"""Signal that ``--bank-map`` makes."""

DataOption = Annotated[
    list[Path], typer.Option("--data", "-d", help="Recording, or a part: lap.csv@0s:200s; repeatable.")
]
ChannelsOption = Annotated[
    Path | None, typer.Option("--channels", "-c", help="Channel map of the recordings; signal names if absent.")
]
StepOption = Annotated[
    str | None, typer.Option("--step", help='Sample time of the estimators: "20 ms"; that of the recording if absent.')
]
UnknownOption = Annotated[
    list[str] | None,
    typer.Option("--unknown-input", help="Input that is estimated as a random walk beside the states; repeatable."),
]
ParameterOption = Annotated[
    list[str] | None,
    typer.Option(
        "--unknown-parameter",
        metavar="NAME[,prior=..][,walk=..]",
        help='Parameter to estimate beside the states: trailer_mass,prior="4 t"; repeatable.',
    ),
]
ConsideredOption = Annotated[
    list[str] | None,
    typer.Option(
        "--considered-parameter",
        metavar="NAME[,prior=..]",
        help="Parameter whose uncertainty is reckoned with and whose value is left alone; repeatable.",
    ),
]
ProcessOption = Annotated[
    list[str] | None,
    typer.Option("--process-noise", metavar="STATE=VARIANCE", help='Per step: yaw_rate="4e-8 rad^2/s^2"; repeatable.'),
]
MeasurementOption = Annotated[
    list[str] | None,
    typer.Option("--measurement-noise", metavar="OUTPUT=VARIANCE", help="Per sample; repeatable."),
]
BankOption = Annotated[
    list[Path] | None,
    typer.Option("--bank-map", help="Recording of the same road, at least two, from which its bank is mapped."),
]
InputsOption = Annotated[
    Literal["joined", "held"],
    typer.Option("--inputs", help="Recorded inputs run straight between samples, or are held as in a simulation."),
]
IntegratorOption = Annotated[
    Literal["euler", "heun", "rk4"], typer.Option("--integrator", help="How the model's equations are integrated.")
]
SubstepsOption = Annotated[
    int | None,
    typer.Option("--substeps", min=1, max=MOST, help="Integration steps per sample; of at most 10 ms if absent."),
]


@dataclass(frozen=True)
class RecordedOptions:
    """What estimators believe of recordings, as options state it.

    Attributes:
        model: Vehicle, values, tyre, effects, sensors.
        data: Recordings.
        channels: Channel map, if any.
        step: Sample time with unit, if given.
        unknown: Inputs that are not known.
        process: ``STATE=VARIANCE``.
        measurement: ``OUTPUT=VARIANCE``.
        inputs: How recorded inputs run between samples.
        integrator: Scheme.
        substeps: Integration steps per sample, if given.
        bank: Recordings that map the bank of the road.
        jobs: Threads, if given.
        parameters: Parameters to estimate, ``NAME[,NAME=VALUE...]``.
        considered: Parameters whose uncertainty is reckoned with.
    """

    model: ModelOptions
    data: Sequence[Path]
    channels: Path | None = None
    step: str | None = None
    unknown: list[str] | None = None
    process: list[str] | None = None
    measurement: list[str] | None = None
    inputs: Inputs = "joined"
    integrator: str = "rk4"
    substeps: int | None = None
    bank: Sequence[Path] = ()
    jobs: int | None = None
    parameters: list[str] | None = None
    considered: list[str] | None = None

    def recordings(self) -> list[xr.Dataset]:
        """Return the recordings, each with a name of its own.

        Raises:
            UserError: If one cannot be read, or is given twice, or maps the bank that it drives on.
        """
        from harness.identification.measured_file import names_of
        from harness.recordings import load_recording
        from harness.recordings.smooth.road_bank_map import with_bank

        for i, path in enumerate(self.data):
            if path.resolve() in [p.resolve() for p in self.data[:i]]:
                raise UserError(f"--data {path}: is given twice")
            if path.resolve() in [p.resolve() for p in self.bank]:
                raise UserError(
                    f"--data {path}: no drive may use a bank estimated from itself; leave it out of --bank-map"
                )
        step = None if self.step is None else quantity(self.step, "s", "--step")
        read = [load_recording(path, self.channels, step) for path in self.data]
        if self.bank:
            mapped = [load_recording(path, self.channels, step) for path in self.bank]
            read = with_bank(mapped, read)[len(mapped) :]
        return [r.assign_attrs(name=name) for r, name in zip(read, names_of(read), strict=True)]

    def believed(self, recordings: Sequence[xr.Dataset]) -> Model:
        """Return the model that the estimators believe, its step that of the first recording.

        Raises:
            UserError: If it needs the bank of a road that nothing tells.
        """
        from harness.identification.data import step_of
        from harness.identification.measured_file import FINEST

        step = step_of(recordings[0])
        noise = {
            "process": pairs(self.process, "--process-noise"),
            "measurement": pairs(self.measurement, "--measurement-noise"),
        }
        model = model_of(
            self.model,
            integrator=self.integrator,
            substeps=self.substeps or math.ceil(step / FINEST - 1e-9),
            step=step,
            unknown_inputs=self.unknown,
            unknown_parameters=uncertain(self.parameters, "--unknown-parameter"),
            considered_parameters=uncertain(self.considered, "--considered-parameter"),
            noise=noise,
        )
        lacking = [r.attrs["name"] for r in recordings if BANK in model.inputs and BANK not in r]
        if lacking:
            raise UserError(
                f"--data: {lacking[0]} lacks '{BANK}', which the effect road_bank_measured reads: give at least two "
                "recordings of the same road with --bank-map, or a channel of it"
            )
        return model


def uncertain(given: list[str] | None, option: str) -> list[dict[str, Any]] | None:
    """Return entries of ``unknown_parameters`` that are stated as ``NAME[,prior=VALUE][,walk=VALUE]``."""
    found = []
    for text in given or []:
        name, *settings = (part.strip() for part in text.split(","))
        found.append({"name": name, **pairs(settings, f"{option} {name},")})
    return found or None
