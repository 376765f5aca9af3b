"""Measured drives: channel maps, time bases, gaps and spikes; the drives of the project's maps."""

import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import inputs, load_recording, measurements
from harness.recordings.check.examine import recording_warnings
from harness.recordings.motion.consistency import check
from harness.recordings.read import resample
from harness.recordings.read.channel_map import load_map
from harness.recordings.read.clock import check_clock, spikes, updates
from harness.recordings.read.resample import onto_grid
from support.weaving_car import CLOCK, STEP, TIME, drive, stored

MEASURED = Path(__file__).parents[3] / "shared" / "measured"
MAPS = Path(__file__).parents[2] / "studies" / "channels"
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"the measured drives are no part of the project; put them into {MEASURED}"
)


def test_columns_named_as_signals_need_no_map(tmp_path):
    columns = drive(TIME)
    path, _ = stored(tmp_path, {**columns, "note": 1.0, "true_yaw_rate": columns["yaw_rate"] + 0.01})
    recording = load_recording(path)
    assert set(recording.data_vars) == {*columns, "true_yaw_rate"} - {"time"}
    assert recording["yaw_rate"].attrs["units"] == "rad/s"
    np.testing.assert_allclose(recording["lateral_velocity"], columns["lateral_velocity"], atol=1e-9)
    assert recording.attrs["warnings"] == []
    np.testing.assert_allclose(measurements(recording, ["yaw_rate"])[:, 0], columns["yaw_rate"], atol=1e-9)
    assert inputs(recording, ["yaw_rate", "heading"]).shape == (len(TIME), 2)
    with pytest.raises(UserError, match="lacks 'yaw_rat'; closest: yaw_rate"):
        inputs(recording, ["yaw_rat"])


@pytest.mark.parametrize("marker", [np.inf, -np.inf, np.nan, 3.4028235e38, -1.7976931348623157e308])
def test_what_no_sensor_measures_is_missing(tmp_path, marker):
    """Programs write the largest number of a type where a sample is missing; joined, it overflows."""
    columns = drive(TIME)
    columns["yaw_rate"][[40, 41]] = marker
    recording = load_recording(stored(tmp_path, columns)[0])
    assert recording["yaw_rate"].attrs["missing"] == 2
    assert np.abs(recording["yaw_rate"]).max() < 10.0


def test_unit_sign_factor_offset_and_curve(tmp_path):
    truth = drive(TIME)
    columns = {
        "ms": TIME * 1e3,
        "gyro": -np.degrees(truth["yaw_rate"]),
        "wheel": (truth["road_wheel_angle"] - 0.0056) / 0.88,
        "kmh": truth["longitudinal_velocity"] * 3.6,
        "azimuth": np.degrees(np.pi / 2 - truth["heading"]) % 360,
        "command": np.tan(truth["road_wheel_angle"]),
    }
    bend = np.linspace(-0.5, 0.5, 41)
    path, channels = stored(
        tmp_path,
        columns,
        time='{ channel = "ms", unit = "ms" }',
        yaw_rate='{ channel = "gyro", unit = "deg/s", sign = -1 }',
        road_wheel_angle='{ channel = "wheel", unit = "rad", factor = 0.88, offset = 0.0056 }',
        longitudinal_velocity='{ channel = "kmh", unit = "km/h" }',
        heading='{ channel = "azimuth", unit = "deg", sign = -1, offset = "90 deg" }',
        steering_wheel_angle='{ channel = "command", unit = "rad", '
        f"curve = {{ channel = {bend.tolist()}, value = {np.arctan(bend).tolist()} }} }}",
    )
    found = load_recording(path, channels)
    for name in ("yaw_rate", "road_wheel_angle", "longitudinal_velocity"):
        np.testing.assert_allclose(found[name], truth[name], atol=1e-9)
    np.testing.assert_allclose(found["steering_wheel_angle"], truth["road_wheel_angle"], atol=1e-5)
    np.testing.assert_allclose(np.diff(found["heading"]), np.diff(truth["heading"]), atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * found["heading"].values), np.exp(1j * truth["heading"]), atol=1e-9)


