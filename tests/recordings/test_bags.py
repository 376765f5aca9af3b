"""Bags of ROS 1 and 2 that rosbags writes: topics on their own clocks, types of their own, chunks that are packed."""

import sys
import tracemalloc

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import storage_mcap
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from harness.common.errors import UserError
from harness.recordings import load_recording, readers
from harness.recordings.proposal.propose import propose
from harness.recordings.readers import bag

STEERING = "std_msgs/Header header\nfloat64 angle\nfloat64[] more\nuint8[4] raw\nstring note\n"
START = 1746439200
TIME = np.arange(3000) * 0.01
SPEED, WHEEL = 15 + 3 * np.sin(0.2 * TIME), 0.03 * np.sin(0.8 * TIME)
RATE = SPEED * WHEEL / 2.8
HEADING = np.cumsum(RATE) * 0.01


class Drive:
    """Messages of a car's drive, in the types of ROS 1 or 2."""

    def __init__(self, store):
        self.store = get_typestore(store)
        self.store.register(get_types_from_msg(STEERING, "car_msgs/msg/Steering"))

    def made(self, name, **fields):
        """Return a message, zeros and nothing where no field is given."""
        kinds = {"float64": 0.0, "float32": 0.0, "string": ""}
        for field, (node, of) in self.store.fielddefs[name][1]:
            if field not in fields:
                nothing = {"ARRAY": lambda of: np.zeros(of[1]), "SEQUENCE": lambda _: np.zeros(0)}
                make = nothing.get(node.name) or (
                    lambda of, n=node: self.made(of) if n.name == "NAME" else kinds.get(of[0], 0)
                )
                value = make(of)
                fields[field] = value.astype(of[0][1][0]) if isinstance(value, np.ndarray) else value
        return self.store.types[name](**fields)

    def header(self, t):
        stamp = self.made("builtin_interfaces/msg/Time", sec=int(START + t), nanosec=round(t % 1 * 1e9))
        return self.made("std_msgs/msg/Header", stamp=stamp)

    def write(self, writer, serialize):
        """Write imu and wheel at 100 and 50 Hz, received 3 and 20 ms late, a camera and a speed without a header."""
        kinds = {
            "/imu/data": "sensor_msgs/msg/Imu",
            "/steering": "car_msgs/msg/Steering", "/camera": "sensor_msgs/msg/Image",
            "/speed": "std_msgs/msg/Float64", "/vel": "geometry_msgs/msg/TwistStamped",
        }  # fmt: skip
        topics = {topic: writer.add_connection(topic, kind, typestore=self.store) for topic, kind in kinds.items()}

        def add(topic, t, late, **fields):
            message = self.made(kinds[topic], **fields)
            writer.write(topics[topic], round((START + t + late) * 1e9), serialize(message, kinds[topic]))

        for i, t in enumerate(TIME):
            half = 0.5 * HEADING[i]
            turned = self.made("geometry_msgs/msg/Quaternion", z=float(np.sin(half)), w=float(np.cos(half)))
            turn = self.made("geometry_msgs/msg/Vector3", z=float(RATE[i]))
            pull = self.made("geometry_msgs/msg/Vector3", y=float(SPEED[i] * RATE[i]), z=9.81)
            imu = {"orientation": turned, "angular_velocity": turn, "linear_acceleration": pull}
            add("/imu/data", t, 0.003, header=self.header(t), **imu)
            if i % 2 == 0:
                add("/steering", t, 0.02, header=self.header(t), angle=float(WHEEL[i]), more=np.arange(5.0))
                forward = self.made("geometry_msgs/msg/Vector3", x=float(SPEED[i]))
                twist = self.made("geometry_msgs/msg/Twist", linear=forward)
                add("/vel", t, 0.0, header=self.header(t), twist=twist)
                add("/speed", t, 0.0, data=float(SPEED[i]))
            if i % 200 == 0:
                add("/camera", t, 0.0, header=self.header(t), data=np.zeros(2**20, np.uint8))


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Return the paths of one drive in every form."""
    folder, two, one = tmp_path_factory.mktemp("bags"), Drive(Stores.ROS2_HUMBLE), Drive(Stores.ROS1_NOETIC)
    for name, plugin in (("mcap", rosbag2.StoragePlugin.MCAP), ("db3", rosbag2.StoragePlugin.SQLITE3)):
        with rosbag2.Writer(folder / name, version=9, storage_plugin=plugin) as writer:
            two.write(writer, two.store.serialize_cdr)
    writer = rosbag1.Writer(folder / "one.bag")
    writer.set_compression(writer.CompressionFormat.LZ4)
    with writer:
        one.write(writer, one.store.serialize_ros1)
    places = {
        "mcap folder": "mcap",
        "mcap": "mcap/mcap.mcap",
        "db3 folder": "db3",
        "db3": "db3/db3.db3",
        "bag": "one.bag",
    }
    return {name: folder / place for name, place in places.items()}


@pytest.mark.parametrize("form", ["mcap folder", "mcap", "db3 folder", "db3", "bag"])
def test_topics_are_tables_on_their_own_clocks(bags, form):
    tracemalloc.start()
    tables = {table.clock: table for table in readers.read_tables(bags[form])}
    assert tracemalloc.get_traced_memory()[1] < 60e6
    tracemalloc.stop()
    imu, wheel, speed = (tables[c] for c in ("/imu/data.header.stamp", "/steering.header.stamp", "reception"))
    assert not any("/camera" in column for table in tables.values() for column in table.columns)
    assert set(wheel.columns) == {"reception", "/steering.header.stamp", "/steering.angle"}
    np.testing.assert_allclose(imu.columns["/imu/data.header.stamp"], START + TIME, atol=1e-6)
    np.testing.assert_allclose(wheel.columns["reception"], START + TIME[::2] + 0.02, atol=1e-6)
    np.testing.assert_array_equal(imu.columns["/imu/data.angular_velocity.z"], RATE)
    np.testing.assert_allclose(imu.columns["/imu/data.orientation.heading"], HEADING, atol=1e-12)
    np.testing.assert_array_equal(speed.columns["/speed.data"], SPEED[::2])
    assert imu.units["/imu/data.linear_acceleration.y"] == "m/s^2"


def test_a_bag_is_proposed_a_map_for_and_read_by_headers_or_reception(bags, tmp_path):
    (tmp_path / "map.toml").write_text(propose(bags["mcap"]).text, encoding="utf-8")
    recording = load_recording(bags["mcap"], tmp_path / "map.toml")
    for name, values in {"speed": SPEED, "yaw_rate": RATE, "road_wheel_angle": WHEEL}.items():
        there = np.interp(recording["time"] + recording.attrs["start"] - START, TIME, values)
        np.testing.assert_allclose(recording[name], there, atol=2e-3)
    mapped = {
        "yaw_rate": {"channel": "/imu/data.angular_velocity.z"},
        "road_wheel_angle": {"channel": "/steering.angle"},
    }
    mapped["road_wheel_angle"]["unit"] = "rad"
    late = load_recording(bags["mcap"], {**mapped, "time": {"channel": "reception", "unit": "s"}})
    time = late["time"] + late.attrs["start"] - START
    np.testing.assert_allclose(late["yaw_rate"], np.interp(time - 0.003, TIME, RATE), atol=1e-4)
    np.testing.assert_allclose(late["road_wheel_angle"], np.interp(time - 0.02, TIME, WHEEL), atol=1e-4)


@pytest.mark.parametrize("angles", [(0.7, 0.2, -0.1), (-3.0, -0.4, 0.5)])
def test_an_orientation_is_heading_pitch_and_roll_of_iso_8855(angles):
    """Axes forward, left and up, turned first by the heading, then by the pitch (nose down is positive), then roll."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in zip((3, 2, 1), angles, strict=True):
        turn = np.zeros(4)
        turn[0], turn[axis] = np.cos(angle / 2), np.sin(angle / 2)
        (a, u), (b, v) = (quaternion[0], quaternion[1:]), (turn[0], turn[1:])
        quaternion = np.concatenate([[a * b - u @ v], a * v + b * u + np.cross(u, v)])
    q = type("Quaternion", (), dict(zip("wxyz", quaternion, strict=True)))
    names = ("heading", "pitch_angle", "roll_angle")
    np.testing.assert_allclose([bag._ANGLES[name](q) for name in names], angles, atol=1e-12)
    unset = type("Quaternion", (), dict.fromkeys("wxyz", 0.0))
    assert np.isnan([bag._ANGLES[name](unset) for name in names]).all()


