"""Fits of an unfinished trace, kept in its folder: the same trace, started again, goes on from there.

A fit is found again by everything that decides it: code, model, recordings, what moves, and where it starts. Whatever
differs is fitted anew, so nothing old is ever taken for new.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Lock

import numpy as np

from harness.common import places, sources
from harness.common.errors import UserError
from harness.common.files import told_as_damaged
from harness.diagnosis.fitting.fit import Fitted, Fitting, Point
from harness.identification.coordinates import Coordinate

How = tuple[int, int, bool, float]
"""The last arguments of ``Fitting.fit``."""


class KeptFits:
    """The fits of one trace.

    Args:
        folder: Where they are; nothing is kept without one.

    Attributes:
        taken: Number of fits that were there before this trace began.
        written: Number of fits that were written.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder, self.taken, self.written = folder, 0, 0
        self._basis: dict[int, bytes] = {}
        self._met: set[str] = set()  # a search that comes by the same way again asks for the same fits
        self._counting = Lock()  # candidates are fitted in threads

    def fit(self, fitting: Fitting, moved: tuple[Coordinate, ...], start: Point, how: How) -> Fitted:
        """Return what ``fitting.fit`` does, from the folder if it is there.

        Args:
            fitting: The recordings.
            moved: What moves.
            start: Where it starts.
            how: Iterations and turns of the fit, whether it begins afresh, and the least objective that counts.

        Raises:
            UserError: If the folder cannot be written to.
        """
        if self.folder is None:
            return fitting.fit(moved, start, *how)
        key = self._key(fitting, moved, start, how)
        file = self.folder / f"{key}.npz"
        kept = _read(file, moved)
        found = kept or fitting.fit(moved, start, *how)
        if kept is None:
            self._write(file, found)
        with self._counting:
            self.taken += kept is not None and key not in self._met
            self.written += kept is None
            self._met.add(key)
        return found

    def _key(self, fitting: Fitting, moved: Sequence[Coordinate], start: Point, how: How) -> str:
        if id(fitting) not in self._basis:
            augmented, code = fitting.augmented, sources.digest([sys.modules[__name__]])
            equations = augmented.compiled.kernels.__name__  # which holds the digest of their source
            stated = (code, equations, augmented.model.parameters, augmented.spec, fitting.noise_held, fitting.first())
            total = hashlib.sha256(repr(stated).encode())
            for drive in fitting.drives:
                total.update(drive.inputs.tobytes() + drive.measurements.tobytes())
            total.update(fitting.driveable.speeds.tobytes())
            self._basis[id(fitting)] = total.digest()
        total = hashlib.sha256(self._basis[id(fitting)] + repr((tuple(moved), how)).encode())
        for part in (start.values, start.process, start.measurement):
            total.update(np.ascontiguousarray(part).tobytes())
        return total.hexdigest()[:32]

    def _write(self, file: Path, found: Fitted) -> None:
        numbers = np.array([found.log_likelihood, found.objective, found.ended])
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            point = found.point
            with places.unfinished(file, file.with_suffix(".part").name) as stream:
                np.savez(stream, point.values, point.process, point.measurement, numbers)
        except OSError as error:
            raise UserError(f"{file.parent}: cannot be written: {error.strerror or error}") from None

    def remove(self) -> None:
        """Remove what is kept: the trace is finished."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def _read(file: Path, moved: tuple[Coordinate, ...]) -> Fitted | None:
    """Return a fit that was kept; ``None`` if it is not there or was cut off."""
    try:
        with told_as_damaged(file, "fit"), np.load(file) as kept:
            values, process, measurement, numbers = (kept[f"arr_{i}"] for i in range(4))
    except (OSError, UserError):
        return None
    return Fitted(moved, Point(values, process, measurement), float(numbers[0]), float(numbers[1]), bool(numbers[2]))
