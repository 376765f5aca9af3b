"""Recordings at one step: a filter's noise and its compiled steps are those of one.

Clocks of recorders run at 9.98 ms in place of 10 ms. What is so near is brought to the step that most recordings have;
a recording at half the rate is not, as whether that is to be the rate of all is for the user to say.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from harness.identification.data import STEP_TOLERANCE, step_of
from harness.recordings.read.load import load_recording, updated
from harness.recordings.read.origin import ORIGIN
from harness.recordings.read.resample import updated_on_grid

_NEAR = 0.05
"""Of the step, up to which that of a clock differs, and not that of a setting."""

RESAMPLED = "resampled"
"""Key of an origin: step in s to which what was read was brought."""


def at_common_step(recordings: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return recordings, those whose step differs by a few per cent from that of most at that of most, which they say.

    Others, and all where none differs, are returned as they are.
    """
    steps = np.array([step_of(r) for r in recordings])
    alike = np.abs(steps[:, None] - steps) <= STEP_TOLERANCE * steps
    common = float(steps[alike.sum(axis=0).argmax()])
    return [
        resampled(r, common) if STEP_TOLERANCE * common < abs(step - common) <= _NEAR * common else r
        for r, step in zip(recordings, steps.tolist(), strict=True)
    ]


def resampled(recording: xr.Dataset, step: float) -> xr.Dataset:
    """Return a recording at another step in s."""
    time = recording["time"].to_numpy()
    again = load_recording(recording.drop_attrs(), step=step)
    grid = again.attrs["start"] + again["time"].to_numpy()
    for name in map(str, again.data_vars):
        again[name].attrs |= recording[name].attrs
        if (measured := updated(recording, name)) is not None:
            again.coords[f"updated_{name}"] = ("time", updated_on_grid(time[measured], grid))
    said = f"brought from a step of {1e3 * step_of(recording):.4g} ms to that of the others, {1e3 * step:.4g} ms"
    attributes: dict[str, Any] = {**recording.attrs, "warnings": [*recording.attrs.get("warnings", ()), said]}
    if ORIGIN in attributes:
        attributes[ORIGIN] = json.dumps({**json.loads(attributes[ORIGIN]), RESAMPLED: step})
    return again.assign_attrs(attributes)
