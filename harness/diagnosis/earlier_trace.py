"""An earlier trace with the drives that were planned behind it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Self

from harness.common.errors import UserError
from harness.diagnosis.selection.earlier_models import EarlierModel, finite
from harness.identification.earlier_result import EarlierResult, read_json

TRACE = "trace.json"


def several_models(folder: Path) -> bool:
    """Whether a trace left several models, of a vehicle behind which drives are planned."""
    content = read_json(folder / TRACE)
    return not content.get("baseline") and len((content.get("confusable") or {}).get("models", ())) > 1


class EarlierTrace(EarlierResult):
    """A trace behind which drives were planned that tell its models apart."""

    FILE: ClassVar[str] = TRACE
    KIND: ClassVar[str] = "trace"
    EXPECTED: ClassVar[str] = "models"
    ELSE: ClassVar[str] = (
        "to determine quantities (--for), not to tell models apart; trace all recordings without --after"
    )

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
                f"{earlier.folder}: is a trace of changes since a baseline, behind which no drives are planned"
            )
        return earlier

    @property
    def models(self) -> list[EarlierModel]:
        """Its confusable set."""
        return [
            EarlierModel(
                tuple(tuple((h["kind"], h["name"]) for h in alike) for alike in m["added"]), finite(m["estimates"])
            )
            for m in self.content["confusable"]["models"]
        ]
