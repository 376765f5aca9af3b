"""Measured drives: ``load_recording`` turns a file and a channel map into the recording that a simulation writes.

The parts: ``channel_map`` reads the map, ``raw`` finds the channels, ``samples`` tells what is odd about them,
``resample`` brings them onto one time base, ``move`` to one reference point, ``derive`` computes what is not measured,
``relations`` and ``consistency`` compare what must agree, ``axles`` prepares the tyre curve, ``check`` reports.
"""

from __future__ import annotations

from harness.recordings.load import inputs, load_recording, measurements

__all__ = ["inputs", "load_recording", "measurements"]