@pytest.mark.parametrize(
    ("lines", "tail", "message"),
    [
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "" }'}, "", r"yaw_rate.unit: is blank"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "  " }'}, "", r"yaw_rate.unit: is blank"),
        ({"yaw_rate": '{ channel = "yaw_rate" }'}, "", r"yaw_rate.unit: .*drive.csv states none for"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "m/s" }'}, "", r"yaw_rate.unit: .* does not fit"),
        ({"yaw_rte": '{ channel = "a", unit = "1/s" }'}, "", r"yaw_rte: is no signal .*closest: yaw_rate"),
        ({"yaw_rate": '{ channel = "a", unit = "rad/s" }'}, "", r"has no channel 'a'"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", sgn = -1 }'}, "", r"yaw_rate.sgn: unknown key .*sign"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", sign = 2 }'}, "", r"yaw_rate.sign"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", factor = 0 }'}, "", r"factor: 0.0 leaves nothing"),
        (
            {"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", factor = "1_5" }'},
            "",
            r"yaw_rate.factor: '1_5' means '15'; write it so",
        ),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", factor = nan }'}, "", r"factor: .*finite number"),
        (
            {"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", delay = "1,5 s" }'},
            "",
            r"yaw_rate.delay: '1,5 s' may mean '1.5 s' or '15 s'",
        ),
        (
            {"heading": '{ channel = "heading", unit = "rad", curve = { channel = [0, 1], value = [0, "1,5"] } }'},
            "",
            r"heading.curve.value\[1\]: '1,5' may mean '1.5' or '15'",
        ),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", lag = "-1 s" }'}, "", r"lag: -1 s is negative"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", point = "imu" }'}, "", r"no \[points.imu\]"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", delay = "estimate" }'}, "", r"nothing to be compared"),
        ({"yaw_rate": '"yaw_rate"'}, "", r"expected a table"),
        ({}, "", r"maps no signal"),
        (
            {"heading": '{ channel = "heading", unit = "rad" }'},
            '[derive]\nsignals = ["lateral_velocity"]',
            r"'lateral_velocity' takes position_x and position_y and heading",
        ),
        (
            {"heading": '{ channel = "heading", unit = "rad" }'},
            '[derive]\nsignals = ["friction"]',
            r"'friction' cannot be derived",
        ),
        (
            {"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s" }'},
            '[recording]\nstart = "50 s"',
            r"nothing lies between",
        ),
        (
            {"heading": '{ channel = "heading", unit = "rad", curve = { channel = [0, 1], value = [0, 1] } }'},
            "",
            r"heading.curve: the channel reaches .* the curve goes from 0 to 1",
        ),
    ],
)
def test_wrong_maps_are_refused_with_key_and_remedy(tmp_path, lines, tail, message):
    path, channels = stored(tmp_path, drive(TIME[:500]), time=CLOCK, **lines, tail=tail)
    with pytest.raises(UserError, match=message):
        load_recording(path, channels)


def test_file_without_clock_or_with_another_unit_is_refused(tmp_path):
    columns = drive(TIME[:500])
    del columns["time"]
    path, channels = stored(tmp_path, columns, yaw_rate='{ channel = "yaw_rate", unit = "rad/s" }')
    with pytest.raises(UserError, match=r"no clock is stored with 'yaw_rate'.*\[recording\] rate"):
        load_recording(path, channels)
    channels.write_text(channels.read_text() + '[recording]\nrate = "50 Hz"')
    assert float(load_recording(path, channels)["time"][-1]) == pytest.approx(499 / 50)
    path.write_text("time,yaw_rate\ns,deg/s\n0,1\n1,2\n")
    with pytest.raises(UserError, match=r"column 'yaw_rate' is in deg/s by the file.*channel map"):
        load_recording(path)
    path.write_text("a,b\n0,1\n1,2\n")
    with pytest.raises(UserError, match="the file holds a, b"):
        load_recording(path)


