"""A loop file: a model, drives to fit and drives to judge on, each a span of a recording.

::

    title = "Does the bicycle model hold on the proving ground?"
    recordings = "../../../shared/measured/genesis_g80"   # from this file; the loop is skipped where it is absent
    channels = "../channels/genesis_g80.toml"
    step = "20 ms"                                        # slower than the signals' own filters
    stated_noise = true                                   # noise is held as stated, not refitted
    bank_map = true                                       # the fitted drives teach the bank of the road
    free = ["yaw_inertia"]                                # nominal parameters to refit; cornering stiffnesses if absent

    [model]                                               # as [plant] in a study
    vehicle = "car"
    tyre = "linear"

    [[train]]
    file = "slow.mat"
    span = ["10 s", "200 s"]

    [[test]]
    file = "fast.mat"

    [[exclude]]
    effect = "payload_shift"
    reason = "nobody moved in the car"

    [changed]                                             # traced again from the amended model, all of it held
    question = "Did the tyres change?"
    train = [{ file = "taped.csv" }]
    test = [{ file = "taped_again.csv" }]
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field, StrictBool, StrictInt, StrictStr, ValidationError

from harness.configure.file import ModelTable, Name, Quantity, Table
from harness.configure.problems import Problems, add_validation_errors
from harness.errors import UserError
from harness.loop.amend import ESTIMATORS
from harness.measured import load_recording
from harness.measured.bank import with_bank
from harness.units import to_si
from models.registry import closest, names

SHORTEST = 20.0
"""s; what shorter drives show is as much the first state as the vehicle."""


class SpanTable(Table):
    """A span of a recording."""

    file: Name = Field(description="recording, from the folder of recordings")
    name: StrictStr = Field(default="", description="in reports; the name of the file if absent")
    span: tuple[Quantity, Quantity] | None = Field(default=None, description="first and last moment; all if absent")


class ExcludeTable(Table):
    """An effect that is not to be tried."""

    effect: Name = Field(description="file in models/effects")
    reason: Name = Field(description="why it cannot be there")


class ChangedTable(Table):
    """Drives in which the vehicle may be another one than in those fitted."""

    question: Name = Field(description="title of its report")
    train: list[SpanTable] = Field(min_length=1, description="drives to fit")
    test: list[SpanTable] = Field(min_length=1, description="drives to judge on")


class LoopFile(Table):
    """The whole file."""

    title: Name = Field(description="title of the report")
    recordings: Name = Field(description="folder of the recordings, from this file")
    channels: StrictStr = Field(default="", description="channel map, from this file; signal names if absent")
    step: Quantity = Field(default="20 ms", description="sample time; slower than the signals' own filters")
    rounds: Annotated[StrictInt, Field(ge=1, le=20)] = Field(default=8, description="largest number of additions")
    estimators: list[Name] = Field(
        default=list(ESTIMATORS), description="estimators to run on the held-out drives with both models"
    )
    stated_noise: StrictBool = Field(default=False, description="hold the noise that the model states")
    bank_map: StrictBool = Field(default=False, description="map the bank of the road over the path of fitted drives")
    free: list[Name] = Field(default_factory=list, description="nominal parameters to refit; stiffnesses if absent")
    model: ModelTable = Field(description="the nominal model, as [plant] in a study")
    train: list[SpanTable] = Field(min_length=1, description="drives to fit")
    test: list[SpanTable] = Field(min_length=1, description="drives to judge on")
    exclude: list[ExcludeTable] = Field(default_factory=list, description="effects that are not to be tried")
    changed: ChangedTable | None = Field(default=None, description="drives in which the vehicle may have changed")


@dataclass(frozen=True)
class LoopStudy:
    """A loop file, read.

    Attributes:
        path: Of the file.
        raw: Its content.
        folder: Of the recordings.
        channels: Channel map, if any.
        step: Sample time in s.
    """

    path: Path
    raw: LoopFile
    folder: Path
    channels: Path | None
    step: float

    @property
    def excluded(self) -> frozenset[str]:
        """Effects that are not tried."""
        return frozenset(e.effect for e in self.raw.exclude)

    def drives(self) -> dict[str, list[xr.Dataset]]:
        """Return the recordings by key: ``train``, ``test``, and those of ``[changed]`` as ``changed.train``, ...

        Raises:
            UserError: If a recording cannot be read, a span is not in it or too short, or a fitted span is judged on.
        """
        wanted = {"train": self.raw.train, "test": self.raw.test}
        if self.raw.changed is not None:
            wanted |= {"changed.train": self.raw.changed.train, "changed.test": self.raw.changed.test}
        whole = {f: self._load(f) for f in dict.fromkeys(s.file for spans in wanted.values() for s in spans)}
        if self.raw.bank_map:
            whole = self._with_bank(whole)
        taken: list[tuple[str, str, float, float]] = []
        found: dict[str, list[xr.Dataset]] = {}
        for key, spans in wanted.items():
            found[key] = []
            for i, span in enumerate(spans):
                where = f"{self.path}: {key}[{i}]"
                start, stop = self._ends(span, whole[span.file], where)
                for other, file, first, last in taken:
                    if file == span.file and first < stop and start < last:
                        raise UserError(f"{where}.span: overlaps {other}; keep every drive for one purpose")
                taken.append((f"{key}[{i}]", span.file, start, stop))
                found[key].append(_cut(whole[span.file], start, stop, span))
        return found

    def _with_bank(self, whole: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Return the recordings with the bank of the road; those that are fitted teach it, as a whole."""
        fitted = list(dict.fromkeys(s.file for s in self.raw.train))
        both = [s.file for s in self.raw.test if s.file in fitted]
        if both:
            raise UserError(f"{self.path}: bank_map: '{both[0]}' is fitted, so it teaches the road; judge on another")
        others = [f for f in whole if f not in fitted]
        banked = with_bank([whole[f] for f in fitted], [whole[f] for f in others])
        return dict(zip([*fitted, *others], banked, strict=True))

    def _load(self, file: str) -> xr.Dataset:
        if not (self.folder / file).exists():
            beside = sorted(p.name for p in self.folder.iterdir())
            raise UserError(f"{self.path}: there is no recording '{file}' in {self.folder}{closest(file, beside)}")
        return load_recording(self.folder / file, self.channels, self.step)

    def _ends(self, span: SpanTable, recording: xr.Dataset, where: str) -> tuple[float, float]:
        last = float(recording["time"][-1])
        start, stop = (0.0, last) if span.span is None else (to_si(t, "s", f"{where}.span") for t in span.span)
        if not 0.0 <= start < stop <= last:
            raise UserError(f"{where}.span: {start:g} to {stop:g} s; '{span.file}' runs from 0 to {last:.1f} s")
        if stop - start < SHORTEST:
            raise UserError(f"{where}.span: {stop - start:.1f} s decide nothing; take at least {SHORTEST:g} s")
        return start, stop


