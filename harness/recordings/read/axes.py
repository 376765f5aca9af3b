"""Columns of an inertial unit turned from its axes into those of the vehicle, as the map states its mounting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.common.errors import UserError
from harness.recordings.read.channel_map import ChannelMap
from harness.recordings.readers import Table


def in_vehicle_axes(tables: Sequence[Table], channels: ChannelMap, file: str) -> list[Table]:
    """Return tables in which columns along x, y and z of a unit hold the components along those of the vehicle.

    Raises:
        UserError: If three columns are not in one table.
    """
    result = list(tables)
    for unit in channels.mounting:
        for names in filter(None, (unit.acceleration, unit.angular_velocity)):
            place = next((n for n, table in enumerate(result) if set(names) <= set(table.columns)), None)
            if place is None:
                raise UserError(f"{unit.where}: {', '.join(names)} are not three columns of one clock of {file}")
            turned = unit.turn @ np.array([result[place].columns[name] for name in names])
            result[place] = replace(
                result[place], columns={**result[place].columns, **dict(zip(names, turned, strict=True))}
            )
    return result
