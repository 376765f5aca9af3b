"""An earlier result with the drives that were planned behind it: its recordings read again, model and plan."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self

import xarray as xr

from harness.common.errors import UserError
from harness.common.files import read_text
from harness.identification.common_step import RESAMPLED, resampled
from harness.identification.measured_file import MEASURED, MeasuredStudy
from harness.recordings.read.load import load_recording
from harness.recordings.read.origin import ORIGIN, digest
from harness.recordings.smooth.road_bank_map import BANK

PLAN, FOLDER = "next_drive.json", "next-drive"
"""Of planned drives, and where they are in the folder of a result if nothing else was asked for."""


def record_of_recordings(recordings: Sequence[xr.Dataset]) -> list[dict[str, Any]]:
    """Return names of recordings, how each is read again (``null`` if it came from memory), and digests."""
    origins = [r.attrs.get(ORIGIN) for r in recordings]
    return [
        {"name": str(r.attrs["name"]), "origin": None if origin is None else json.loads(origin), "digest": digest(r)}
        for r, origin in zip(recordings, origins, strict=True)
    ]


def with_absolute_paths(model: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of a model with files named so that they hold in any folder."""
    return {k: str(Path(v).resolve()) if isinstance(v, str) and Path(v).is_file() else v for k, v in model.items()}


@dataclass(frozen=True)
class EarlierResult:
    """A result behind which drives were planned; that of an identification, and ``EarlierTrace``.

    Attributes:
        FILE, KIND: Its file, and what it is.
        EXPECTED, ELSE: Keys of what a plan behind it expects, and for what one without is planned.
        folder: Of the result.
        content: Of its file.
        plan: Of ``next_drive.json``.
        place: Folder of that.
    """

    FILE: ClassVar[str] = "identify.json"
    KIND: ClassVar[str] = "identification"
    EXPECTED: ClassVar[tuple[str, ...]] = ("parameters",)
    ELSE: ClassVar[str] = "for something else than standard errors of parameters; fit all recordings without --after"

    folder: Path
    content: Mapping[str, Any]
    plan: Mapping[str, Any]
    place: Path

    @classmethod
    def read(cls, result: Path) -> Self:
        """Return the result of a folder that holds it, or the drives that were planned behind it.

        Raises:
            UserError: If there is none, no drives were planned, or these are of something else.
        """
        places = (result / FOLDER / PLAN, result / PLAN)
        file = next((p for p in places if p.is_file()), None)
        if file is None and not result.is_dir():
            raise UserError(f"{result}: is no folder; name that of the {cls.KIND}, or of the drives planned behind it")
        if file is None:
            raise UserError(f"{result}: holds no {FOLDER}/{PLAN}; plan drives first: harness next-drive {result}")
        plan = read_json(file)
        expected = plan.get("expected")
        behind = plan.get("result", "")
        if isinstance(expected, dict) and "errors" in expected:
            behind = expected.get("fit")
        if behind is None:
            raise UserError(
                f"{file}: the drives are planned behind a study whose vehicles are of no fit of harness identify that "
                "is there as it was; fit the parameters without --after, state that fit as the posterior of the "
                "design, and run the study again"
            )
        stated = Path(str(behind))  # in the folder in which it was planned: one above, if not this one
        bases = (Path(), *file.resolve().parents)
        folders = (file.parent, file.parent.parent, *(base / stated for base in bases), bases[2])
        folder = next((f for f in folders if (f / cls.FILE).is_file()), None)
        if folder is None or not isinstance(expected, dict):
            raise UserError(f"{file}: the drives are planned behind no {cls.KIND} whose {cls.FILE} is there")
        content = read_json(folder / cls.FILE)
        if "asked" not in content:
            raise UserError(f"{folder / cls.FILE}: an earlier version wrote it; run the {cls.KIND} and plan again")
        if not any(key in expected for key in cls.EXPECTED):
            raise UserError(f"{file}: the drives are planned {cls.ELSE}")
        return cls(folder, content, plan, file.parent)

    @property
    def model(self) -> dict[str, Any]:
        """Keys of its model, as ``harness.model`` takes them.

        Raises:
            UserError: If an earlier version wrote it, of a file of measured drives.
        """
        model = self.content["asked"]["model"]
        if not model:
            raise UserError(f"{self.folder / self.FILE}: does not state its model; name it with --model")
        return dict(model)

    @property
    def free(self) -> tuple[str, ...]:
        """Parameters that were fitted; of a trace those in any case."""
        return tuple(self.content["asked"]["free"])

    def joined(
        self, fitted: Sequence[xr.Dataset], held_out: Sequence[xr.Dataset]
    ) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
        """Return stated recordings behind its own.

        Raises:
            UserError: As ``recordings``; if it had all that are stated, or had one for the other purpose.
        """
        for recordings, role, other in ((fitted, "train", "test"), (held_out, "test", "train")):
            if taken := [r for r in recordings if self._has(r, other)]:
                raise UserError(f"{role}: '{_name(taken[0])}' is in {self.folder} as {other}; state it as that, or not")
        stated = [*fitted, *held_out]
        if not self.driven_since(stated):
            names = ", ".join(f"'{_name(r)}'" for r in stated)
            raise UserError(f"{self.folder}: has {names} already; state what was driven behind that {self.KIND}")
        earlier = {role: self.recordings(role, stated) for role in ("train", "test")}
        lacking = [r for r in stated if BANK not in r]
        if lacking and any(BANK in r for recordings in earlier.values() for r in recordings):
            raise UserError(
                f"'{_name(lacking[0])}' lacks '{BANK}', which the drives of {self.folder} have; state all of them in "
                "one file of measured drives, and run that without --after"
            )
        return [*earlier["train"], *fitted], [*earlier["test"], *held_out]

    def driven_since(self, stated: Sequence[xr.Dataset]) -> list[xr.Dataset]:
        """Return the recordings that it did not have."""
        return [r for r in stated if not (self._has(r, "train") or self._has(r, "test"))]

    def refuse_folder(self, folder: Path) -> None:
        """Refuse to write into the folder of the result or of the plan, which would be overwritten.

        Raises:
            UserError: If it is one of these.
        """
        if folder.resolve() in (self.folder.resolve(), self.place.resolve()):
            raise UserError(f"{folder}: holds what --after goes on from; name another folder, or none")

    def _has(self, recording: xr.Dataset, role: str) -> bool:
        entries = self.content["asked"][role]
        steps = {e["origin"][RESAMPLED] for e in entries if e["origin"] and RESAMPLED in e["origin"]}
        digests = {digest(recording), *(digest(resampled(recording, step)) for step in steps)}
        return any(e["digest"] in digests for e in entries)

    def recordings(self, role: str, stated: Sequence[xr.Dataset]) -> list[xr.Dataset]:
        """Return its recordings of a role, ``train`` or ``test``, that are not among those stated, read again.

        Raises:
            UserError: If one came from memory, is no longer there, or holds something else.
        """
        digests, recordings = {digest(r) for r in stated}, []
        drives_of = cache(_drives_of)
        for entry in self.content["asked"][role]:
            origin, name = entry["origin"], entry["name"]
            brought = None if origin is None else origin.get(RESAMPLED)
            if entry["digest"] in digests | {digest(resampled(r, brought)) for r in stated if brought is not None}:
                continue
            remedy = f"state it as well, as {role}"
            if origin is None:
                raise UserError(f"{self.folder}: '{name}' came from memory and cannot be read again; {remedy}")
            try:
                again = _read_again(origin, name, drives_of)
            except UserError as error:
                raise UserError(f"{self.folder}: '{name}' cannot be read again; {remedy} ({error})") from error
            again = again if brought is None else resampled(again, brought)
            if digest(again) != entry["digest"]:
                raise UserError(
                    f"{origin.get(MEASURED) or origin['source']}: holds something else than in that {self.KIND}; put "
                    "back what it held, or state all recordings without --after"
                )
            recordings.append(again)
        return recordings


