"""Good files of loggers, test benches and bags of ROS to be broken, and texts with preambles."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from bench.fuzz.mutate import damaged, texts

TIME = np.arange(0.0, 2.0, 0.02)
_INFO = """#INFOFILE1.1 - Do not remove this line!
File.Format = erg
File.ByteOrder = LittleEndian
File.At.1.Name = Time
File.At.1.Type = Double
Quantity.Time.Unit = s
File.At.2.Name = speed
File.At.2.Type = Float
Quantity.speed.Unit = m/s
"""
_VBO = "File created\n\n[header]\nsatellites\ntime\nlatitude\nlongitude\nvelocity kmh\n[column names]\n{}\n[data]\n{}\n"
_TYDEX = f"""**HEADER
RELEASE   Release                                 1.3
**MEASURCHANNELS
{"RUNTIME":40}{"s":10}1.0       0.0       0.0
{"FYW":40}{"N":10}-10.0     0.0       0.0
**MEASURDATA
"""
_PREAMBLES = (
    '"Format","MoTeC CSV File",,,"Workbook",""\n"Log Time","10:00:00"\n\n', "Format,3\nSession,A\n\n", "sep=;\n",
    "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\n",
    "[column names]\nsats time lat\n[data]\n", "% x\n",
)  # fmt: skip
_STAMPS = (
    "2025-05-05T10:00:{:09.6f}+02:00", "05.05.2025 10:00:{:06.3f}", "10:00:{:05.2f}", "05-May-2025 10:00:{:06.3f} PM",
    "20250505T1000{:05.2f}Z", "1/2/25 9:{:05.2f}", "{:.2f}", "99/99/9999 99:99:{:05.2f}", "100{:05.2f}",
)  # fmt: skip


def write(folder: Path) -> None:
    """Write the good files into a folder."""
    import scipy.io
    from nptdms import ChannelObject, TdmsWriter

    rows = "\n".join(f"012 1000{t:05.2f} +2880.600 -00660.300 {50 + t:.3f}" for t in TIME)
    (folder / "a.vbo").write_text(_VBO.format("sats time lat long velocity", rows), encoding="utf-8")
    (folder / "a.tdx").write_text(
        _TYDEX + "\n".join(f"{t:.2f} {50 * t:.1f}" for t in TIME) + "\n**END\n", encoding="utf-8"
    )
    stamps = "\n".join(f"({0.02 + 0.01 * (i % 3):010.6f}) can0 100#E803000000000000" for i in range(60))
    (folder / "before.log").write_text(stamps, encoding="utf-8")
    records = np.zeros(len(TIME), np.dtype([("Time", "<f8"), ("speed", "<f4")]))
    records["Time"], records["speed"] = TIME, 20.0 + TIME
    head = b"CM-ERG\0\0\1\0" + struct.pack("<H", records.itemsize) + bytes(4)
    (folder / "a.erg").write_bytes(head + records.tobytes())
    (folder / "a.erg.info").write_text(_INFO, encoding="utf-8")
    with TdmsWriter(folder / "a.tdms") as file:
        about = {"wf_increment": 0.02, "unit_string": "m/s"}
        file.write_segment(
            [ChannelObject("imu", "speed", 20.0 + TIME, about), ChannelObject("imu", "note", ["a", "b"])]
        )
    groups = {"values": np.c_[TIME, TIME], "label": "speed", "dimensions": 2}
    log = {"time": TIME[:, None], "signals": np.array([groups, groups])}
    scipy.io.savemat(folder / "signals.mat", {"speed": np.vstack([TIME, 20.0 + TIME]), "log": log}, do_compression=True)
    _write_bags(folder)


def _write_bags(folder: Path) -> None:
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    def messages(writer: Any, store: Any, serialize: Any) -> None:
        kinds = ("geometry_msgs/msg/Quaternion", "geometry_msgs/msg/Twist", "std_msgs/msg/Float64MultiArray")
        topics = [writer.add_connection(f"/{n}", kind, typestore=store) for n, kind in enumerate(kinds)]
        of = store.types
        for t in TIME:
            vector = of["geometry_msgs/msg/Vector3"](x=20.0 + t, y=0.0, z=0.1)
            layout = of["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            made = (
                of[kinds[0]](x=0.0, y=0.0, z=float(np.sin(t)), w=float(np.cos(t))),
                of[kinds[1]](linear=vector, angular=vector),
                of[kinds[2]](layout=layout, data=np.arange(5.0)),
            )
            for topic, kind, message in zip(topics, kinds, made, strict=True):
                writer.write(topic, int(1e9 * t), serialize(message, kind))

    two, one = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
    for name, plugin in (("mcap", rosbag2.StoragePlugin.MCAP), ("db3", rosbag2.StoragePlugin.SQLITE3)):
        shutil.rmtree(folder / name, ignore_errors=True)
        writer = rosbag2.Writer(folder / name, version=9, storage_plugin=plugin)
        if name == "mcap":
            writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        with writer:
            messages(writer, two, two.serialize_cdr)
        (folder / f"a.{name}").write_bytes((folder / name / f"{name}.{name}").read_bytes())
        shutil.rmtree(folder / name)
    (folder / "a.bag").unlink(missing_ok=True)
    first = rosbag1.Writer(folder / "a.bag")
    first.set_compression(first.CompressionFormat.BZ2)
    with first:
        messages(first, one, one.serialize_ros1)


@st.composite
def preambles(draw: st.DrawFn) -> bytes:
    """Return a table behind a preamble, with a clock as text or in long form, of which some bytes are broken."""
    separator = draw(st.sampled_from((",", ";", "\t", " ", "|")))
    stamp, comma = draw(st.sampled_from(_STAMPS)), draw(st.booleans())
    names = draw(st.sampled_from((["Time", "speed", "yaw_rate"], ["time", "signal", "value"], ["sec", "nanosec", "x"])))
    lines = [separator.join(names)]
    lines += [separator.join(draw(st.lists(st.sampled_from(("s", "km/h", "deg/s", "", "-")), min_size=3, max_size=3)))]
    middle = draw(st.sampled_from(("20.5", "speed", "999999999")))
    for i in range(draw(st.integers(0, 30))):
        cells = [stamp.format(0.02 * i), middle, f"{0.1 * i:.3f}"]
        lines.append(separator.join(c.replace(".", ",") if comma else c for c in cells))
    text = draw(st.sampled_from(_PREAMBLES)) + draw(texts) + "\n" + "\n".join(lines)
    content = text.encode(draw(st.sampled_from(("utf-8", "cp1252", "utf-16"))), errors="replace")
    return draw(damaged(content)) if draw(st.booleans()) else content


def read(path: Path) -> object:
    """Read a file, and propose a channel map for it."""
    from harness.recordings import load_recording
    from harness.recordings.proposal.propose import propose

    (path.parent / "proposed.toml").write_text(propose(path).text, encoding="utf-8")
    return load_recording(path, path.parent / "proposed.toml")
