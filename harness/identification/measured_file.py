"""A file of measured drives for ``harness identify`` and ``harness trace``: model, drives to fit, held-out drives.

::

    title = "Does the bicycle model hold on the proving ground?"
    recordings = "../../../shared/measured/genesis_g80"   # from this file; skipped where it is absent
    channels = "../channels/genesis_g80.toml"
    step = "20 ms"                                        # slower than the signals' own filters
    bank_map = true                                       # the bank of the road is estimated from the fitted drives
    free = ["yaw_inertia"]                                # parameters to fit; cornering stiffnesses if absent

    [model]                                               # as [plant] in a study
    vehicle = "car"
    tyre = "linear"

    [[train]]
    file = "slow.mat"
    span = ["10 s", "200 s"]

    [[test]]
    file = "fast.mat"

    [[exclude]]                                           # of a trace, as are the next two
    effect = "payload_shift"
    reason = "nobody moved in the car"

    [changed]                                             # traced again from the amended model, all of it held
    question = "Did the tyres change?"
    train = [{ file = "taped.csv" }]
    test = [{ file = "taped_again.csv" }]

    [worth]                                               # this study with the amended plant and both beliefs
    study = "../mass.toml"                                # from this file
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import xarray as xr
from pydantic import Field, StrictBool, StrictInt, StrictStr

from harness.common import locations
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import closest
from harness.common.units import to_si
from harness.config import ModelSpec, resolve_single
from harness.config.key_types import Name, Quantity, StrictTable
from harness.config.problems import Problems, validated
from harness.config.schema import ModelTable
from harness.estimation.contract import traced
from harness.identification.data import steered
from harness.models.roles import EFFECTS
from harness.recordings.read.load import load_recording
from harness.recordings.read.origin import ORIGIN
from harness.recordings.smooth.road_bank_map import with_bank

SHORTEST = 20.0
"""s; shorter drives depend as much on the first state as on the vehicle."""

SHORT_BY = 0.05
"""s by which a drive may be shorter than that, as it is stated to 0.1 s: a recorder loses a sample at either end."""

FINE = "rk4"
"""How equations are integrated over recordings."""

FINEST = 0.01
"""s; longest integration step: errors of integration look like a lag of the steering."""

MEASURED = "measured_file"
"""Key of the origin of a recording that a file of measured drives states: its path, with ``key`` and ``place``."""


def finely(table: Mapping[str, Any], step: float, where: str) -> ModelSpec:
    """Return a model as a study states one, integrated finely.

    Args:
        table: Keys and values as in ``[plant]``. Integrator and substeps are its own if it states them, as for a
            vehicle so small that its tyres damp within a step.
        step: Sample time in s.
        where: Named in errors.

    Raises:
        UserError: If there cannot be such a model.
    """
    return resolve_single({**_fine(step), **table, "step": step}, where)


def _fine(step: float) -> dict[str, Any]:
    return {"integrator": FINE, "substeps": math.ceil(step / FINEST)}


def fitted_parameters(spec: ModelSpec, named: Sequence[str], where: str) -> tuple[str, ...]:
    """Return the parameters to fit: those named, or the cornering stiffnesses.

    Raises:
        UserError: If the model has no parameter of a name, or one is named twice.
    """
    model = spec.model()
    refuse_repeated(named, where)
    for i, name in enumerate(named):
        if name not in model.parameter_names:
            raise UserError(f"{where}[{i}]: the model has no parameter '{name}'{closest(name, model.parameter_names)}")
    return tuple(named) or tuple(p.name for p in model.parameters if p.unit in ("N/rad", "1/rad"))


def refuse_repeated(names: Sequence[str], where: str) -> None:
    """Refuse a name that stands twice among several: the second may have been meant to be another.

    Raises:
        UserError: If there is one.
    """
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            raise UserError(f"{where}: '{name}' is named {names.count(name)} times; name it once")


class SpanTable(StrictTable):
    """A span of a recording."""

    file: Name = Field(description="recording, from the folder of recordings")
    name: StrictStr = Field(default="", description="in reports; the name of the file if absent")
    span: tuple[Quantity, Quantity] | None = Field(default=None, description="start and end time; all if absent")
    channels: StrictStr = Field(default="", description="channel map of this recording; that of all if absent")


class ExcludeTable(StrictTable):
    """An effect that is not to be tried."""

    effect: Name = Field(description="file in models/effects")
    reason: Name = Field(description="why it cannot be there")


class ChangedTable(StrictTable):
    """Drives in which the vehicle may have changed."""

    question: Name = Field(description="title of its report")
    train: list[SpanTable] = Field(min_length=1, description="drives to fit")
    test: list[SpanTable] = Field(min_length=1, description="held-out drives")


class WorthTable(StrictTable):
    """A study with the amended plant, in which the estimators believe either model."""

    study: Name = Field(description="study file, from this file; of the same vehicle and tyre")
    repeats: Annotated[StrictInt, Field(ge=1)] = Field(
        default=8, description="runs of each level and drive with other noise"
    )


class MeasuredFile(StrictTable):
    """The whole file; ``method`` and ``settings`` are of an identification, ``rounds`` and all below of a trace."""

    title: Name = Field(description="title of the report")
    recordings: Name = Field(description="folder of the recordings, from this file")
    channels: StrictStr = Field(
        default="", description="channel map: a name, or a path from this file; signal names if absent"
    )
    step: Quantity = Field(default="20 ms", description="sample time; slower than the signals' own filters")
    bank_map: StrictBool = Field(default=False, description="map the bank of the road over the path of fitted drives")
    free: list[Name] = Field(default_factory=list, description="parameters to fit; stiffnesses if absent")
    model: ModelTable = Field(description="the nominal model, as [plant] in a study")
    train: list[SpanTable] = Field(min_length=1, description="drives to fit")
    test: list[SpanTable] = Field(min_length=1, description="held-out drives")
    method: Name = Field(default="likelihood", description="file in harness/identification/methods")
    settings: dict[str, Any] = Field(default_factory=dict, description="settings of the method")
    rounds: Annotated[StrictInt, Field(ge=1, le=20)] | None = Field(
        default=None, description="largest number of additions"
    )
    estimators: list[Name] = Field(
        default_factory=lambda: list(traced()), description="estimators to run on the held-out drives with both models"
    )
    stated_noise: StrictBool = Field(default=False, description="hold the noise that the model states")
    exclude: list[ExcludeTable] = Field(default_factory=list, description="effects that are not to be tried")
    changed: ChangedTable | None = Field(default=None, description="drives in which the vehicle may have changed")
    worth: WorthTable | None = Field(default=None, description="study in which the gain of the amendment is measured")


@dataclass(frozen=True)
class MeasuredStudy:
    """Such a file, read.

    Attributes:
        path: Of the file.
        raw: Its content.
        folder: Of the recordings.
        channels: Channel map, if any.
        step: Sample time in s.
    """

    path: Path
    raw: MeasuredFile
    folder: Path
    channels: Path | None
    step: float

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file about measured drives.

        Raises:
            UserError: If anything in it is wrong; one line per problem.
        """
        problems = Problems(str(path))
        raw = validated(read_toml(path), MeasuredFile, problems)
        problems.stop()
        assert raw is not None
        effects = EFFECTS.names()
        for i, excluded in enumerate(raw.exclude):
            if excluded.effect not in effects:
                message = f"there is no effect '{excluded.effect}'{closest(excluded.effect, effects)}"
                problems.add(f"exclude[{i}].effect", message)
        problems.stop()
        step = to_si(raw.step, "s", f"{path}: step")
        if step <= 0:
            raise UserError(f"{path}: step: {step:g} s must be positive")
        return cls(path, raw, path.parent / raw.recordings, _map(path, raw.channels), step)

    @property
    def absent(self) -> str:
        """Why the study is skipped, in a sentence; empty where the recordings are."""
        return "" if self.folder.is_dir() else f"{self.path}: skipped, there is no folder {self.folder} of recordings"

    def spans(self) -> dict[str, list[SpanTable]]:
        """Return the spans by key; those of ``[changed]`` as ``changed.train``, ``changed.test``."""
        spans, changed = {"train": self.raw.train, "test": self.raw.test}, self.raw.changed
        return spans if changed is None else spans | {"changed.train": changed.train, "changed.test": changed.test}

    @property
    def excluded(self) -> frozenset[str]:
        """Effects that are not tried."""
        return frozenset(e.effect for e in self.raw.exclude)

    def drives(self) -> dict[str, list[xr.Dataset]]:
        """Return the recordings by the key of the file that names them, with a steering-wheel angle.

        Where a recording holds only the angle of the road wheels, it is that times the stated ratio.

        Raises:
            UserError: If a recording cannot be read, a span is not in it or too short, or a span is both fitted and
                held out.
        """
        wanted = self.spans()
        every = [s for spans in wanted.values() for s in spans]
        own = {s.file: _map(self.path, s.channels) for s in every if s.channels}
        whole = {f: self._load(f, own.get(f, self.channels)) for f in dict.fromkeys(s.file for s in every)}
        if self.raw.bank_map:
            whole = self._with_bank(whole)
        taken: list[tuple[str, str, float, float]] = []
        parts: dict[str, list[xr.Dataset]] = {}
        for key, spans in wanted.items():
            parts[key] = []
            for i, span in enumerate(spans):
                where = f"{self.path}: {key}[{i}]"
                start, stop = self._ends(span, whole[span.file], where)
                for other, file, first, last in taken:
                    if file == span.file and first < stop and start < last:
                        raise UserError(f"{where}.span: overlaps {other}; use every drive for one purpose only")
                taken.append((f"{key}[{i}]", span.file, start, stop))
                parts[key].append(_cut(whole[span.file], start, stop, span))
        values = self.nominal().values
        return {key: [self._from_here(steered(r, values), key, i) for i, r in enumerate(p)] for key, p in parts.items()}

    def _from_here(self, recording: xr.Dataset, key: str, place: int) -> xr.Dataset:
        """Return a recording whose origin is this file, which is how its span, step and bank come again."""
        origin = {MEASURED: str(self.path.resolve()), "key": key, "place": place}
        return recording.assign_attrs({ORIGIN: json.dumps(origin)})

    @property
    def stated(self) -> dict[str, Any]:
        """Keys of the nominal model, so that ``harness.model`` makes the same one."""
        return {**_fine(self.step), **self.raw.model.model_dump(exclude_unset=True)}

    def nominal(self) -> ModelSpec:
        """Return the nominal model, integrated finely.

        Raises:
            UserError: If the file states one that cannot be.
        """
        return finely(self.raw.model.model_dump(exclude_unset=True), self.step, f"{self.path}: model")

    def fitted_parameters(self) -> tuple[str, ...]:
        """Return the parameters to fit: those that the file names, or the cornering stiffnesses.

        Raises:
            UserError: If the model has no parameter of that name.
        """
        return fitted_parameters(self.nominal(), self.raw.free, f"{self.path}: free")

    def _with_bank(self, whole: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Return the recordings with the bank of the road; it is estimated from the fitted ones."""
        fitted = list(dict.fromkeys(s.file for s in self.raw.train))
        both = [s.file for s in self.raw.test if s.file in fitted]
        if both:
            raise UserError(
                f"{self.path}: bank_map: '{both[0]}' is fitted, so the map is estimated from it; hold out another one"
            )
        others = [f for f in whole if f not in fitted]
        banked = with_bank([whole[f] for f in fitted], [whole[f] for f in others])
        return dict(zip([*fitted, *others], banked, strict=True))

    def _load(self, file: str, channels: Path | None) -> xr.Dataset:
        if not (self.folder / file).exists():
            present = sorted(p.name for p in self.folder.iterdir())
            raise UserError(f"{self.path}: there is no recording '{file}' in {self.folder}{closest(file, present)}")
        return load_recording(self.folder / file, channels, self.step)

    def _ends(self, span: SpanTable, recording: xr.Dataset, where: str) -> tuple[float, float]:
        last = float(recording["time"][-1])
        start, stop = (0.0, last) if span.span is None else (to_si(t, "s", f"{where}.span") for t in span.span)
        if not 0.0 <= start < stop <= last + SHORT_BY:
            raise UserError(f"{where}.span: {start:g} to {stop:g} s; '{span.file}' runs from 0 to {last:.1f} s")
        if stop - start < SHORTEST - SHORT_BY:
            raise UserError(f"{where}.span: {stop - start:.1f} s are too short; take at least {SHORTEST:g} s")
        return start, stop


def _map(path: Path, named: str) -> Path | None:
    """Return a channel map that a file names: by its name, or by a path from the file; ``None`` if it names none."""
    if not named:
        return None
    local = path.parent / named
    return local if local.suffix else locations.find(locations.CHANNELS, named)


def _cut(recording: xr.Dataset, start: float, stop: float, span: SpanTable) -> xr.Dataset:
    time = recording["time"]
    part = recording.isel(time=np.flatnonzero((time >= start) & (time <= stop)))
    name = span.name or Path(span.file).name.split(".")[0]
    part = part.assign_coords(time=part["time"] - part["time"][0]).assign_attrs(name=name)
    return part if span.span is None else part.assign_attrs(span=[start, stop])


def names_of(recordings: Sequence[xr.Dataset]) -> list[str]:
    """Return the names of drives; spans of one recording are numbered."""
    given = [str(r.attrs["name"]) for r in recordings]
    return [f"{n} ({given[: i + 1].count(n)})" if given.count(n) > 1 else n for i, n in enumerate(given)]
