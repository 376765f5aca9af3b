"""Recordings against the drives that were planned: whether one of these was driven, by what a driver would see.

Nobody steers a sweep to the sample. Compared are duration, speed, size of the steering and how quick it is, each within
a factor that no driver who follows the plan misses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.models.quantities import listed
from harness.recordings import load_recording

_BLOCK = 0.1
"""s, over which angle and speed are averaged: no driver is quicker, and noise is less."""

_STILL = 0.05
"""Of the largest angle: what is smaller before and behind the manoeuvre is the way there and back."""

_SPEED, _SLOW = 0.25, 1.0
"""Share by which the mean speed may be off, and m/s besides."""

_FACTOR = 2.0
"""By which duration, size and quickness of the steering may be off."""

_QUICK = 3.0
"""rad/s, by which the quickness may be off besides: a steady circle has none."""


@dataclass(frozen=True)
class SteeredDrive:
    """A drive by what tells it from others.

    Attributes:
        seconds: From the first steering to the last.
        speed: Mean in m/s.
        angle: Root mean square of the steering-wheel angle, in rad.
        quickness: Root mean square of its rate over that, in rad/s.
    """

    seconds: float
    speed: float
    angle: float
    quickness: float

    def like(self, planned: SteeredDrive) -> bool:
        """Whether it may be the one that was planned."""
        apart = abs(np.log([self.seconds / planned.seconds, self.angle / planned.angle])) > np.log(_FACTOR)
        slow, quick = sorted((self.quickness, planned.quickness))
        other_rate = quick > _FACTOR * slow and quick - slow > _QUICK
        return not (apart.any() or other_rate or abs(self.speed - planned.speed) > _SPEED * planned.speed + _SLOW)


def steered_drive(recording: xr.Dataset) -> SteeredDrive | None:
    """Return a recording by what tells it from others; ``None`` without steering-wheel angle, speed or steering."""
    if not {"steering_wheel_angle", "speed"} <= {str(n) for n in recording}:
        return None
    time = recording["time"].to_numpy()
    place = np.floor((time - time[0]) / _BLOCK).astype(int)
    angle, speed = (_averaged(recording[n].to_numpy(), place) for n in ("steering_wheel_angle", "speed"))
    if not np.isfinite(angle).any() or np.nanmax(np.abs(angle)) == 0.0:
        return None
    steered = np.flatnonzero(np.abs(angle) > _STILL * np.nanmax(np.abs(angle)))
    active = slice(steered[0], steered[-1] + 1)
    size = float(np.sqrt(np.nanmean(angle[active] ** 2)))
    rate = np.diff(angle[active]) / _BLOCK
    quickness = float(np.sqrt(np.nanmean(rate**2))) / size if len(rate) else 0.0
    return SteeredDrive(_BLOCK * (steered[-1] + 1 - steered[0]), float(np.nanmean(speed[active])), size, quickness)


def _averaged(values: Floats, place: np.ndarray) -> Floats:
    """Return the mean of samples ``(samples,)`` by place ``(blocks,)``; NaN where none is finite."""
    finite = np.isfinite(values)
    total = np.bincount(place[finite], values[finite], place[-1] + 1)
    count = np.bincount(place[finite], minlength=place[-1] + 1)
    return np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)


def driven_otherwise(recordings: Sequence[xr.Dataset], folder: Path, plan: Mapping[str, Any]) -> str:
    """Return why what a plan expects is not to be expected of what was driven; empty if it is.

    Args:
        recordings: What was driven.
        folder: Of the plan.
        plan: ``next_drive.json``.
    """
    sequence = plan.get("sequence", ())
    names = [str(d["name"]) for d in sequence]
    if other := unplanned(recordings, folder, names):
        return f"{listed(other)} {'is' if len(other) == 1 else 'are'} not as planned ({listed(names)})"
    planned = sum(int(d.get("times", 1)) for d in sequence)
    return f"only {len(recordings)} of {planned} planned drives are there" if len(recordings) < planned else ""


def unplanned(recordings: Sequence[xr.Dataset], folder: Path, names: Sequence[str]) -> list[str]:
    """Return the names of recordings that are like none of the planned drives; none where that cannot be said.

    Args:
        recordings: What was driven.
        folder: Of the plan, with a table of each drive for a steering robot.
        names: Of the planned drives.
    """
    files = [folder / f"{name}.csv" for name in names]
    if not files or not all(file.is_file() for file in files):
        return []
    planned = [p for p in (steered_drive(load_recording(file)) for file in files) if p is not None]
    driven = [(str(r.attrs["name"]), steered_drive(r)) for r in recordings]
    return [name for name, d in driven if d is not None and planned and not any(d.like(p) for p in planned)]
