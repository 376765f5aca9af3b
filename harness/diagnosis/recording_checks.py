"""Are recordings fit to be traced: long and lively enough?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from harness.common.errors import UserError
from harness.config import ModelSpec
from harness.identification.data import measurements_of, steered
from harness.identification.measured_file import SHORTEST

CALM = 0.3
"""m/s^2; lateral acceleration that a road with a cross slope of 3 % has without any steering."""

_LIVELY = "quick steering, a steady circle to either side and lane changes, two minutes or more"


def refuse_recordings(recordings: Sequence[xr.Dataset], spec: ModelSpec) -> None:
    """Refuse a recording that is not informative enough, before anything is compiled.

    Raises:
        UserError: If one is too short or too calm, with what to drive; if an input of the model is missing or has gaps.
    """
    for recording in recordings:
        measurements_of(steered(recording, spec.values), spec.model(), str(recording.attrs["file"]))
        file, time = recording.attrs["file"], recording["time"].to_numpy()
        if time[-1] - time[0] < SHORTEST:
            raise UserError(
                f"{file}: lasts {time[-1] - time[0]:.1f} s, too short to identify what is missing; record at least "
                f"{SHORTEST:.0f} s, better {_LIVELY}"
            )
        reached = _lateral_acceleration(recording)
        if reached < CALM:
            raise UserError(
                f"{file}: for 95 % of the time the lateral acceleration (speed times yaw rate) is below {reached:.2f} "
                f"m/s^2, too little excitation to identify what is missing; drive {_LIVELY}, so that it passes "
                f"{CALM:g} m/s^2"
            )


def _lateral_acceleration(recording: xr.Dataset) -> float:
    """Return what 95 % of the samples stay below in m/s^2; infinite where speed or yaw rate are not recorded."""
    rates = [str(n) for n in recording if str(n).startswith("yaw_rate")]
    speeds = [n for n in ("speed", "longitudinal_velocity") if n in recording]
    if not rates or not speeds:
        return np.inf
    both = np.abs(recording[rates[0]].to_numpy() * recording[speeds[0]].to_numpy())
    known = both[np.isfinite(both)]
    return float(np.quantile(known, 0.95)) if known.size else np.inf