def test_a_topic_whose_type_is_not_defined_is_named(tmp_path):
    drive = Drive(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "a", version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        drive.write(writer, drive.store.serialize_cdr)
    import sqlite3

    with sqlite3.connect(tmp_path / "a" / "a.db3") as base:  # as before ROS 2 Iron
        base.execute("DELETE FROM message_definitions")
    tables = readers.read_tables(tmp_path / "a" / "a.db3")
    assert "/imu/data.angular_velocity.z" in {c for t in tables for c in t.columns}
    assert tables[0].notes == (
        "topic '/steering' is left out: the bag does not define the type of its messages, car_msgs/msg/Steering",
    )


@pytest.mark.parametrize(("form", "cut"), [("mcap", 5000), ("db3", 5000), ("bag", 5000), ("mcap", 10), ("bag", 10)])
def test_a_damaged_bag_is_refused(bags, tmp_path, form, cut):
    path = tmp_path / bags[form].name
    path.write_bytes(bags[form].read_bytes()[:cut])
    with pytest.raises(UserError, match=r"is damaged or no bag of ROS"):
        readers.read(path)


def test_a_folder_that_has_lost_its_metadata_names_its_file(tmp_path):
    (tmp_path / "bag_0.db3").touch()
    with pytest.raises(UserError, match=r"holds bag_0\.db3 and no metadata\.yaml; give the path of that file"):
        readers.read_tables(tmp_path)


def test_a_chunk_that_unpacks_to_more_than_it_may_is_refused(bags, monkeypatch):
    monkeypatch.setattr(bag, "_LARGEST_CHUNK", 1000)
    with pytest.raises(UserError, match="a chunk is unpacked into more than 1,000 bytes"):
        readers.read(bags["bag"])
    packed = storage_mcap.zstd.compress(bytes(2000))
    with pytest.raises(ValueError, match="more than 1,000"):
        storage_mcap.DECOMPRESSORS["zstd"](packed, 2000)


def test_missing_rosbags_is_one_line_that_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    (tmp_path / "a.mcap").write_bytes(b"x")
    with pytest.raises(UserError, match=r"pip install .robustness-harness\[ros\]"):
        readers.read(tmp_path / "a.mcap")