def _read_again(
    origin: Mapping[str, Any], name: str, drives_of: Callable[[str], Mapping[str, list[xr.Dataset]]]
) -> xr.Dataset:
    """Return a recording from its origin, with the drives of a file of measured drives where that states it.

    Raises:
        UserError: If it is no longer there.
    """
    if MEASURED not in origin:
        return load_recording(origin["source"], origin["channels"], origin["step"], name, databases=origin["databases"])
    stated = drives_of(origin[MEASURED]).get(origin["key"], [])
    if origin["place"] >= len(stated):
        raise UserError(f"{origin[MEASURED]}: states no such drive any more")
    return stated[origin["place"]]


def _drives_of(path: str) -> dict[str, list[xr.Dataset]]:
    """Return the drives of a file of measured drives.

    Raises:
        UserError: If it or one of them cannot be read.
    """
    study = MeasuredStudy.read(Path(path))
    if study.absent:
        raise UserError(study.absent)
    return study.drives()


def _name(recording: xr.Dataset) -> str:
    return str(recording.attrs.get("name", recording.attrs.get("file", "")))


def read_json(file: Path) -> dict[str, Any]:
    """Return the content of a file of the harness.

    Raises:
        UserError: If it is none.
    """
    try:
        return dict(json.loads(read_text(file)))
    except (ValueError, TypeError) as error:
        raise UserError(f"{file}: is no file of the harness ({error})") from error