def test_stamps_that_jump_are_left_out_or_refused():
    time = TIME.copy()
    time[100], time[200:203] = time[98], time[199]
    clock = check_clock(time, "a.csv: 't'")
    assert len(clock.rows) == len(time) - 4
    assert "4 rows left out" in clock.warnings[0]
    assert "row 101" in clock.warnings[0]
    with pytest.raises(UserError, match="repeat or jump back"):
        check_clock(np.concatenate([TIME, TIME]), "a.csv: 't'")
    with pytest.raises(UserError, match="no two stamps increase"):
        check_clock(np.zeros(9), "a.csv: 't'")
    near = np.insert(TIME, 100, np.nextafter(TIME[99], np.inf))  # a slope over this step is no number
    assert len(check_clock(near, "a.csv: 't'").rows) == len(TIME)


def test_clock_that_jumps_far_ahead_is_refused(tmp_path):
    time = np.where(TIME > 20, TIME + 1e9, TIME)
    path, _ = stored(tmp_path, {"time": time, "yaw_rate": np.sin(TIME)})
    with pytest.raises(UserError, match=r"the clock jumps from 20 to 1e\+09 s at row 2001"):
        load_recording(path)


def test_a_step_that_is_far_too_small_is_refused_in_a_line(tmp_path):
    path, _ = stored(tmp_path, {"time": TIME, "yaw_rate": np.sin(TIME)})
    with pytest.raises(
        UserError, match=r"at a step of 1e-140 s are \d\.?\d*e\+14\d samples; take one nearer to that of"
    ):
        load_recording(path, step=1e-140)


def test_an_input_with_a_gap_names_the_longest_part_without(tmp_path):
    columns = drive(TIME)
    step, keep = TIME[1] - TIME[0], ~((TIME > 3) & (TIME < 4))
    path, _ = stored(tmp_path, {n: v[keep] for n, v in columns.items()})
    with pytest.raises(UserError, match=r"take a part without a gap, the longest is .*@(\d.*)s:, or") as caught:
        inputs(load_recording(path), ["yaw_rate"])
    part = re.search(r"the longest is (\S+@\S+:),", str(caught.value))[1]
    found = load_recording(part)
    assert len(inputs(found, ["yaw_rate"])) == pytest.approx((TIME[-1] - 4) / step, abs=2)
    rest = load_recording(f"{path}@2s:")
    assert re.search(r"the longest is (\S+@\S+:),", _refused(rest))[1] == part


def _refused(recording):
    with pytest.raises(UserError) as caught:
        inputs(recording, ["yaw_rate"])
    return str(caught.value)


def test_gaps_stay_missing_and_short_ones_are_bridged(tmp_path):
    truth = drive(TIME)
    values = truth["yaw_rate"].copy()
    values[1000:1200] = np.nan
    values[2000:2003] = np.nan
    path, _ = stored(tmp_path, {"time": TIME, "yaw_rate": values, "heading": truth["heading"]})
    recording = load_recording(path)
    found = recording["yaw_rate"].values
    assert np.isnan(found[1001:1199]).all()
    assert np.isfinite(found[2000:2003]).all()
    np.testing.assert_allclose(found[2000:2003], truth["yaw_rate"][2000:2003], atol=5e-5)
    (warning,) = recording.attrs["warnings"]
    assert "gaps longer than 0.05 s: 1" in warning
    assert "t = 9.99 s" in warning
    with pytest.raises(UserError, match=r"'yaw_rate' drives the model and is missing at \d+ of 4000 samples"):
        inputs(recording, ["yaw_rate"])
    assert np.isnan(measurements(recording, ["yaw_rate"])[1100, 0])


