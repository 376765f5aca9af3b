"""A map of the bank of the road over the driven path, estimated on some laps and used on others.

An accelerometer measures the bank, the velocities do not: with the bank ``phi`` positive where the left side is higher,

    a_m - (dv_y/dt + v_x r) = b + k a_y + x dr/dt + g sin(phi),   a_y = dv_y/dt + v_x r

where ``b`` is its bias, ``k`` the roll gain of the body (or an error of the sensor's gain) and ``x`` its lever arm. The
bank belongs to the place, the bias to the drive, the others to the car: laps at different speeds tell them apart. ``k``
and ``x`` are what is common to all passages once the mean of each place is taken away (the within estimator of panel
data; Wooldridge 2010, 10.5). The error of ``dv_y/dt`` stands on both sides with opposite signs and would make ``k`` too
small, so ``v_x r`` is the instrument for ``a_y`` (Wooldridge 2010, 5.1). The mean over the path is no bank but bias, as
far as this can tell, and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.models.effects._gravity import GRAVITY
from harness.models.signals import signal_attributes
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.read.load import inputs

BANK = "bank_angle"
"""The signal that a map makes."""

NEEDED = ("position_x", "position_y", "heading", "longitudinal_velocity", "lateral_velocity", "yaw_rate")
"""Signals a map is made of, in addition to the lateral acceleration; the first three find a place on it."""

PLACE = 2.0
"""m of path that share one value."""

_WINDOW = 0.3
"""s over which signals are smoothed."""

_SLOWEST = 3.0
"""m/s; below it, seconds of sensor noise count as one place."""

_BESIDE = 6.0
"""m next to the mapped path that still count as on it: a lane and a half."""

_PER_RADIAN = 10.0
"""m; weight of a radian of heading in the distance to a place, so that crossings are separated."""

_KNOWN = 0.5
"""Share of a drive that must lie on the map."""


@dataclass(frozen=True)
class BankMap:
    """The bank of a road by place.

    Attributes:
        places: Position and scaled direction of each place ``(places, 4)``, in m.
        bank: rad ``(places,)``, its mean over the places zero.
    """

    places: Floats
    bank: Floats

    def along(self, recording: xr.Dataset) -> Floats:
        """Return the bank on the path of a drive in rad ``(samples,)``, joined where the map has nothing.

        Raises:
            UserError: If less than half of the drive lies on the map, or it lacks position or heading.
        """
        distance, nearest = KDTree(self.places).query(_places(recording))
        on_map = distance < _BESIDE
        if on_map.mean() < _KNOWN:
            raise UserError(
                f"{recording.attrs.get('file', 'recording')}: only {on_map.mean():.0%} of it lies on the mapped road; "
                "leave out bank_map, or map the road with other drives"
            )
        at = np.arange(len(on_map))
        return np.asarray(np.interp(at, at[on_map], self.bank[nearest[on_map]]))


@dataclass(frozen=True)
class _Passages:
    """Measurements of some drives on a road.

    Attributes:
        path: Its places ``(places, 4)``.
        drives: Samples of each drive on it: place, and the columns of ``_columns`` ``(samples, 5)``.
    """

    path: Floats
    drives: tuple[Floats, ...]

    def slopes(self) -> Floats:
        """Return the roll gain of the car, the lever arm of its accelerometer and its bias in each drive ``(n,)``.

        They are of the variation within each place. The bias of the first drive is zero.
        """
        place, felt, a_y, turned, instrument = np.concatenate(self.drives).T
        drive = np.repeat(np.arange(len(self.drives)), [len(d) for d in self.drives])
        biases = np.eye(len(self.drives))[drive, 1:].T
        _, place = np.unique(place.astype(int), return_inverse=True)
        count = np.bincount(place)

        def within(*columns: Floats) -> Floats:
            return np.column_stack([c - (np.bincount(place, c) / count)[place] for c in columns])

        instruments = within(instrument, turned, *biases)
        moments = instruments.T @ np.column_stack([within(a_y, turned, *biases), within(felt)])
        return np.asarray(np.linalg.lstsq(moments[:, :-1], moments[:, -1], rcond=None)[0])

    def bank(self, slopes: Floats, without: int | None = None) -> BankMap:
        """Return the map by all drives, or by all but one."""
        biases = [0.0, *slopes[2:]]
        residuals = [d[:, 1] - d[:, 2:4] @ slopes[:2] - b for d, b in zip(self.drives, biases, strict=True)]
        some = [i for i in range(len(residuals)) if i != without]
        places = np.concatenate([self.drives[i][:, 0] for i in some]).astype(int)
        visited, place = np.unique(places, return_inverse=True)
        mean = np.bincount(place, np.concatenate([residuals[i] for i in some])) / np.bincount(place)
        return BankMap(self.path[visited], np.arcsin(np.clip((mean - mean.mean()) / GRAVITY, -1.0, 1.0)))


def with_bank(fitted: Sequence[xr.Dataset], held_out: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return all drives with the signal ``bank_angle``.

    No drive gets a bank estimated from itself: a held-out drive gets that of the fitted ones, a fitted one that of the
    other fitted ones. Roll gain and lever arm belong to the car and not to the place; they are estimated from all
    fitted drives, because two laps at one speed do not determine them.

    Raises:
        UserError: If fewer than two drives are fitted, a drive lacks a signal, never moves, or does not fit the map.
    """
    if len(fitted) < 2:
        raise UserError(
            "bank_map: a road is mapped by at least two fitted drives, because no drive may use a bank estimated from "
            "itself"
        )
    passages = _passages(fitted)
    slopes = passages.slopes()
    whole = passages.bank(slopes)
    drives = [*((r, passages.bank(slopes, i)) for i, r in enumerate(fitted)), *((r, whole) for r in held_out)]
    attributes = {**signal_attributes(BANK), "derived": 1}
    return [r.assign({BANK: ("time", m.along(r), attributes)}) for r, m in drives]


