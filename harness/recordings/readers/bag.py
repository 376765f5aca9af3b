"""Bags of ROS: MCAP and SQLite of ROS 2, also as the folder with its ``metadata.yaml``, and bags of ROS 1.

Through rosbags (extra ``ros``). Numbers of messages of any type that the bag defines become columns by topic and path,
``/imu/data.angular_velocity.z``; arrays, texts and messages that hold bytes, such as images, are left out. A topic has
the stamps of its headers as its clock, and ``reception``, which a channel map may name instead.
"""

from __future__ import annotations

import math
import re
import types
from array import array
from collections.abc import Callable, Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table, Wanted

SUFFIXES = (".bag", ".db3", ".mcap")

FOLDER = "metadata.yaml"
"""File of a folder that is a bag of ROS 2."""
OWN_TYPE = "harness/msg/Signals"
"""Type of the messages that ``harness.recordings.read.write`` writes: a number for each signal."""
RECEPTION = "reception"
"""Column of the stamps at which messages were received, in every topic's table."""
_STAMP = "header.stamp"
_LARGEST_CHUNK = 2**28
"""Bytes that a chunk of messages, or a message, may be unpacked into."""
_AT_ONCE = 2**22
"""Bytes that are unpacked at a time."""
_DEEPEST = 12
"""Messages within messages."""
_TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_UNITS = {
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "geometry_msgs/msg/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/msg/Accel": {"linear": "m/s^2", "angular": "rad/s^2"},
    "geometry_msgs/msg/Pose": {"position": "m"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "ackermann_msgs/msg/AckermannDrive": {
        "steering_angle": "rad", "steering_angle_velocity": "rad/s", "speed": "m/s", "acceleration": "m/s^2",
    },
}  # fmt: skip
"""Units of fields by the type of the message, as its comments state them."""

_SIGNAL = re.compile(r"^float64 (\w+) # .*, (.*)$", re.M)
"""Name and unit of a signal in the definition of our own type."""

Field = tuple[str, str]
"""Path of a number in a message, and its unit."""


def is_bag(folder: str) -> bool:
    """Return whether a folder is a bag of ROS 2."""
    return (Path(folder) / FOLDER).is_file()


def read(path: str, wanted: Wanted | None = None) -> list[Table]:
    """Return a table for every topic, times in s since 1970, orientations as heading, pitch and roll angle.

    Args:
        path: The bag.
        wanted: Tells by its name whether a column is used; topics without one are not unpacked.

    Raises:
        UserError: If rosbags is not installed, or the bag is damaged, or larger than any recording.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UserError(
            f'{path}: bags are read with rosbags, which is not installed: pip install "robustness-harness[ros]"'
        ) from None
    if any(Path(path).glob("*.zst")):
        raise UserError(f"{path}: its files are packed as a whole; unpack them: ros2 bag convert, or zstd -d *.zst")
    _bound_unpacking()
    ros1 = path.lower().endswith(".bag")
    defaults = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    with refuse_damaged(path, "bag of ROS"), AnyReader([Path(path)], default_typestore=defaults) as reader:
        topics, notes = _topics(reader, wanted)
        refuse_beyond(path, "the bag", sum(len(t.fields) for t in topics.values()), MOST_COLUMNS, "columns")
        used = [c for c in reader.connections if c.topic in topics and c.msgtype == topics[c.topic].kind]
        size = 0
        for connection, stamp, content in reader.messages(used) if used else ():
            topic = topics[connection.topic]
            topic.add(1e-9 * stamp, reader.deserialize(content, connection.msgtype))
            size += 8 * len(topic.fields)
            refuse_beyond(path, "the bag, unpacked,", size, MOST_BYTES, "bytes")
        there = ", ".join(sorted(f"{c.topic} ({c.msgtype})" for c in reader.connections))
    tables = [topic.table() for topic in topics.values() if len(topic.reception)]
    if not tables:
        raise UserError(f"{path}: holds no message with a number: {'; '.join(notes) or there or 'no topic'}")
    tables.sort(key=lambda table: -len(table.columns))
    tables[0] = replace(tables[0], notes=tuple(notes))
    return tables


def _topics(reader: Any, wanted: Wanted | None) -> tuple[dict[str, _Topic], list[str]]:
    """Return the topics with a column that is used, and what is left out as its type is not known."""
    types_of, notes = reader.typestore.fielddefs, []
    topics: dict[str, _Topic] = {}
    for connection in reader.connections:
        name, kind = connection.topic, connection.msgtype
        if kind not in types_of:
            notes.append(f"topic '{name}' is left out: the bag does not define the type of its messages, {kind}")
        elif name in topics and topics[name].kind != kind:
            notes.append(f"messages of type {kind} in topic '{name}' are left out: the others are {topics[name].kind}")
        else:
            own = kind == OWN_TYPE
            fields = _SIGNAL.findall(connection.msgdef.data) if own else list(_fields(types_of, kind))
            topics.setdefault(name, _Topic(name, kind, fields))
    asked = {n: t for n, t in topics.items() if wanted is not None and any(map(wanted, t.names))}
    numeric = {n: t for n, t in topics.items() if t.fields and not _holds_bytes(types_of, t.kind)}
    return asked or numeric, notes  # all of them for an error that lists them


class _Topic:
    """Messages of a topic, number by number.

    Args:
        name: Topic.
        kind: Type of its messages.
        fields: Path and unit of each number.
    """

    def __init__(self, name: str, kind: str, fields: list[Field]) -> None:
        self.kind, self.fields = kind, fields
        self.names = [path if kind == OWN_TYPE else f"{name}.{path}" for path, _ in fields]
        self.reception = array("d")
        self._name = name
        self._values = [array("d") for _ in fields]
        self._get = [_getter(path) for path, _ in fields]

    def add(self, stamp: float, message: Any) -> None:
        """Add a message that was received at a time in s."""
        numbers = [get(message) for get in self._get]
        self.reception.append(stamp)
        for values, number in zip(self._values, numbers, strict=True):
            values.append(number)

    def table(self) -> Table:
        """Return the table; stamps of headers that are never set are no clock."""
        columns: dict[str, Floats] = {RECEPTION: np.array(self.reception)}
        units = {RECEPTION: "s"}
        for name, (_, unit), values in zip(self.names, self.fields, self._values, strict=True):
            columns[name], units[name] = np.array(values), unit
        clock, header = RECEPTION, f"{self._name}.{_STAMP}"
        if header in columns and np.ptp(columns[header]) > 0:
            clock = header
        return Table(columns, {name: unit for name, unit in units.items() if unit}, clock)


def _getter(path: str) -> Callable[[Any], float]:
    """Return what takes a number out of a message: of a time its seconds, of an orientation an angle."""
    parent, _, leaf = path.rpartition(".")
    if leaf in _ANGLES:
        return lambda message: _ANGLES[leaf](attrgetter(parent)(message))
    get = attrgetter(path)

    def number(message: Any) -> float:
        value = get(message)
        return value.sec + 1e-9 * value.nanosec if hasattr(value, "nanosec") else value

    return number


def _heading(q: Any) -> float:
    return math.atan2(2 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2) if _size(q) else math.nan


def _pitch(q: Any) -> float:
    size = _size(q)
    return math.asin(max(-1.0, min(2 * (q.w * q.y - q.z * q.x) / size, 1.0))) if size else math.nan


def _roll(q: Any) -> float:
    return math.atan2(2 * (q.w * q.x + q.y * q.z), q.w**2 - q.x**2 - q.y**2 + q.z**2) if _size(q) else math.nan


def _size(q: Any) -> float:
    """Return the square of the norm; 0 where no orientation is stated."""
    return float(q.w**2 + q.x**2 + q.y**2 + q.z**2)


_ANGLES = {"heading": _heading, "pitch_angle": _pitch, "roll_angle": _roll}
"""Angles of an orientation from axes east, north and up (REP 103) to axes forward, left and up: those of ISO 8855."""


def _fields(types_of: Any, kind: str, prefix: str = "", depth: int = 0) -> Iterator[Field]:
    """Yield the numbers of a type of message; of its header the stamp alone."""
    if depth > _DEEPEST:
        return
    for name, (node, of) in types_of[kind][1]:
        unit, path = _UNITS.get(kind, {}).get(name, ""), f"{prefix}{name}"
        if node.name == "BASE" and of[0] not in ("string", "wstring"):
            yield path, unit
        elif node.name == "NAME" and of in _TIMES:
            yield path, "s"
        elif node.name == "NAME" and of.endswith("/Quaternion"):
            yield from ((f"{path}.{angle}", "rad") for angle in _ANGLES)
        elif node.name == "NAME" and of in types_of:
            inner = _fields(types_of, of, f"{path}.", depth + 1)
            header = of.endswith("/Header")
            yield from ((p, unit or u) for p, u in inner if not header or p == f"{path}.stamp")


def _holds_bytes(types_of: Any, kind: str) -> bool:
    """Return whether a message is an image, a cloud or a file: it holds a sequence of bytes."""
    return any(
        node.name == "SEQUENCE"
        and of[0][0].name == "BASE"
        and of[0][1][0] in ("uint8", "int8", "byte", "octet", "char")
        for _, (node, of) in types_of[kind][1]
    )


def _bound_unpacking() -> None:
    """Let rosbags unpack no chunk and no message into more than memory may hold."""
    from bz2 import BZ2Decompressor

    import rosbags.rosbag1.reader as ros1
    import rosbags.rosbag2.reader as ros2
    import rosbags.rosbag2.storage_mcap as mcap
    from lz4.frame import LZ4FrameDecompressor

    def bounded(decompressor: Callable[[], Any]) -> Callable[..., bytes]:
        def unpack(content: bytes, *_: object) -> bytes:
            unpacking, unpacked = decompressor(), bytearray()
            while not unpacking.eof:
                piece = unpacking.decompress(content, _AT_ONCE)
                content = b""
                unpacked += piece
                if len(unpacked) > _LARGEST_CHUNK:
                    raise ValueError(f"a chunk is unpacked into more than {_LARGEST_CHUNK:,} bytes")
                if not piece and unpacking.needs_input:
                    raise ValueError("a chunk is cut off")
            return bytes(unpacked)

        return unpack

    zstd = mcap.zstd
    ros1.decompressors.update(bz2=bounded(BZ2Decompressor), lz4=bounded(LZ4FrameDecompressor))
    mcap.DECOMPRESSORS.update(lz4=bounded(LZ4FrameDecompressor), zstd=bounded(zstd.ZstdDecompressor))
    vars(ros2)["zstd"] = types.SimpleNamespace(decompress=bounded(zstd.ZstdDecompressor), open=zstd.open)
