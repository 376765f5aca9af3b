"""Messages of several frames on a J1939 bus, put together (transport protocol, SAE J1939-21, 5.10)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.recordings.readers._frames import EXTENDED, Frames

_CONNECTION, _DATA = 0xEC, 0xEB
"""Upper byte of the parameter groups that announce a message and that carry it."""
_TO_ONE, _TO_ALL = 16, 32
"""First byte of an announcement."""
_OCTETS = 7
"""Of a message in a frame, behind the number of the frame."""


def put_together(frames: Frames, groups: Collection[int]) -> Frames:
    """Return frames with each message of several frames as one, at the stamp of its last frame.

    A message of which a frame is missing, or out of order, stays as it is.

    Args:
        frames: Of the log.
        groups: Parameter groups that a database describes; others stay as they are.
    """
    identifier = frames.identifier
    form = np.where((identifier & EXTENDED > 0) & (frames.length >= 8), identifier >> 16 & 0xFF, 0)
    announced = np.flatnonzero(form == _CONNECTION)
    carried = np.flatnonzero(form == _DATA)
    if not len(announced) or not len(carried):
        return frames
    sender = frames.bus.astype(np.int64) << 16 | identifier & 0xFFFF  # the address that it is sent to, and by
    head = _octets(frames, announced)
    begins = np.isin(head[:, 0], (_TO_ONE, _TO_ALL))
    announced, head = announced[begins], head[begins].astype(np.int64)
    size, count = head[:, 1] | head[:, 2] << 8, head[:, 3]
    group = head[:, 5] | head[:, 6] << 8 | head[:, 7] << 16
    known = np.isin(group, list(groups)) & (count * _OCTETS >= size) & (size > 0)
    kept, whole = np.ones(len(identifier), dtype=bool), []
    for each in np.unique(sender[announced[known]]):
        own, rows = np.flatnonzero(sender[announced] == each), carried[sender[carried] == each]
        first = np.searchsorted(rows, announced[own])
        behind = np.append(first[1:], len(rows))
        for k, begin, end in zip(own.tolist(), first.tolist(), behind.tolist(), strict=True):
            parts = rows[begin : begin + count[k]] if known[k] and begin + count[k] <= end else rows[:0]
            data = _octets(frames, parts)
            if len(parts) and (data[:, 0] == np.arange(1, len(parts) + 1)).all():
                kept[[announced[k], *parts]] = False
                whole.append((parts[-1], group[k] << 8 | int(each) & 0xFF, data[:, 1:].ravel()[: size[k]]))
    if not whole:
        return frames
    last = np.array([row for row, _, _ in whole])
    length = np.array([len(data) for _, _, data in whole])
    start = len(frames.payload) + np.cumsum(length) - length
    rows = np.append(np.flatnonzero(kept), last)
    order = np.argsort(rows, kind="stable")
    names = np.array([EXTENDED | name for _, name, _ in whole], dtype=np.uint32)
    return replace(
        frames,
        time=frames.time[rows[order]],
        bus=frames.bus[rows[order]],
        identifier=np.append(identifier[kept], names)[order],
        length=np.append(frames.length[kept].astype(np.uint16), length.astype(np.uint16))[order],
        start=np.append(frames.start[kept], start)[order],
        payload=np.concatenate([frames.payload, *(data for _, _, data in whole)]),
    )


def _octets(frames: Frames, rows: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Return the first eight bytes of frames that have so many."""
    return frames.payload[frames.start[rows, None] + np.arange(8)]