def _passages(recordings: Sequence[xr.Dataset]) -> _Passages:
    path = _path(recordings)
    tree, drives = KDTree(path), []
    for recording in recordings:
        columns, moving = _columns(recording)
        distance, nearest = tree.query(_places(recording))
        on = moving & (distance < _BESIDE)
        drives.append(np.column_stack([nearest[on], columns[on]]))
    return _Passages(path, tuple(drives))


def bank_map(recordings: Sequence[xr.Dataset]) -> BankMap:
    """Map the bank of a road that was driven several times.

    Args:
        recordings: Drives over the same road.

    Raises:
        UserError: If a drive lacks a signal or never moves.
    """
    passages = _passages(recordings)
    return passages.bank(passages.slopes())


def _path(recordings: Sequence[xr.Dataset]) -> Floats:
    """Return a place every ``PLACE`` metres of the first drive ``(places, 4)``, then of what others add to it."""
    path = np.empty((0, 4))
    for recording in recordings:
        places = _places(recording)
        if len(path):
            places = places[KDTree(path).query(places)[0] > _BESIDE]
        if len(places) < 2:
            continue
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places[:, :2], axis=0).T))])
        _, first = np.unique((way / PLACE).astype(int), return_index=True)
        path = np.concatenate([path, places[first]])
    return path


def _places(recording: xr.Dataset) -> Floats:
    x, y, heading = inputs(recording, NEEDED[:3]).T
    return np.column_stack([x, y, _PER_RADIAN * np.cos(heading), _PER_RADIAN * np.sin(heading)])


def _columns(recording: xr.Dataset) -> tuple[Floats, NDArray[np.bool_]]:
    """Return what the accelerometer reads beyond kinematics, a_y, dr/dt and v_x r, and where to use them.

    The columns are ``(samples, 4)``.
    """
    time = recording["time"].to_numpy()
    step = float(time[-1] - time[0]) / (len(time) - 1)
    v_x, v_y, r = inputs(recording, NEEDED[3:]).T
    felt = inputs(recording, ["lateral_acceleration"])[:, 0]

    def smooth(values: Floats, derivative: int = 0) -> Floats:
        return np.asarray(local_polynomial(values, step, _WINDOW, derivative))

    turning = v_x * smooth(r)
    a_y = smooth(v_y, 1) + turning
    columns = np.column_stack([smooth(felt) - a_y, a_y, smooth(r, 1), turning])
    moving = (v_x > _SLOWEST) & np.isfinite(columns).all(axis=1)
    if not moving.any():
        raise UserError(f"{recording.attrs.get('file', 'recording')}: never moves faster than {_SLOWEST:g} m/s")
    return columns, moving
