"""Measured drives: channel maps, resampling, kinematics, consistency. A car drives an exact path in closed form."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.errors import UserError
from harness.measured import axles, inputs, kinematics, load_recording, measurements
from harness.measured.channel_map import load_map
from harness.measured.consistency import check
from harness.measured.differentiate import local_polynomial
from harness.measured.resample import first_order_lag, onto_grid
from harness.measured.samples import check_clock, spikes, updates

STEP = 0.01
MEASURED = Path(__file__).parents[3] / "shared" / "measured"
MAPS = Path(__file__).parents[2] / "studies" / "channels"
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"the measured drives are no part of the project; put them into {MEASURED}"
)


def drive(time, x=0.0, y=0.0):
    """Motion of a point (x, y) of a car whose CoG weaves at a changing speed; every derivative in closed form."""
    psi = 0.6 * np.sin(0.9 * time) + 3.0 + 0.2 * time
    r = 0.54 * np.cos(0.9 * time) + 0.2
    r_dot = -0.486 * np.sin(0.9 * time)
    v_x, v_x_dot = 12 + 3 * np.sin(0.4 * time), 1.2 * np.cos(0.4 * time)
    v_y, v_y_dot = 0.4 * np.sin(1.3 * time), 0.52 * np.cos(1.3 * time)
    fine = np.arange(0, time[-1] + 1e-3, 1e-3)
    p = 0.6 * np.sin(0.9 * fine) + 3.0 + 0.2 * fine
    east = (12 + 3 * np.sin(0.4 * fine)) * np.cos(p) - 0.4 * np.sin(1.3 * fine) * np.sin(p)
    north = (12 + 3 * np.sin(0.4 * fine)) * np.sin(p) + 0.4 * np.sin(1.3 * fine) * np.cos(p)
    position = [
        np.interp(time, fine, np.concatenate([[0], np.cumsum((v[1:] + v[:-1]) / 2) * 1e-3])) for v in (east, north)
    ]
    return {
        "time": time,
        "position_x": position[0] + x * np.cos(psi) - y * np.sin(psi),
        "position_y": position[1] + x * np.sin(psi) + y * np.cos(psi),
        "heading": psi,
        "yaw_rate": r,
        "yaw_acceleration": r_dot,
        "longitudinal_velocity": v_x - r * y,
        "lateral_velocity": v_y + r * x,
        "longitudinal_acceleration": v_x_dot - v_y * r - r**2 * x - r_dot * y,
        "lateral_acceleration": v_y_dot + v_x * r - r**2 * y + r_dot * x,
        "road_wheel_angle": 0.2 * r,
    }


def stored(folder, columns, **lines):
    """Write a CSV file and a channel map; the map's lines by signal, everything else in SI under its own name."""
    path, text = folder / "drive.csv", lines.pop("tail", "")
    pd.DataFrame(columns).to_csv(path, index=False)
    (folder / "map.toml").write_text("\n".join(f"{k} = {v}" for k, v in lines.items()) + "\n" + text)
    return path, folder / "map.toml"


CLOCK = '{ channel = "time", unit = "s" }'
TIME = np.arange(0, 40, STEP)


