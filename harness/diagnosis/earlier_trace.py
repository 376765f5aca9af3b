"""An earlier trace with the drives that were planned behind it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from harness.common.errors import UserError
from harness.diagnosis.selection.earlier_models import EarlierModel, finite
from harness.identification.earlier_result import EarlierResult

TRACE = "trace.json"


def models_left(content: Mapping[str, Any]) -> int:
    """Return how many models ``trace.json`` leaves to be told apart, of what is alike each one."""
    models = (content.get("confusable") or {}).get("models", ())
    return len(models) + sum(len(m.get("alike", ())) for m in models)


class EarlierTrace(EarlierResult):
    """A trace behind which drives were planned that tell its models apart, or show what it could not see."""

    FILE: ClassVar[str] = TRACE
    KIND: ClassVar[str] = "trace"
    EXPECTED: ClassVar[tuple[str, ...]] = ("models", "limits")
    ELSE: ClassVar[str] = "behind something else than a trace; trace all recordings without --after"

    @classmethod
    def read(cls, result: Path) -> Self:
        """Return the trace of a folder that holds it, or the drives that were planned behind it.

        Raises:
            UserError: If there is none, no drives were planned, or these are of something else than a trace.
        """
        earlier = super().read(result)
        if not (earlier.content.get("confusable") or {}).get("models"):
            raise UserError(f"{earlier.folder / TRACE}: an earlier version wrote it; trace and plan again")
        if earlier.content.get("baseline"):
            raise UserError(
                f"{earlier.folder}: is a trace of changes since a baseline; trace all its drives again, without --after"
            )
        return earlier

    @property
    def search(self) -> dict[str, Any]:
        """What a file of measured drives asked of the search, by attribute of ``TraceTask``."""
        asked = self.content["asked"]
        excluded = {"excluded": frozenset(asked.get("excluded", ()))}
        return excluded | {name: asked[name] for name in ("rounds", "stated_noise") if name in asked}

    @property
    def models(self) -> list[EarlierModel]:
        """Its confusable set."""
        return [
            EarlierModel(
                tuple(tuple((h["kind"], h["name"]) for h in alike) for alike in m["added"]), finite(m["estimates"])
            )
            for m in self.content["confusable"]["models"]
        ]
