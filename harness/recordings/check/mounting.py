"""Mounting of an inertial unit proposed for the channel map, by gravity and by the motion over ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.models.signals import SIGNALS
from harness.recordings.check.examine import Finding
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.motion.mounting import angles, axes
from harness.recordings.read.load import recording_of
from harness.recordings.readers import Table

_PLACES = {"longitudinal_acceleration": 0, "lateral_acceleration": 1, "roll_rate": 0, "yaw_rate": 2}
"""Axis of the vehicle along which a signal of the unit is."""
_LEAST_TURN = np.radians(10.0)
"""What is less may be bank, load or an offset."""
_ALIKE = 0.8
"""Correlation of horizontal force and motion from which the yaw of a unit is known."""
_WINDOW = 1.0
"""s over which force and speed are smoothed."""


def mounted(tables: Sequence[Table], content: Mapping[str, Any], file: str) -> tuple[dict[str, Any], Finding] | None:
    """Return a map with the mounting of the unit that it takes accelerations and yaw rate from, and the finding.

    Args:
        tables: One per clock.
        content: The map.
        file: Where the tables come from.

    Returns:
        None where the map takes no speed, or none of three columns, the unit is mounted along the vehicle's axes, or
        its force does not follow the motion.
    """
    speed = next((content[n] for n in ("longitudinal_velocity", "speed") if n in content), None)
    force = next(
        (t for n in ("lateral_acceleration", "longitudinal_acceleration") if (t := _three(n, content, tables))), ()
    )
    turning = _three("yaw_rate", content, tables)
    if speed is None or not force or not turning or "mounting" in content or "points" in content:
        return None
    unit = next(content[n]["unit"] for n in _PLACES if n in content and content[n]["channel"] in force)
    rows = []
    for a, r in zip(force, turning, strict=True):
        part = {key: content[key] for key in ("time",) if key in content} | {
            "speed": {"channel": speed["channel"], "unit": speed["unit"]},
            "longitudinal_acceleration": {"channel": a, "unit": unit},
            "yaw_rate": {"channel": r, "unit": content["yaw_rate"]["unit"]},
        }
        try:
            rows.append(recording_of(list(tables), file, part))
        except UserError:
            return None
    first = rows[0]
    time = first["time"].to_numpy() + first.attrs["start"]
    step = float(time[1] - time[0])

    def smooth(name: str, derivative: int) -> list[Any]:
        each = [np.interp(time, row["time"].to_numpy() + row.attrs["start"], row[name].to_numpy()) for row in rows]
        return [local_polynomial(values, step, _WINDOW, derivative, alike=1) for values in each]

    forward = first["speed"].to_numpy()
    outcome = axes(
        np.array(smooth("longitudinal_acceleration", 0)), np.array(smooth("yaw_rate", 0)),
        local_polynomial(forward, step, _WINDOW, 0, alike=1), local_polynomial(forward, step, _WINDOW, 1),
    )  # fmt: skip
    if outcome is None or outcome[1] < _ALIKE:
        return None
    turn, alike = outcome
    if np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0)) < _LEAST_TURN:
        return None
    names = dict(zip(("roll", "pitch", "yaw"), (f"{np.degrees(x):.1f} deg" for x in angles(turn)), strict=True))
    better = {k: dict(v) if k in SIGNALS and isinstance(v, Mapping) else v for k, v in content.items()}
    better["mounting"] = {"imu": {"acceleration": list(force), "angular_velocity": list(turning), **names}}
    for signal, axis in _PLACES.items():
        entry = better.get(signal)
        if entry is not None and entry["channel"] in (*force, *turning):
            entry["channel"] = (force if "acceleration" in signal else turning)[axis]
            entry.pop("sign", None)
    words = ", ".join(f"{name} {angle}" for name, angle in names.items())
    signals = tuple(n for n in _PLACES if n in better)
    evidence = f"gravity, and force across it against speed: correlation {alike:.3f}"
    return better, Finding("mounting", signals, f"{', '.join(force)}: the unit is mounted turned, {words}", evidence)


def _three(signal: str, content: Mapping[str, Any], tables: Sequence[Table]) -> tuple[str, ...]:
    """Return the columns along x, y and z of which a signal has one; empty where there are no three."""
    column = content.get(signal, {}).get("channel", "")
    for place in reversed([n for n, letter in enumerate(column) if letter in "xyzXYZ"]):
        letters = "xyz" if column[place].islower() else "XYZ"
        names = tuple(f"{column[:place]}{letter}{column[place + 1 :]}" for letter in letters)
        if any(set(names) <= set(table.columns) for table in tables):
            return names
    return ()