def test_columns_named_as_signals_need_no_map(tmp_path):
    columns = drive(TIME)
    path, _ = stored(tmp_path, {**columns, "note": 1.0, "measured_yaw_rate": columns["yaw_rate"] + 0.01})
    recording = load_recording(path)
    assert set(recording.data_vars) == {*columns, "measured_yaw_rate"} - {"time"}
    assert recording["yaw_rate"].attrs["units"] == "rad/s"
    np.testing.assert_allclose(recording["lateral_velocity"], columns["lateral_velocity"], atol=1e-9)
    assert recording.attrs["warnings"] == []
    np.testing.assert_allclose(measurements(recording, ["yaw_rate"])[:, 0], columns["yaw_rate"] + 0.01, atol=1e-9)
    assert inputs(recording, ["yaw_rate", "heading"]).shape == (len(TIME), 2)
    with pytest.raises(UserError, match="lacks 'yaw_rat'; closest: yaw_rate"):
        inputs(recording, ["yaw_rat"])


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
        ({"yaw_rate": '{ channel = "yaw_rate" }'}, "", r"yaw_rate.unit: this key is required"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "m/s" }'}, "", r"yaw_rate.unit: .* does not fit"),
        ({"yaw_rte": '{ channel = "a", unit = "1/s" }'}, "", r"yaw_rte: is no signal .*closest: yaw_rate"),
        ({"yaw_rate": '{ channel = "a", unit = "rad/s" }'}, "", r"has no channel 'a'"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", sgn = -1 }'}, "", r"yaw_rate.sgn: unknown key .*sign"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", sign = 2 }'}, "", r"yaw_rate.sign"),
        ({"yaw_rate": '{ channel = "yaw_rate", unit = "rad/s", factor = 0 }'}, "", r"factor: 0.0 leaves nothing"),
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
        check_clock(np.repeat(TIME, 2), "a.csv: 't'")
    with pytest.raises(UserError, match="no two stamps increase"):
        check_clock(np.zeros(9), "a.csv: 't'")


def test_clock_that_jumps_far_ahead_is_refused(tmp_path):
    time = np.where(TIME > 20, TIME + 1e9, TIME)
    path, _ = stored(tmp_path, {"time": time, "yaw_rate": np.sin(TIME)})
    with pytest.raises(UserError, match=r"the clock jumps from 20 to 1e\+09 s at row 2001"):
        load_recording(path)


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
    assert "1 gaps" in warning
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
    assert "2 single samples jump out and back (t = 7.00, 30.00 s); kept" in kept.attrs["warnings"][0]
    assert kept["yaw_rate"].values[700] == pytest.approx(values[700])
    channels.write_text(channels.read_text().replace('"rad/s"', '"rad/s", remove_spikes = true'))
    removed = load_recording(path, channels)["yaw_rate"].values
    assert abs(removed[700] - truth["yaw_rate"][700]) < 0.02


def test_first_order_lag_is_the_exact_step_response():
    command = np.where(TIME >= 1, 1.0, 0.0)
    found = first_order_lag(command, STEP, 0.129)
    after = TIME >= 1
    np.testing.assert_allclose(found[after], 1 - np.exp(-(TIME[after] - 1) / 0.129), atol=1e-9)


@pytest.mark.parametrize(("derivative", "exact"), [(0, "heading"), (1, "yaw_rate"), (2, "yaw_acceleration")])
def test_local_polynomial_differentiates(derivative, exact):
    truth = drive(TIME)
    found = local_polynomial(truth["heading"], STEP, 0.1, derivative)
    inside = np.isfinite(found)
    assert inside.sum() == len(TIME) - 10
    np.testing.assert_allclose(found[inside], truth[exact][inside], atol=2e-3)


@pytest.mark.parametrize(("x", "y"), [(1.4, 0.0), (0.0, -0.7), (-2.1, 0.6)])
def test_moving_to_another_point_is_rigid_body_kinematics(x, y):
    """Velocity and acceleration of the point are the derivatives of its position, which is moved by geometry alone."""
    cog = drive(TIME)
    there = drive(TIME, x, y)
    r, r_dot = cog["yaw_rate"], cog["yaw_acceleration"]
    east, north = kinematics.move_position(cog["position_x"], cog["position_y"], cog["heading"], x, y)
    rates = [local_polynomial(p, STEP, 0.05, 1) for p in (east, north)]
    seconds = [local_polynomial(p, STEP, 0.2, 2) for p in (east, north)]
    velocity = kinematics.move_velocity(cog["longitudinal_velocity"], cog["lateral_velocity"], r, x, y)
    moved = kinematics.move_acceleration(cog["longitudinal_acceleration"], cog["lateral_acceleration"], r, r_dot, x, y)
    inside = slice(20, -20)
    for found, by_geometry in zip(velocity, kinematics.earth_to_vehicle(*rates, cog["heading"]), strict=True):
        np.testing.assert_allclose(found[inside], by_geometry[inside], atol=2e-4)
    for found, by_geometry in zip(moved, kinematics.earth_to_vehicle(*seconds, cog["heading"]), strict=True):
        np.testing.assert_allclose(found[inside], by_geometry[inside], atol=2e-2)
    np.testing.assert_allclose(moved[1], there["lateral_acceleration"], atol=1e-12)


