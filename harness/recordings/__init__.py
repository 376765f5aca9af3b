"""Measured drives: ``load_recording`` turns a file and a channel map into the recording that a simulation writes.

``readers`` know the file formats. ``read`` takes channels onto one time base and to one reference point, ``proposal``
proposes a channel map. ``motion`` holds the kinematics between the signals, and how far two of them agree. ``check``
explains disagreement and mends the map, ``smooth`` takes the noise from a signal, and ``noise_at_rest`` finds its
covariance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.recordings.read.load import inputs, load_recording, measurements, updated

__all__ = ["inputs", "load_recording", "measurements", "updated"]


def __getattr__(name: str) -> Any:
    """Return what ``load`` offers, which is imported when it is asked for: simulated drives do without."""
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    from harness.recordings.read import load

    return getattr(load, name)
