"""Part and channel map of a recording, named with it: ``lap.csv@0s:200s``, ``lap.csv@200s:``, ``lap.csv@map.toml``."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from harness.common.errors import UserError
from harness.common.units import to_si

_SPAN = re.compile(r"(?P<file>.+)@(?P<start>[^@:/\\]*):(?P<stop>[^@:/\\]*)")
_MAP = re.compile(r"(?P<file>.+)@(?P<map>[^@]+\.toml)")

Span = tuple[float, float]
"""Begin and end in s after the first sample; an end may be infinite."""


def named_parts(path: str | os.PathLike[str]) -> tuple[Path, Path | None, Span | None]:
    """Return the file that a path names, its channel map, and which part of it; a file of such a name is meant whole.

    Raises:
        UserError: If begin or end is no time, or the end is not behind the begin.
    """
    file, mapped, span = os.fspath(path), None, None
    while not Path(file).exists():
        if span is None and (match := _SPAN.fullmatch(file)):
            span = _span(match, os.fspath(path))
        elif mapped is None and (match := _MAP.fullmatch(file)):
            mapped = Path(match["map"])
        else:
            break
        file = match["file"]
    return Path(file), mapped, span


def _span(match: re.Match[str], said: str) -> Span:
    start = to_si(match["start"], "s", f"{said}: begin") if match["start"] else 0.0
    stop = to_si(match["stop"], "s", f"{said}: end") if match["stop"] else np.inf
    if not 0.0 <= start < stop:
        raise UserError(f"{said}: the span must begin at 0 s or later and end behind that; write FILE@20s:200s")
    return start, stop


def part_of(recording: xr.Dataset, span: Span, where: str) -> xr.Dataset:
    """Return the samples of a span, their time from 0; the end itself belongs to the part behind it.

    Args:
        recording: The whole recording.
        span: Which part.
        where: As the user named it, for errors.

    Raises:
        UserError: If the recording has fewer than two samples there.
    """
    time = recording["time"].to_numpy()
    inside = np.flatnonzero((time >= span[0] - 1e-9) & (time < span[1] - 1e-9))
    if len(inside) < 2:
        raise UserError(f"{where}: the recording runs from 0 to {time[-1]:.2f} s; there is nothing in that span")
    part = recording.isel(time=inside)
    begun = float(part["time"][0])
    kept = {"span": [begun, float(time[inside[-1]])], "start": float(recording.attrs.get("start", 0.0)) + begun}
    return part.assign_coords(time=part["time"].copy(data=time[inside] - begun)).assign_attrs(kept)


def named(recording: xr.Dataset) -> str:
    """Return the file of a recording, with the part that was read of it."""
    file, span = str(recording.attrs["file"]), recording.attrs.get("span")
    return file if span is None else f"{file}@{span[0]:.6g}s:{span[1]:.6g}s"


def refuse_overlaps(fitted: Sequence[xr.Dataset], held_out: Sequence[xr.Dataset], option: str, use: str) -> None:
    """Refuse parts of one file that are fitted and held out as well; option and use of the two are for the error.

    Raises:
        UserError: If there are two that overlap.
    """
    for test in held_out:
        for train in fitted:
            if "span" not in train.attrs and "span" not in test.attrs:
                continue  # two recordings in memory may have one name
            (a, b), (c, d) = _whole(train), _whole(test)
            if train.attrs.get("file") == test.attrs.get("file") and max(a, c) < min(b, d):
                raise UserError(
                    f"{option}: {test.attrs['file']} from {c:g} to {d:g} s overlaps what is {use}, {a:g} to {b:g} s; "
                    "use every second once only"
                )


def _whole(recording: xr.Dataset) -> Span:
    span = recording.attrs.get("span")
    return (0.0, np.inf) if span is None else (float(span[0]), float(span[1]))