def test_sensors_are_moved_and_turned_to_the_reference_point(tmp_path):
    x, y, yaw = 1.2, -0.4, 0.1
    cog, there = drive(TIME), drive(TIME, x, y)
    sensed = dict(there)
    for kind in ("velocity", "acceleration"):
        names = f"longitudinal_{kind}", f"lateral_{kind}"
        for name, values in zip(names, kinematics.to_vehicle_axes(*(there[n] for n in names), -yaw), strict=True):
            sensed[name] = values
    units = {"velocity": "m/s", "acceleration": "m/s^2"}
    path, channels = stored(
        tmp_path,
        sensed,
        time=CLOCK,
        yaw_rate='{ channel = "yaw_rate", unit = "rad/s" }',
        heading='{ channel = "heading", unit = "rad" }',
        position_x='{ channel = "position_x", unit = "m", point = "imu" }',
        position_y='{ channel = "position_y", unit = "m", point = "imu" }',
        **{
            f"{side}_{kind}": f'{{ channel = "{side}_{kind}", unit = "{unit}", point = "imu" }}'
            for side in ("longitudinal", "lateral")
            for kind, unit in units.items()
        },
        tail=f'[points.imu]\nx = {x}\ny = "{y * 100} cm"\nyaw = {yaw}',
    )
    found = load_recording(path, channels)
    rows = np.rint((found["time"].values + found.attrs["start"]) / STEP).astype(int)
    for name, tolerance in (("position_x", 1e-8), ("lateral_velocity", 1e-9), ("longitudinal_acceleration", 1e-3)):
        np.testing.assert_allclose(found[name], cog[name][rows], atol=tolerance)
    np.testing.assert_allclose(found["lateral_acceleration"], cog["lateral_acceleration"][rows], atol=1e-3)


def test_unknown_lever_arm_moves_nothing_and_is_said(tmp_path):
    truth = drive(TIME)
    path, channels = stored(
        tmp_path,
        truth,
        time=CLOCK,
        lateral_velocity='{ channel = "lateral_velocity", unit = "m/s", point = "gnss" }',
        tail='[points.gnss]\ndescription = "antenna"',
    )
    found = load_recording(path, channels)
    np.testing.assert_allclose(found["lateral_velocity"], truth["lateral_velocity"], atol=1e-9)
    assert "measured at 'gnss', whose lever arm is unknown" in found.attrs["warnings"][0]


def test_velocities_follow_from_positions(tmp_path):
    truth = drive(TIME)
    derived = ["longitudinal_velocity", "lateral_velocity", "yaw_rate", "yaw_acceleration", "lateral_acceleration"]
    path, channels = stored(
        tmp_path,
        truth,
        time=CLOCK,
        position_x='{ channel = "position_x", unit = "m" }',
        position_y='{ channel = "position_y", unit = "m" }',
        heading='{ channel = "heading", unit = "rad" }',
        tail=f'[derive]\nwindow = "0.2 s"\nsignals = {derived}',
    )
    found = load_recording(path, channels)
    rows = np.rint((found["time"].values + found.attrs["start"]) / STEP).astype(int)
    for name, tolerance in zip(derived, (1e-3, 1e-3, 1e-4, 2e-3, 2e-2), strict=True):
        np.testing.assert_allclose(found[name], truth[name][rows], atol=tolerance)
        assert found[name].attrs["derived"] == 1


def late(values, delay):
    return np.interp(TIME - delay, TIME, values)


