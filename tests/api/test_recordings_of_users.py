"""Recordings from memory: frames and datasets mean what a file of the same columns means."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import harness as h
from harness.api.recordings import recordings_of
from harness.recordings import load_recording

TIME = np.round(np.arange(0, 8, 0.01), 9)
RATE = 0.1 * np.sin(2 * TIME)
CHANNELS = {
    "time": {"channel": "t", "unit": "s"},
    "yaw_rate": {"channel": "gyro", "unit": "deg/s", "sign": -1},
    "speed": {"channel": "v", "unit": "km/h"},
}


@pytest.fixture
def log():
    return pd.DataFrame({"t": TIME, "gyro": -np.rad2deg(RATE), "v": np.full(len(TIME), 72.0), "note": "dry"})


def test_a_frame_with_a_map_is_read_as_its_file_is(log, tmp_path):
    log.to_csv(tmp_path / "log.csv", index=False)
    found = h.read_recording(log, CHANNELS, name="lap")
    xr.testing.assert_allclose(found, load_recording(tmp_path / "log.csv", CHANNELS), rtol=1e-12)
    assert found.attrs["name"] == "lap"
    np.testing.assert_allclose(found.yaw_rate, RATE, atol=1e-12)
    assert (found.speed.attrs["units"], float(found.speed[5])) == ("m/s", pytest.approx(20.0))
    assert h.read_recording(tmp_path / "log.csv", CHANNELS).attrs["name"] == "log"


def test_the_step_is_a_number_or_text(log):
    for step in (0.02, "20 ms"):
        assert np.diff(h.read_recording(log, CHANNELS, step=step).time)[0] == pytest.approx(0.02)
    with pytest.raises(h.UserError, match="step: '0 s' must be positive"):
        h.read_recording(log, CHANNELS, step="0 s")


@pytest.mark.parametrize(
    "index", [TIME, pd.to_timedelta(TIME, unit="s"), pd.Timestamp("2026-05-01") + pd.to_timedelta(TIME, unit="s")]
)
def test_the_clock_may_be_the_index_and_stated_units_are_converted(index):
    frame = pd.DataFrame({"yaw_rate": np.rad2deg(RATE), "speed": 20.0}, index=pd.Index(index, name="time"))
    frame.attrs["units"] = {"yaw_rate": "deg/s"}
    found = h.read_recording(frame)
    np.testing.assert_allclose(found.yaw_rate, RATE, atol=1e-9)
    assert float(found.time[-1]) == pytest.approx(TIME[-1])


def test_a_dataset_may_have_several_clocks_and_units():
    slow = TIME[::5]
    source = xr.Dataset(
        {
            "yaw_rate": ("time", np.rad2deg(RATE), {"units": "deg/s"}),
            "speed": ("gps", 20 + slow, {"units": "m/s"}),
        },
        coords={"time": TIME, "gps": slow},
    )
    found = h.read_recording(source)
    np.testing.assert_allclose(found.yaw_rate[:700], RATE[:700], atol=1e-9)
    np.testing.assert_allclose(found.speed[:700], 20 + TIME[:700], atol=1e-9)
    assert found.speed.attrs["rate"] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (pd.DataFrame({"a": ["x"]}), "DataFrame: holds no numeric column"),
        (pd.DataFrame({"time": TIME}), "no column has the name of a signal"),
        (pd.DataFrame({"time": [], "yaw_rate": []}), "holds no numeric column with a row of data"),
        (xr.Dataset({"yaw_rate": ("time", RATE, {"units": "kg"})}, {"time": TIME}), "units of 'yaw_rate'"),
        (3.0, "a recording is a path, a pandas DataFrame or an xarray Dataset, not float"),
    ],
)
def test_what_cannot_be_read_is_refused_in_words(source, message):
    with pytest.raises(h.UserError, match=message):
        h.read_recording(source)


def test_a_map_that_is_wrong_names_its_key(log):
    with pytest.raises(h.UserError, match=r"channels: yaw_rat: is no signal .*closest: yaw_rate"):
        h.read_recording(log, {**CHANNELS, "yaw_rat": CHANNELS["yaw_rate"]})


def test_a_part_of_a_recording_is_one_from_zero_and_the_whole_stays_as_it_is(log):
    whole = h.read_recording(log, CHANNELS)
    (part,) = recordings_of(whole.sel(time=slice(2, 5)), "train")
    assert (float(part.time[0]), float(part.time[-1])) == (0.0, pytest.approx(3.0))
    assert float(whole.time[-1]) > 7.9
    plain = xr.Dataset({"yaw_rate": ("time", RATE)}, {"time": TIME})
    (found,) = recordings_of([plain], "train")
    assert (found.attrs["warnings"], found.yaw_rate.attrs["derived"]) == ([], 0)
    assert plain.yaw_rate.attrs == plain.attrs == {}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], "train: give at least one recording"),
        ([xr.Dataset({"yaw_rate": ("x", RATE)})], r"train\[0\]: has no dimension 'time'"),
        (xr.Dataset({"yaw_rate": ("time", RATE)}, {"time": TIME**2}), "train: is not sampled evenly"),
    ],
)
def test_what_is_no_recording_is_refused(given, message):
    with pytest.raises(h.UserError, match=message):
        recordings_of(given, "train")
