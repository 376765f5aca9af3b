"""Measured drives: ``load_recording`` turns a file and a channel map into the recording that a simulation writes.

The parts: ``channel_map`` reads the map, ``channels`` finds the channels, ``clock`` checks their samples,
``steady_clock`` takes the jitter from their stamps, ``resample`` brings them onto one time base, ``lever_arm`` to one
reference point, ``derived_signals`` computes what is not measured, ``kinematic_smoother`` takes the noise from a signal
and finds its rate,
``redundancy`` and ``consistency`` compare what must agree, ``explain`` finds which ``faults`` explain what does not,
``calibration`` what is a little off, ``remedy`` the lines that mend the map, ``geodesy`` places latitude and longitude,
``axle_curves`` prepares the tyre curve, ``check`` does all of it and ``check_report`` reports.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.recordings.load import inputs, load_recording, measurements, updated

__all__ = ["inputs", "load_recording", "measurements", "updated"]


def __getattr__(name: str) -> Any:
    """Return what ``load`` offers, which is imported when it is asked for: simulated drives do without."""
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from harness.recordings import load

    return getattr(load, name)