def test_two_clocks_meet_on_one_time_base(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    slow = np.arange(0, 40, 0.05) + 0.013
    path = tmp_path / "a.mat"
    scipy_io.savemat(
        path, {"t": TIME, "v": 10 + np.sin(TIME), "w": np.cos(TIME), "gps": {"t": slow, "psi": np.sin(slow)}}
    )
    channels = tmp_path / "map.toml"
    channels.write_text(
        'time = [{ channel = "t", unit = "s" }, { channel = "gps.t", unit = "s" }]\n'
        'speed = { channel = "v", unit = "m/s" }\nheading = { channel = "gps.psi", unit = "rad" }\n'
    )
    recording = load_recording(path, channels)
    time = recording["time"].values + recording.attrs["start"]
    np.testing.assert_allclose(recording["heading"][1:], np.sin(time)[1:], atol=2e-4)
    np.testing.assert_allclose(recording["speed"], 10 + np.sin(time), atol=1e-9)


def test_resampling_keeps_what_the_grid_carries_and_no_alias():
    time = np.arange(0, 20, 0.001)
    grid = np.arange(0, 19.99, 0.01)
    slow, fast = np.sin(2 * np.pi * 5 * time), np.sin(2 * np.pi * 93 * time)
    middle = slice(100, -100)
    found = onto_grid(time, slow + fast, grid, 0.1)
    np.testing.assert_allclose(found[middle], np.sin(2 * np.pi * 5 * grid)[middle], atol=5e-3)
    naive = np.interp(grid, time, slow + fast)
    assert (
        np.abs(naive - np.sin(2 * np.pi * 5 * grid))[middle].max() > 0.9
    )  # without the low pass it would fold to 7 Hz


@pytest.mark.parametrize(
    ("rate", "offset"),
    [(200.0, 0.0), (200.0, 0.0013), (128.0, 0.002), (1000.0, 0.0), (104.0, 0.002), (100.0, 0.003), (100.0, 0.005)],
)
def test_white_noise_is_white_on_a_grid_beside_the_samples(rate, offset):
    time = np.arange(0, 602, 1 / rate)
    grid = np.arange(1, 601, STEP) + offset
    found = onto_grid(time, np.random.default_rng(0).standard_normal(len(time)), grid, 0.1)
    assert found.var() == pytest.approx(1 / (STEP * rate), rel=0.03)
    lags = [float(np.mean(found[k:] * found[:-k]) / found.var()) for k in range(1, 9)]
    assert np.abs(lags).max() < 4 / np.sqrt(len(grid))


def test_samples_that_come_at_the_instants_are_left_as_they_are():
    values = np.random.default_rng(0).standard_normal(len(TIME))
    np.testing.assert_array_equal(onto_grid(TIME + 0.013, values, TIME[50:-50] + 0.013, 0.1), values[50:-50])


def test_uneven_stamps_are_joined_without_bias():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.008, 0.012, 4000))
    grid = np.arange(time[0], time[-1], STEP)
    np.testing.assert_allclose(onto_grid(time, np.sin(3 * time), grid, 0.1), np.sin(3 * grid), atol=1e-4)


def test_held_samples_are_told_from_coarse_ones():
    rng = np.random.default_rng(1)
    slow = np.repeat(rng.standard_normal(400), rng.integers(9, 12, 400))
    new, ratio = updates(slow)
    assert ratio == 9
    assert new.sum() == pytest.approx(400, abs=15)
    coarse = np.round(np.sin(TIME) * 40) / 40 + 0.0
    new, ratio = updates(np.round(coarse + rng.normal(0, 0.004, len(TIME)), 2))
    assert ratio == 1
    assert new.all()


@pytest.mark.parametrize(
    "values",
    [
        np.repeat([0.5, -0.5] * 5, 160),  # from lock to lock by a generator
        np.repeat(np.linspace(-3, 3, 12), [188, 217, 305, 420, 190, 260, 233, 350, 199, 281, 240, 310]),  # by hand
    ],
)
def test_a_channel_that_rests_is_not_a_slow_one(values):
    new, ratio = updates(values)
    assert ratio == 1
    assert new.all()


