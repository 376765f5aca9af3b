"""What is odd about recordings, in sentences: before a fit or a trace takes it for something of the vehicle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from harness.models.quantities import listed
from harness.recordings.examine import examine

SLOW = 1.5
"""m/s; below it slip angles lose their meaning, and the equations of the vehicles go on as if it were no less."""

_BACKWARDS = -0.2
"""m/s; anything slower is reversing and not the noise of a sensor at standstill."""


def recording_warnings(recordings: Sequence[xr.Dataset]) -> tuple[str, ...]:
    """Return the irregularities found in reading and comparing the signals of recordings, each with the evidence.

    What is the same of several recordings is said once, of all of them.
    """
    found: dict[str, list[str]] = {}
    for recording in recordings:
        findings = [str(f) for f in examine(recording).findings]
        for warning in (*recording.attrs.get("warnings", ()), *findings, *_slow(recording)):
            names = found.setdefault(warning, [])
            names += [recording.attrs["name"]] if recording.attrs["name"] not in names else []
    return tuple(f"{listed(names)}: {warning}" for warning, names in found.items())


def _slow(recording: xr.Dataset) -> list[str]:
    """Say for how long the vehicle stands, crawls or reverses, where no vehicle of the library is described."""
    speeds = [n for n in ("speed", "longitudinal_velocity") if n in recording]
    if not speeds:
        return []
    time, speed = recording["time"].to_numpy(), recording[speeds[0]].to_numpy()
    found = []
    for limit, does in ((SLOW, f"is slower than {SLOW:g} m/s"), (_BACKWARDS, "drives backwards")):
        there = np.flatnonzero(speed < limit)
        if there.size:
            share, first = 100 * there.size / speed.size, time[there[0]] - time[0]
            rounded = f"{share:.0f}" if share >= 10 else f"{share:.2g}"
            found.append(
                f"'{speeds[0]}': the vehicle {does} at {rounded} % of the samples, first {first:.2f} s after the "
                f"start; no equations of slip hold there, so leave that part out"
            )
    return found