def _cut(recording: xr.Dataset, start: float, stop: float, span: SpanTable) -> xr.Dataset:
    time = recording["time"]
    part = recording.isel(time=np.flatnonzero((time >= start) & (time <= stop)))
    name = span.name or Path(span.file).name.split(".")[0]
    return part.assign_coords(time=part["time"] - part["time"][0]).assign_attrs(name=name)


def load_loop(path: Path) -> LoopStudy:
    """Read a loop file.

    Raises:
        UserError: If anything in it is wrong; one line per problem.
    """
    problems = Problems(str(path))
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: the loop file cannot be read: {getattr(error, 'strerror', error)}") from None
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: not valid TOML: {error}") from None
    try:
        raw = LoopFile.model_validate(content)
    except ValidationError as error:
        add_validation_errors(problems, error, LoopFile)
        problems.stop()
        raise
    known = names("models.effects")
    for i, excluded in enumerate(raw.exclude):
        if excluded.effect not in known:
            message = f"there is no effect '{excluded.effect}'{closest(excluded.effect, known)}"
            problems.add(f"exclude[{i}].effect", message)
    problems.stop()
    channels = path.parent / raw.channels if raw.channels else None
    step = to_si(raw.step, "s", f"{path}: step")
    if step <= 0:
        raise UserError(f"{path}: step: {step:g} s must be positive")
    return LoopStudy(path, raw, path.parent / raw.recordings, channels, step)
