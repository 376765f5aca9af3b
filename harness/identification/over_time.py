"""Recordings over time as they were measured and simulated, and their path: what is kept beside a fit or a trace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats
from harness.common.series import packed
from harness.identification.data import Drive
from harness.identification.result import Judged
from harness.models.assembly.model import Model

FILE = "drives.npz"
"""Beside ``identify.json`` and ``trace.json``; ``harness.common.series`` reads it."""

MEASURED, BEFORE, AFTER = "measured", "before", "after"
"""Before the name of an output: as measured, and as the model before and after simulates it over the inputs."""


def series_of(judged: Sequence[Judged], model: Model) -> bytes:
    """Return ``drives.npz``: of each recording ``time``, each output as measured, before and after, ``x`` and ``y``.

    The path is dead reckoning by the recorded speed and yaw rate, in m from the start, and is there where both are.

    Args:
        judged: The recordings, each judged before and after.
        model: Whose inputs and outputs they have.
    """
    found = {}
    for j in judged:
        columns = {"time": j.drive.time}
        for a, name in enumerate(model.outputs):
            columns[f"{MEASURED} {name}"] = j.drive.measurements[:, a]
            columns[f"{BEFORE} {name}"], columns[f"{AFTER} {name}"] = j.free[:, :, a]
        found[j.drive.name] = columns | _path(j.drive, model)
    return packed(found)


def _path(drive: Drive, model: Model) -> dict[str, Floats]:
    known = {name: drive.inputs[:, i] for i, name in enumerate(model.inputs)}
    known |= {name: drive.measurements[:, i] for i, name in enumerate(model.outputs)}
    speed = next((known[n] for n in ("speed", "longitudinal_velocity") if n in known), None)
    rate = next((v for n, v in known.items() if n.startswith("yaw_rate")), None)
    if speed is None or rate is None:
        return {}
    speed, rate = _filled(speed), _filled(rate)
    if speed is None or rate is None:
        return {}
    step = np.diff(drive.time, prepend=drive.time[0])
    heading = np.cumsum(rate * step)
    return {"x": np.cumsum(speed * np.cos(heading) * step), "y": np.cumsum(speed * np.sin(heading) * step)}


def _filled(values: Floats) -> Floats | None:
    """Return values with gaps bridged by lines; ``None`` where there is nothing."""
    there = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), there, values[there]) if there.size else None
