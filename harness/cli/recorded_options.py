"""Options of the commands that take recordings, and the model that estimators believe on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from harness.cli.options import (
    MOST,
    RESULTS,
    DatabaseOption,
    JobsOption,
    MaybeModelOptions,
    ModelOptions,
    UnknownOption,
    model_of,
    pairs,
    quantity,
)
from harness.common.errors import UserError

if TYPE_CHECKING:
    import xarray as xr

    from harness.api.model import Model
    from harness.identification.measured_file import MeasuredStudy

RECORDING = "a part: lap.csv@0s:200s; with a map of its own: lap.csv@map.toml; repeatable."
ChannelsOption = Annotated[
    Path | None,
    typer.Option(
        "--channels", "-c", help="Channel map of the recordings that name none; columns are signals if absent."
    ),
]
FileArgument = Annotated[
    Path | None,
    typer.Argument(help="File of measured drives with the model and all that is asked; with it only --out and --jobs."),
]
TrainOption = Annotated[list[Path], typer.Option("--train", "-d", help=f"Recording to fit, or {RECORDING}")]
TestOption = Annotated[list[Path], typer.Option("--test", "-t", help=f"Held-out recording, or {RECORDING}")]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Folder of the results; of a file results/<command>-<name> if absent."),
]
FreeOption = Annotated[
    list[str] | None,
    typer.Option("--free", "-f", help="Parameters to fit, with commas between them; repeatable."),
]
AfterOption = Annotated[
    Path | None,
    typer.Option(
        "--after",
        metavar="RESULT",
        help="Result behind which drives were planned: its model and recordings and these; did they tell as much?",
    ),
]


@dataclass(frozen=True, kw_only=True)
class RecordedOptions:
    """Recordings, and what estimators believe of them, as options state it."""

    model: ModelOptions
    data: Annotated[list[Path], typer.Option("--data", "-d", help=f"Recording, or {RECORDING}")]
    channels: ChannelsOption = None
    databases: DatabaseOption = None
    step: Annotated[
        str | None,
        typer.Option("--step", help='Sample time of the estimators: "20 ms"; that of the recording if absent.'),
    ] = None
    unknown_inputs: UnknownOption = None
    process_noise: Annotated[
        list[str] | None,
        typer.Option(
            "--process-noise", metavar="STATE=VARIANCE", help='Per step: yaw_rate="4e-8 rad^2/s^2"; repeatable.'
        ),
    ] = None
    measurement_noise: Annotated[
        list[str] | None,
        typer.Option("--measurement-noise", metavar="OUTPUT=VARIANCE", help="Per sample; repeatable."),
    ] = None
    bank_map: Annotated[
        list[Path] | None,
        typer.Option("--bank-map", help="Recording of the same road, at least two, from which its bank is mapped."),
    ] = None
    inputs: Annotated[
        Literal["joined", "held"],
        typer.Option("--inputs", help="Recorded inputs run straight between samples, or are held as in a simulation."),
    ] = "joined"
    integrator: Annotated[
        Literal["euler", "heun", "rk4"], typer.Option("--integrator", help="How the model's equations are integrated.")
    ] = "rk4"
    substeps: Annotated[
        int | None,
        typer.Option("--substeps", min=1, max=MOST, help="Integration steps per sample; of at most 10 ms if absent."),
    ] = None
    jobs: JobsOption = None

    @property
    def unsure(self) -> dict[str, Any]:
        """Keys of the model for parameters that are not known for sure."""
        return {}

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
            if path.resolve() in [p.resolve() for p in self.bank_map or ()]:
                raise UserError(
                    f"--data {path}: no drive may use a bank estimated from itself; leave it out of --bank-map"
                )
        step = None if self.step is None else quantity(self.step, "s", "--step")
        databases = self.databases or ()
        read = [load_recording(path, self.channels, step, databases=databases) for path in self.data]
        if self.bank_map:
            mapped = [load_recording(path, self.channels, step, databases=databases) for path in self.bank_map]
            read = with_bank(mapped, read)[len(mapped) :]
        return [r.assign_attrs(name=name) for r, name in zip(read, names_of(read), strict=True)]

    def believed(self, recordings: Sequence[xr.Dataset]) -> Model:
        """Return the model that the estimators believe, its step that of the first recording.

        Raises:
            UserError: If it needs the bank of a road that nothing tells.
        """
        from harness.identification.data import step_of
        from harness.identification.measured_file import FINEST
        from harness.recordings.smooth.road_bank_map import BANK

        step = step_of(recordings[0])
        noise = {
            "process": pairs(self.process_noise, "--process-noise"),
            "measurement": pairs(self.measurement_noise, "--measurement-noise"),
        }
        model = model_of(
            self.model,
            integrator=self.integrator,
            substeps=self.substeps or math.ceil(step / FINEST - 1e-9),
            step=step,
            unknown_inputs=self.unknown_inputs,
            **self.unsure,
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
    entries = []
    for text in given or []:
        name, *settings = (part.strip() for part in text.split(","))
        entries.append({"name": name, **pairs(settings, f"{option} {name},")})
    return entries or None


@dataclass(frozen=True, kw_only=True)
class MeasuredOptions:
    """What identification and trace have in common: a file of measured drives, or a model and recordings."""

    file: FileArgument = None
    model: MaybeModelOptions
    train: TrainOption = field(default_factory=list)
    test: TestOption = field(default_factory=list)
    out: OutOption = None
    channels: ChannelsOption = None
    databases: DatabaseOption = None
    free: FreeOption = None
    after: AfterOption = None
    jobs: JobsOption = None

    def drives(self) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
        """Return the recordings to fit and those held out.

        Raises:
            UserError: If one cannot be read.
        """
        return self.read(self.train), self.read(self.test)

    def read(self, paths: Sequence[Path]) -> list[xr.Dataset]:
        """Return recordings with the channel map and the databases that are named.

        Raises:
            UserError: If one cannot be read.
        """
        from harness.recordings import load_recording

        return [load_recording(path, self.channels, databases=self.databases or ()) for path in paths]

    def of_file(self, command: str) -> tuple[MeasuredStudy, Path] | None:
        """Return the file of measured drives with the folder of its results; ``None`` without one.

        Raises:
            UserError: If other options are given with the file, or what is needed without one is not given.
        """
        from harness.identification.measured_file import MeasuredStudy

        if self.file is None:
            lacking = {
                "--model": self.model.vehicle or self.plant,
                "--train": self.train,
                "--out": self.out,
                **self.needed,
            }
            if missing := [option for option, given in lacking.items() if not given and option not in self.implied]:
                raise UserError(f"{command} a file of measured drives, or give {', '.join(missing)}")
            return None
        bare = type(self)(file=self.file, model=MaybeModelOptions(), out=self.out, jobs=self.jobs)
        if self != bare:
            raise UserError(
                f"{self.file} states model, recordings and all that is asked; give only --out and --jobs with it"
            )
        return MeasuredStudy.read(self.file), self.out or RESULTS / f"{command}-{self.file.stem}"

    @property
    def folder(self) -> Path:
        """Folder of the results: the one that is named, or one in that of the earlier result."""
        if self.out is None:
            assert self.after is not None
            return self.after / "after"
        if self.after is not None and self.out.resolve() == self.after.resolve():
            raise UserError(f"--out {self.out}: holds what --after goes on from; name another folder, or none")
        return self.out

    def nominal(self, **keys: Any) -> Model | None:
        """Return the model, with further keys that are not ``None``; ``None`` where it is that of the earlier result.

        Raises:
            UserError: If options or keys state something of the earlier result's model, which they would not change.
        """
        stated = {name: value for name, value in keys.items() if value is not None}
        if self.model.vehicle or self.after is None:
            return model_of(self.model, **{"integrator": "rk4", **stated})
        of_model = {
            "--parameters": self.model.parameters, "--tyre": self.model.tyre, "--effect": self.model.effects,
            "--sensors": self.model.sensors, "--set": self.model.values,
        }  # fmt: skip
        if idle := [option for option, value in of_model.items() if value] + [f"--{name}" for name in stated]:
            raise UserError(
                f"--after: the model is that of the earlier result as it was, without {', '.join(idle)}; leave that "
                "out, or name a model with --model"
            )
        return None

    @property
    def plant(self) -> dict[str, Any]:
        """What stands in place of a model."""
        return {}

    @property
    def needed(self) -> dict[str, Any]:
        """What is needed further without a file, by its option."""
        return {}

    @property
    def implied(self) -> tuple[str, ...]:
        """Options that an earlier result states."""
        return () if self.after is None else ("--model", "--out", "--test")
