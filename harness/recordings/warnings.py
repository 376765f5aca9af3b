"""What is odd about recordings, in sentences: before a fit or a trace takes it for something of the vehicle."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr

from harness.recordings.examine import examine


def recording_warnings(recordings: Sequence[xr.Dataset]) -> tuple[str, ...]:
    """Return the irregularities found in reading and comparing the signals of recordings, each with the evidence."""
    found = []
    for recording in recordings:
        findings = [str(f) for f in examine(recording).findings]
        found += [f"{recording.attrs['name']}: {w}" for w in (*recording.attrs.get("warnings", ()), *findings)]
    return tuple(found)
