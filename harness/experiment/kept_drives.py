"""What drives tell, kept while a design goes on, so that an interrupted one takes them over."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Lock
from types import ModuleType

import numpy as np

from harness.common import sources
from harness.common.kept_arrays import KeptArrays
from harness.common.places import inside
from harness.config import DriveSpec
from harness.experiment.contract import Evidence, Goal
from harness.experiment.limits import Limits
from harness.models.roles import DRIVES

TRIED = "tried-drives"
"""Folder within that of the result, until this is written."""

_READ = ("identify.json", "parameters.toml", "trace.json", "nominal.toml", "amended.toml", "scores.zarr/zarr.json")
"""Files of a result that decide what a drive tells of what it left open; the last has the checksums of its store."""


class KeptDrives:
    """Drives of one design that were tried.

    Args:
        folder: Of the result of the design; nothing is kept without one.
        basis: Of all that decides what a drive tells in addition to the drive.

    Attributes:
        taken: Number of drives that were there before this design began.
        written: Number of drives that were written.
    """

    def __init__(self, folder: Path | None = None, basis: str = "") -> None:
        self._arrays = KeptArrays(None if folder is None else inside(folder, TRIED))
        self._basis, self.taken, self.written = basis, 0, 0
        self._counting = Lock()  # drives are tried in threads

    def read(self, drive: DriveSpec, in_full: bool) -> tuple[float, Evidence] | str | None:
        """Return duration in s and evidence of a drive, or the limit that it passes; ``None`` if it is not there.

        Args:
            drive: The drive.
            in_full: Whether the evidence, or a surrogate.
        """
        kept = self._arrays.read(self._key(drive, in_full))
        if kept is None:
            return None
        with self._counting:
            self.taken += 1
        first, *evidence = kept
        return (float(first), tuple(evidence)) if evidence else str(first)

    def write(self, drive: DriveSpec, in_full: bool, outcome: tuple[float, Evidence] | str) -> None:
        """Keep what ``read`` returns.

        Raises:
            UserError: If the folder cannot be written to.
        """
        first, evidence = (outcome, ()) if isinstance(outcome, str) else outcome
        self._arrays.write(self._key(drive, in_full), [np.array(first), *evidence])
        with self._counting:
            self.written += 1

    def _key(self, drive: DriveSpec, in_full: bool) -> str:
        stated = f"{self._basis} {in_full} {drive.kind} {sorted(drive.options.items())!r}"
        return hashlib.sha256(stated.encode()).hexdigest()[:32]

    def remove(self) -> None:
        """Remove what is kept: the result is written."""
        self._arrays.remove()


def basis(result: Path, goal: Goal, limits: Limits, stated: object, kinds: Sequence[str]) -> str:
    """Return the digest of all that decides what a drive tells in addition to the drive.

    Args:
        result: Folder of the result that left something open.
        goal: What was read from it.
        limits: Of every drive.
        stated: What else was asked for that decides it, as it prints.
        kinds: Files in ``models/drives``.
    """
    modules: list[ModuleType] = [sys.modules[name] for name in (type(goal).__module__, "harness.experiment.rehearsal")]
    code = sources.digest([*modules, *(DRIVES.load(kind) for kind in dict.fromkeys(kinds))])
    equations = goal.model.compiled.kernels.__name__  # which holds the digest of their source
    total = hashlib.sha256(repr((code, equations, goal.model.spec, limits, stated)).encode())
    for values in goal.versions:
        total.update(values.tobytes())
    for name in _READ:
        file = result / name
        total.update(file.read_bytes() if file.is_file() else b"")
    return total.hexdigest()