def test_a_slow_channel_that_rests_at_times_is_still_slow():
    runs = np.where(np.arange(120) % 40 == 39, 700, 10)
    new, ratio = updates(np.repeat(np.round(8 * np.sin(np.arange(120) / 3)), runs))  # in coarse steps
    assert ratio == 10
    assert new.sum() == pytest.approx(runs.sum() / 10, rel=0.02)


def test_a_sample_that_came_early_does_not_hide_the_rate_of_a_slow_channel(recwarn):
    runs = np.where(np.arange(800) % 25 == 24, 1, 10)  # one is no multiple of ten, not even of none
    new, ratio = updates(np.repeat(np.random.default_rng(3).standard_normal(800), runs))
    assert ratio == 10
    assert new.sum() == 800
    assert not recwarn.list


def test_only_new_samples_of_a_slow_channel_count_as_measured(tmp_path):
    truth = drive(TIME)
    rows = np.arange(len(TIME)) // 10 * 10
    path, _ = stored(tmp_path, {"time": TIME, "heading": truth["heading"], "yaw_rate": truth["yaw_rate"][rows]})
    recording = load_recording(path)
    measured = measurements(recording, ["heading", "yaw_rate"])
    assert np.isfinite(measured[:, 0]).all()
    assert np.isfinite(measured[:, 1]).mean() == pytest.approx(0.1, abs=0.005)
    np.testing.assert_allclose(recording["yaw_rate"], truth["yaw_rate"][: recording.sizes["time"]], atol=4e-3)
    assert "10 rows repeat each sample" in recording.attrs["warnings"][0]


def test_a_long_recording_is_read_in_little_more_memory_than_it_has(tmp_path, monkeypatch):
    """Peak of the arrays, as a multiple of one column: 6 are read, 6 are returned; it was 45."""
    monkeypatch.setattr(resample, "_AT_ONCE", 10_000)
    time = 0.001 * np.arange(200_000)
    names = ("speed", "yaw_rate", "lateral_acceleration", "steering_wheel_angle", "heading")
    stored(tmp_path, {"time": time} | {name: np.sin(0.3 * time + i) for i, name in enumerate(names)})
    load_recording(tmp_path / "drive.csv@0s:1s")  # imports
    tracemalloc.start()
    recording = load_recording(tmp_path / "drive.csv")
    peak = tracemalloc.get_traced_memory()[1] / time.nbytes
    tracemalloc.stop()
    assert recording.sizes["time"] == len(time)
    assert peak < 22.0


@pytest.mark.parametrize("samples", [13, 200, 201])
def test_samples_are_joined_in_pieces_as_in_a_whole(monkeypatch, samples):
    rng = np.random.default_rng(samples)
    time, values = np.cumsum(rng.uniform(0.005, 0.015, samples)), rng.normal(size=samples)
    values[3:8] = values[3]
    wanted = np.sort(np.concatenate([rng.uniform(time[0], time[-1], 500), time]))
    whole = resample._join(time, values, wanted)
    monkeypatch.setattr(resample, "_AT_ONCE", 10)
    np.testing.assert_array_equal(resample._join(time, values, wanted), whole)
    assert np.isfinite(whole).all()


def test_a_spike_at_an_end_has_the_other_end_for_a_neighbour():
    """What a spike is was told over all samples at once, and stays so where only the outliers are looked at."""
    rng = np.random.default_rng(0)
    for first, last in ((9.0, 0.0), (0.0, 9.0), (0.0, 0.0)):
        x = 0.01 * rng.normal(size=50)
        x[0], x[-1], x[20] = x[0] + first, x[-1] + last, 5.0
        away = np.abs(x - np.array([np.median(np.pad(x, 2, mode="edge")[i : i + 5]) for i in range(50)]))
        before, after = np.abs(np.diff(x, prepend=x[0])), np.abs(np.diff(x, append=x[-1]))
        alone = np.minimum(before, after) > 4 * np.abs(np.roll(x, 1) - np.roll(x, -1))
        expected = (away > 12.0 * 1.4826 * np.median(away[away > 0])) & alone
        np.testing.assert_array_equal(spikes(x), expected)
        assert spikes(x)[20]


