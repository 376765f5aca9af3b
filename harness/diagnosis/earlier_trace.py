"""An earlier trace with the drives that were planned behind it: its recordings read again, model and plan."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from harness.common.errors import UserError
from harness.common.files import read_text
from harness.recordings.read.load import load_recording
from harness.recordings.read.origin import ORIGIN, digest

TRACE, PLAN, FOLDER = "trace.json", "next_drive.json", "next-drive"
"""Of a trace; of planned drives, and where they are in the folder of a trace if nothing else was asked for."""


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
class EarlierTrace:
    """A trace behind which drives were planned.

    Attributes:
        folder: Of the trace.
        content: Of ``trace.json``.
        plan: Of ``next_drive.json``.
    """

    folder: Path
    content: Mapping[str, Any]
    plan: Mapping[str, Any]

    @classmethod
    def read(cls, result: Path) -> EarlierTrace:
        """Return the trace of a folder that holds it, or the drives that were planned behind it.

        Raises:
            UserError: If there is none, no drives were planned, or these are of something else than a trace.
        """
        places = (result / FOLDER / PLAN, result / PLAN)
        file = next((p for p in places if p.is_file()), None)
        if file is None:
            raise UserError(f"{result}: holds no {FOLDER}/{PLAN}; plan drives first: harness next-drive {result}")
        plan = _json(file)
        folders = (result, result.parent, Path(str(plan.get("result", ""))))
        folder = next((f for f in folders if (f / TRACE).is_file()), None)
        expected = plan.get("expected")
        if folder is None or not isinstance(expected, dict):
            raise UserError(f"{file}: the drives are planned behind no trace whose {TRACE} is there")
        if "models" not in expected:
            raise UserError(
                f"{file}: the drives are planned to determine quantities (--for), not to tell models apart; trace "
                "all recordings without --after"
            )
        content = _json(folder / TRACE)
        if "asked" not in content or not (content.get("confusable") or {}).get("models"):
            raise UserError(f"{folder / TRACE}: an earlier version wrote it; trace and plan again")
        if content.get("baseline"):
            raise UserError(f"{folder}: is a trace of changes since a baseline, behind which no drives are planned")
        return cls(folder, content, plan)

    @property
    def model(self) -> dict[str, Any]:
        """Keys of its nominal model, as ``harness.model`` takes them.

        Raises:
            UserError: If it does not state them, as where a file stated the measured drives.
        """
        model = self.content["asked"]["model"]
        if not model:
            raise UserError(f"{self.folder / TRACE}: does not state its model; name it with --model")
        return dict(model)

    @property
    def free(self) -> tuple[str, ...]:
        """Parameters that it fitted in any case."""
        return tuple(self.content["asked"]["free"])

    def recordings(self, role: str, stated: Sequence[xr.Dataset]) -> list[xr.Dataset]:
        """Return its recordings of a role, ``train`` or ``test``, that are not among those stated, read again.

        Raises:
            UserError: If one came from memory, is no longer there, or holds something else.
        """
        known, recordings = {digest(r) for r in stated}, []
        for entry in self.content["asked"][role]:
            if entry["digest"] in known:
                continue
            origin, name = entry["origin"], entry["name"]
            remedy = f"state it as well, as {role}"
            if origin is None:
                raise UserError(f"{self.folder}: '{name}' was traced from memory and cannot be read again; {remedy}")
            try:
                again = load_recording(
                    origin["source"], origin["channels"], origin["step"], name, databases=origin["databases"]
                )
            except UserError as error:
                raise UserError(f"{self.folder}: '{name}' cannot be read again; {remedy} ({error})") from error
            if digest(again) != entry["digest"]:
                raise UserError(f"{origin['source']}: holds something else than when it was traced; {remedy}")
            recordings.append(again)
        return recordings


def _json(file: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(read_text(file)))
    except (ValueError, TypeError) as error:
        raise UserError(f"{file}: is no file of the harness ({error})") from error