def noisy(**changes):
    """Recorded signals of the drive with sensor noise, some of them changed."""
    rng = np.random.default_rng(3)
    sigma = {"yaw_rate": 2e-3, "lateral_acceleration": 0.05, "longitudinal_acceleration": 0.05, "heading": 1e-4}
    signals = {k: v + rng.normal(0, sigma.get(k, 1e-3), len(v)) for k, v in drive(TIME).items() if k != "time"}
    return {**signals, **{k: change(signals[k]) for k, change in changes.items()}}


def findings(signals):
    return [finding for fit in check(signals, STEP) for finding in fit.findings]


def test_consistent_signals_raise_no_finding():
    fits = check(noisy(), STEP)
    assert [f for fit in fits for f in fit.findings] == []
    exact = {fit.relation.signal: fit for fit in fits if fit.relation.exact}
    assert {"yaw_rate", "lateral_acceleration", "longitudinal_velocity", "lateral_velocity"} <= set(exact)
    for name in ("yaw_rate", "lateral_acceleration", "longitudinal_velocity"):
        assert exact[name].slope == pytest.approx(1, abs=0.01)
        assert abs(exact[name].delay) < 2e-3


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"yaw_rate": lambda v: -v}, "yaw_rate against the rate of the heading: wrong sign"),
        ({"yaw_rate": np.degrees}, "wrong unit, probably degrees where the map says radians"),
        ({"longitudinal_velocity": lambda v: 3.6 * v}, "wrong unit, probably km/h where the map says m/s"),
        ({"lateral_acceleration": lambda v: v / 9.80665}, "wrong unit, probably g where the map says m/s²"),
        ({"lateral_acceleration": lambda v: 1.15 * v}, "wrong scale"),
        ({"lateral_acceleration": lambda v: v + 0.8}, "offset of 0.799"),
        ({"road_wheel_angle": lambda v: -v}, "wrong sign .*road_wheel_angle"),
        ({"yaw_rate": lambda v: late(v, 0.12)}, r"yaw_rate against the rate of the heading: 120 ± \d"),
    ],
)
def test_wrong_signs_units_scales_offsets_and_delays_are_found(changes, expected):
    found = findings(noisy(**changes))
    assert any(re.search(expected, f) for f in found), found


def test_lever_arm_between_sensors_is_estimated():
    signals = noisy()
    signals["lateral_acceleration"] = signals["lateral_acceleration"] + 0.9 * drive(TIME)["yaw_acceleration"]
    fit = next(f for f in check(signals, STEP) if f.relation.signal == "lateral_acceleration" and f.relation.exact)
    assert fit.arm == pytest.approx(0.9, abs=max(0.05, 3 * fit.arm_std))


def test_delay_is_estimated_and_taken_out(tmp_path):
    signals = {"time": TIME, **noisy(yaw_rate=lambda v: late(v, 0.063))}
    path, channels = stored(
        tmp_path,
        signals,
        time=CLOCK,
        heading='{ channel = "heading", unit = "rad" }',
        yaw_rate='{ channel = "yaw_rate", unit = "rad/s", delay = "estimate" }',
    )
    found = load_recording(path, channels)
    about = found["yaw_rate"].attrs
    assert about["delay"] == pytest.approx(0.063, abs=max(4 * about["delay_std"], 1e-3))
    assert 0 < about["delay_std"] < 2e-3
    rows = np.rint((found["time"].values + found.attrs["start"]) / STEP).astype(int)
    left = found["yaw_rate"].values - drive(TIME)["yaw_rate"][rows]
    assert left.std() < 4e-3


def test_semitrailer_relations_hold():
    r1 = 0.3 * np.sin(0.5 * TIME)
    r2 = 0.3 * np.sin(0.5 * TIME - 0.4)
    angle = np.concatenate([[0], np.cumsum((r2 - r1)[1:] + (r2 - r1)[:-1]) * STEP / 2])
    angle += np.random.default_rng(6).normal(0, 1e-4, len(TIME))
    signals = {"yaw_rate_tractor": r1, "yaw_rate_trailer": r2, "articulation_angle": angle, "speed": 15 + 0 * TIME}
    assert findings(signals) == []
    assert any("wrong sign" in f for f in findings({**signals, "articulation_angle": -angle}))