def test_spikes_are_found_reported_and_removed_on_request(tmp_path):
    rng = np.random.default_rng(2)
    truth = drive(TIME)
    values = truth["yaw_rate"] + rng.normal(0, 2e-3, len(TIME))
    values[[700, 3000]] += 0.5
    np.testing.assert_array_equal(np.flatnonzero(spikes(values)), [700, 3000])
    step = np.where(TIME > 20, 1.0, 0.0) + rng.normal(0, 1e-3, len(TIME))
    assert not spikes(step).any()
    path, channels = stored(
        tmp_path, {"time": TIME, "w": values}, time=CLOCK, yaw_rate='{ channel = "w", unit = "rad/s" }'
    )
    kept = load_recording(path, channels)
    assert "single-sample spikes: 2 (t = 7.00, 30.00 s); kept" in kept.attrs["warnings"][0]
    assert kept["yaw_rate"].values[700] == pytest.approx(values[700])
    channels.write_text(channels.read_text().replace('"rad/s"', '"rad/s", remove_spikes = true'))
    removed = load_recording(path, channels)
    assert abs(removed["yaw_rate"].values[700] - truth["yaw_rate"][700]) < 0.02
    said = "single-sample spikes, treated as missing: yaw_rate 2 (t = 7.00, 30.00 s)"
    assert removed.attrs["warnings"] == [said]
    both = recording_warnings([removed.assign_attrs(name=name) for name in ("first", "second")])
    assert both == (f"first and second: {said}",)
    assert recording_warnings([removed.assign_attrs(name="part")] * 2) == (f"part: {said}",)


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.toml")), ids=lambda p: p.stem)
def test_maps_of_the_project_are_valid(path):
    found = load_map(path)
    assert found.title
    assert "(c)" in found.source


def test_map_of_the_scaled_car_is_the_steering_map_of_its_authors():
    from scipy.interpolate import PchipInterpolator

    mapped = next(c for c in load_map(MAPS / "dart_scaled_car.toml").channels if c.signal == "road_wheel_angle")
    s = np.linspace(-1, 1, 2001)
    w = 0.5 * (np.tanh(30 * s) + 1)
    angle = w * 0.3658 * np.tanh(1.3929 * s) + (1 - w) * 0.5148 * np.tanh(1.0230 * s)
    np.testing.assert_allclose(PchipInterpolator(*mapped.curve)(s), angle, atol=1e-4)


@needs_measured
def test_measured_passenger_car():
    recording = load_recording(MEASURED / "genesis_g80" / "path1_6_20.mat", MAPS / "genesis_g80.toml")
    assert recording.sizes["time"] == pytest.approx(6700, abs=50)
    assert 0.01 < recording["yaw_rate"].attrs["delay"] < 0.04
    assert np.isfinite(inputs(recording, ["steering_wheel_angle", "speed"])).all()


@needs_measured
def test_measured_racing_car():
    recording = load_recording(MEASURED / "revs_250lm", MAPS / "revs_250lm.toml")
    assert recording.sizes["time"] == 35000
    assert np.abs(recording["road_wheel_angle"]).max() < 0.127  # the spike reached 0.136
    signals = {str(n): v.values for n, v in recording.data_vars.items()}
    lateral = next(f for f in check(signals, STEP) if f.relation.signal == "lateral_acceleration")
    assert lateral.explained > 0.99


@needs_measured
def test_measured_scaled_car():
    (file,) = (MEASURED / "dart_scaled_car").glob("91_*10_27_02.csv.gz")
    recording = load_recording(file, MAPS / "dart_scaled_car.toml")
    assert np.isfinite(measurements(recording, ["yaw_rate"])).mean() == pytest.approx(0.1, abs=0.01)
    assert 0.02 < recording["yaw_rate"].attrs["delay"] < 0.08
    difference = recording["speed"] - recording["longitudinal_velocity"]
    assert abs(float(difference.mean())) < 0.2
