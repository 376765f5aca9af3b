import io
import json

import asammdf
import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray as xr
from mcap.reader import make_reader

from harness.common.errors import UserError
from harness.recordings import load_recording, readers
from harness.recordings.read import write


@pytest.fixture
def recording():
    time = np.arange(0, 2, 0.01)
    values = {"yaw_rate": np.sin(time), "speed": np.where(np.arange(200) == 7, np.nan, 20 + time)}
    units = {"yaw_rate": "rad/s", "speed": "m/s"}
    return xr.Dataset(
        {n: ("time", v, {"units": units[n], "long_name": f"estimate of the {n}"}) for n, v in values.items()},
        {"time": ("time", time, {"units": "s"})},
        {"start": 12.5, "begun": 1_600_000_000.0, "estimator": "EKF"},
    )


def test_mf4_has_units_and_the_clock_of_the_log(recording, tmp_path):
    path = tmp_path / "a.mf4"
    write.write_recording(recording, path)
    with asammdf.MDF(path) as file:
        signal = file.get("yaw_rate")
        assert file.header.start_time.timestamp() == 1_600_000_000.0
    np.testing.assert_array_equal(signal.samples, recording["yaw_rate"])
    np.testing.assert_array_equal(signal.timestamps, recording["time"] + 12.5)
    assert signal.unit == "rad/s"
    assert [p.name for p in tmp_path.iterdir()] == ["a.mf4"]


def test_mcap_is_a_bag_with_units_on_the_clock_of_the_log(recording, tmp_path):
    path = tmp_path / "a.mcap"
    write.write_recording(recording, path)
    messages = list(make_reader(io.BytesIO(path.read_bytes())).iter_messages())
    schema, channel, first = messages[0]
    assert schema.data.decode().splitlines()[1] == "float64 speed # estimate of the speed, m/s"
    assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
    assert json.loads(channel.metadata["units"])["yaw_rate"] == "rad/s"
    assert first.log_time == 1_600_000_012_500_000_000
    (table,) = readers.read_tables(path)
    for name in recording:
        np.testing.assert_array_equal(table.columns[name], recording[name])


@pytest.mark.parametrize("form", ["mf4", "mcap"])
def test_what_is_written_is_read_back_without_a_map(recording, tmp_path, form):
    path = tmp_path / f"a.{form}"
    write.write_recording(recording, path)
    read = load_recording(path)
    np.testing.assert_allclose(read["yaw_rate"], recording["yaw_rate"], atol=1e-6)  # stamps of MCAP count from 1970
    assert read.sizes == recording.sizes
    units = {k: v for table in readers.read_tables(path) for k, v in table.units.items()}
    assert (units["yaw_rate"], units["speed"]) == ("rad/s", "m/s")


def test_a_log_that_begins_before_its_trigger_begins_at_zero_in_mcap(recording, tmp_path):
    path = tmp_path / "a.mcap"
    write.write_recording(recording.assign_attrs(start=-1.5, begun=0.0), path)
    stamps = [m.log_time for _, _, m in make_reader(io.BytesIO(path.read_bytes())).iter_messages()]
    assert (stamps[0], stamps[-1]) == (0, 1_990_000_000)


def test_parquet_has_units_in_the_metadata_of_its_columns(recording, tmp_path):
    path = tmp_path / "a.parquet"
    write.write_recording(recording, path)
    table = pq.read_table(path)
    assert table.schema.field("speed").metadata == {b"unit": b"m/s"}
    np.testing.assert_array_equal(table["log_time"], recording["time"] + 12.5)
    assert readers.read_tables(path)[0].units["yaw_rate"] == "rad/s"


@pytest.mark.parametrize("form", ["mf4", "parquet"])
def test_what_is_written_is_read_again_with_the_same_bits(recording, tmp_path, form):
    path = tmp_path / f"a.{form}"
    write.write_recording(recording, path)
    columns = readers.read(path)
    for name in recording:
        np.testing.assert_array_equal(columns[name], recording[name])
    assert load_recording(path).attrs["start"] == (12.5 if form == "mf4" else 0.0)


@pytest.mark.parametrize(("form", "extra"), [("mf4", "mdf"), ("mcap", "ros")])
def test_an_absent_package_is_one_line_that_names_the_extra(tmp_path, monkeypatch, form, extra):
    monkeypatch.setattr(write, "find_spec", lambda _: None)
    with pytest.raises(UserError, match=rf"pip install \"robustness-harness\[{extra}\]\"$"):
        write.check_target(tmp_path / f"a.{form}")


@pytest.mark.parametrize("form", ["mf4", "mcap", "parquet"])
def test_a_file_that_cannot_be_finished_leaves_the_old_one(recording, tmp_path, monkeypatch, form):
    path = tmp_path / f"a.{form}"
    path.write_bytes(b"old")
    broken = recording.assign(speed=("time", np.array([object()] * 200)))
    with pytest.raises(Exception):  # noqa: B017, PT011 whatever the library raises
        write.write_recording(broken, path)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"