CAR = axles.Car(1500.0, 2500.0, 1.1, 1.6, 0.5)


def test_axle_forces_balance_the_motion():
    rng = np.random.default_rng(4)
    a_y, r_dot, a_x = rng.normal(size=(3, 50))
    front, rear = axles.axle_forces(CAR, a_y, r_dot)
    np.testing.assert_allclose(front + rear, CAR.mass * a_y, rtol=1e-12)
    np.testing.assert_allclose(
        CAR.cog_to_front_axle * front - CAR.cog_to_rear_axle * rear, CAR.yaw_inertia * r_dot, atol=1e-9
    )
    loads = axles.axle_loads(CAR, a_x)
    np.testing.assert_allclose(sum(loads), CAR.mass * axles.GRAVITY, rtol=1e-12)
    assert axles.axle_loads(CAR, 1.0)[0] < axles.axle_loads(CAR, 0.0)[0]  # accelerating unloads the front axle


def test_slope_is_the_stiffness_of_a_linear_tyre():
    """A steady circle of the textbook's bicycle model, driven slowly to the left and to the right."""
    stiff_front, stiff_rear = 9.5, 12.0
    v = 15.0 + 0 * TIME
    a_y = 2.5 * np.sin(0.2 * TIME)
    r = a_y / v
    load_front, load_rear = axles.axle_loads(CAR, 0.0)
    force_front, force_rear = axles.axle_forces(CAR, a_y, 0.0)
    v_y = CAR.cog_to_rear_axle * r - v * np.tan(force_rear / (stiff_rear * load_rear))
    measured = force_front / (stiff_front * load_front) + np.arctan2(v_y + CAR.cog_to_front_axle * r, v)
    signals = {
        "lateral_acceleration": a_y,
        "yaw_acceleration": 0 * TIME,
        "road_wheel_angle": measured,
        "longitudinal_velocity": v,
        "lateral_velocity": v_y,
        "yaw_rate": r,
    }
    curves = axles.axle_curves(CAR, signals)
    front = axles.cornering_slope(curves.slip_front, curves.force_front, curves.load_front)
    rear = axles.cornering_slope(curves.slip_rear, curves.force_rear, curves.load_rear)
    assert front.value == pytest.approx(stiff_front, rel=1e-9)
    assert rear.value == pytest.approx(stiff_rear, rel=1e-9)
    assert front.offset == pytest.approx(0, abs=1e-12)
    rng = np.random.default_rng(5)
    assert axles.cornering_slope(rng.normal(size=500), rng.normal(size=500), np.full(500, 9.0)) is None


def test_check_prints_and_writes_what_it_found(tmp_path):
    signals = noisy(yaw_rate=lambda v: -v)
    signals["lateral_velocity"][1000:1500] = np.nan
    for name in ("position_x", "position_y", "yaw_acceleration", "longitudinal_acceleration"):
        del signals[name]
    path, _ = stored(tmp_path, {"time": TIME, **signals})
    out = tmp_path / "report"
    arguments = ["check", str(path), "--out", str(out), "--parameters", "lex_2015"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "wrong sign" in done.output
    assert "1 gaps" in done.output
    assert "front axle" in done.output
    page = (out / "check.html").read_text()
    assert page.count("data:image/svg") >= 3  # agreement, axles, signals
    assert "wrong sign" in page
    assert (out / "check.pdf").read_bytes().startswith(b"%PDF")
    refused = CliRunner().invoke(app, ["check", str(path), "--out", str(out), "--parameters", "ziaukas_2023"])
    assert refused.exit_code == 2
    assert "axle curves need the set of a car" in refused.output


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
