"""Messages between a process and its worker: pickles, with the numbers of arrays apart from them and copied once."""

from __future__ import annotations

import os
import pickle
from multiprocessing.connection import Connection
from typing import Any

_AT_ONCE = 2**20
"""Bytes that are written in one go."""


def send(connection: Connection, message: Any) -> None:
    """Send a message.

    Raises:
        OSError: If nobody is at the other end.
    """
    arrays: list[pickle.PickleBuffer] = []
    text = pickle.dumps(message, 5, buffer_callback=arrays.append)
    views = [array.raw() for array in arrays]
    connection.send_bytes(pickle.dumps((text, [view.nbytes for view in views])))
    for view in views:
        at = 0
        while at < view.nbytes:
            at += os.write(connection.fileno(), view[at : at + _AT_ONCE])


def receive(connection: Connection) -> Any:
    """Return the next message.

    Raises:
        EOFError, OSError: If the other end is closed, or ends within the message.
    """
    text, sizes = pickle.loads(connection.recv_bytes())
    arrays = [bytearray(size) for size in sizes]
    for array in arrays:
        rest = memoryview(array)
        while rest:
            count = os.readv(connection.fileno(), [rest])
            if count == 0:
                raise EOFError
            rest = rest[count:]
    return pickle.loads(text, buffers=arrays)
