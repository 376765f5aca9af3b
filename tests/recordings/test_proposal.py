"""A channel map proposed from names, units and values: it says why, and reads the recording back."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import UserError
from harness.common.unit_spellings import unit_of
from harness.recordings.proposal.column_names import read_name
from harness.recordings.proposal.propose import propose
from harness.recordings.read.load import load_recording
from support.further_header_tables import FURTHER
from support.header_tables import DEVELOPED, FRESH, HELD_OUT
from support.headers import judged

TIME = np.arange(0, 60, 0.02)
RATE = 0.3 * np.sin(0.5 * TIME)
SPEED = 15 + 2 * np.sin(0.1 * TIME)
STEER = 16 * 2.7 * RATE / SPEED


@pytest.fixture
def recording(tmp_path):
    """Write columns as CSV and return the file."""

    def write(**columns):
        path = tmp_path / "lap.csv"
        header = ",".join(name.replace("__", " ") for name in columns)
        np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header, comments="")
        return path

    return write


def noisy(values, size, seed=1):
    return values + size * np.random.default_rng(seed).normal(size=len(values))


def guessed(path):
    return {g.signal: (g.column, g.unit, g.sign) for g in propose(path).guesses}


@pytest.mark.parametrize(
    ("names", "speed", "rate", "acceleration"),
    [
        (("VehicleSpeed", "YawRate", "AccY"), "km/h", "deg/s", "m/s^2"),
        (("v_x", "gyro_z", "ay"), "m/s", "rad/s", "g_0"),
        (("Geschwindigkeit", "Gierrate", "Querbeschleunigung"), "m/s", "deg/s", "m/s^2"),
        (("EBS11.Speed", "IMU/yaw_rate", "lat_acc"), "km/h", "rad/s", "g_0"),
    ],
)
def test_units_that_are_not_stated_follow_from_each_other(recording, names, speed, rate, acceleration):
    scale = {"m/s": 1.0, "km/h": 3.6, "rad/s": 1.0, "deg/s": 180 / np.pi, "m/s^2": 1.0, "g_0": 1 / 9.80665}
    columns = (SPEED * scale[speed], RATE * scale[rate], noisy(SPEED * RATE, 0.1) * scale[acceleration])
    path = recording(t=TIME, **dict(zip(names, columns, strict=True)))
    found = guessed(path)
    assert found["speed"] == (names[0], speed, 1)
    assert found["yaw_rate"] == (names[1], rate, 1)
    assert found["lateral_acceleration"] == (names[2], acceleration, 1)


def test_a_column_in_km_h_is_the_speed_whatever_its_name(recording):
    columns = {"t": TIME, "v_vorn_kmh": 3.6 * SPEED, "Gierrate_grad/s": np.degrees(RATE), "Lenkradwinkel_grad": -STEER}
    found = guessed(recording(**columns, Temp=np.full_like(TIME, 20.0)))
    assert found["speed"] == ("v_vorn_kmh", "km/h", 1)
    assert found["steering_wheel_angle"] == ("Lenkradwinkel_grad", "deg", -1)  # no acceleration is needed to see that
    assert "speed" not in guessed(recording(**columns, v_hinten_kmh=3.6 * SPEED))  # which of the two?


def test_columns_whose_names_say_nothing_are_told_by_unit_and_motion(recording):
    columns = {"t": TIME, "K1_deg": -np.degrees(STEER), "K2_km/h": 3.6 * SPEED, "K3_m/s": 0.3 * np.sin(TIME)}
    columns |= {"K4_deg": 5 * np.cos(3 * TIME), "gyro_z": RATE, "ay": noisy(SPEED * RATE, 0.1)}
    found = guessed(recording(**columns))
    assert found["speed"] == ("K2_km/h", "km/h", 1)  # K3 is a velocity as well, and moves otherwise
    assert found["steering_wheel_angle"] == ("K1_deg", "deg", -1)
    assert "speed" not in guessed(recording(**columns, K5_kmh=3.7 * SPEED))  # which of the two?


def test_german_names_and_a_velocity_across(recording):
    columns = {"Zeit": TIME, "LRW_deg": STEER, "V_Fzg_kmh": 3.6 * SPEED, "Gierrate": RATE, "Quergeschw": 0.1 * RATE}
    found = guessed(recording(**columns))
    assert found["steering_wheel_angle"][0] == "LRW_deg"
    assert found["speed"][0] == "V_Fzg_kmh"
    assert found["lateral_velocity"][0] == "Quergeschw"


@pytest.mark.parametrize("turned", ["yaw_rate", "lateral_acceleration", "steering_wheel_angle"])
def test_the_one_that_counts_the_other_way_is_reversed(recording, turned):
    signals = {"steering_wheel_angle": STEER, "yaw_rate": RATE, "lateral_acceleration": noisy(SPEED * RATE, 0.1)}
    signals[turned] = -signals[turned]
    found = propose(recording(time=TIME, speed=SPEED, **signals))
    assert {g.signal for g in found.guesses if g.sign < 0} == {turned}
    assert any(f"{turned} is reversed" in note for note in found.notes)


@pytest.mark.parametrize(
    ("factor", "unit", "name"), [(1, "s", "t"), (1e3, "ms", "Timestamp"), (1e9, "ns", "time"), (1e3, "ms", "time_ms")]
)
def test_the_clock_and_its_unit(recording, factor, unit, name):
    found = propose(recording(**{name: 1e3 + TIME * factor}, yaw_rate=RATE))
    assert [(c.column, c.unit) for c in found.clocks] == [(name, unit)]


def test_stamps_of_one_instant_are_compared_by_rows(recording):
    assert propose(recording(time=1e-320 * np.arange(len(TIME)), yaw_rate=RATE)).guesses


def test_a_stated_unit_counts_and_every_reason_is_given(recording, tmp_path):
    path = recording(**{"t": TIME, "Speed[km/h]": SPEED, "YawRate__[deg/s]": RATE, "Temp": TIME * 0, "Psi (deg)": RATE})
    found = propose(path)
    assert guessed(path)["speed"] == ("Speed[km/h]", "km/h", 1)
    assert guessed(path)["yaw_rate"][1] == "deg/s"
    assert guessed(path)["heading"][1] == "deg"
    assert list(found.left_out) == ["Temp"]
    said = "\n".join(found.lines())
    assert "unit by the name" in said
    assert "ISO 8855" in said
    assert all(g.why for g in found.guesses)


def test_the_proposal_reads_the_recording(recording, tmp_path):
    path = recording(Timestamp=TIME * 1e3, VehicleSpeed=SPEED * 3.6, YawRate=np.degrees(RATE), AccY=-SPEED * RATE)
    map_ = tmp_path / "lap.toml"
    map_.write_text(propose(path).text)
    read = load_recording(path, map_)
    np.testing.assert_allclose(read["yaw_rate"], RATE, atol=1e-6)
    np.testing.assert_allclose(read["speed"], SPEED, atol=1e-6)
    np.testing.assert_allclose(read["lateral_acceleration"], SPEED * RATE, atol=1e-5)


def test_a_signal_twice_is_said(recording):
    found = propose(recording(t=TIME, gyro_z=RATE, **{"yaw_rate_deg/s": np.degrees(RATE)}))
    assert {g.column for g in found.guesses} == {"yaw_rate_deg/s"}
    assert found.left_out == {"gyro_z": "'yaw_rate_deg/s' is yaw_rate: its name says more"}
    assert any("best of 2 columns" in g.why for g in found.guesses)


def test_a_recording_without_turns_or_clock_is_said(recording):
    found = propose(recording(speed=SPEED, yaw_rate=noisy(0 * TIME, 1e-3), ay=noisy(0 * TIME, 0.01, 2)))
    assert any("hardly turns" in note for note in found.notes)
    assert any("no column of time" in note for note in found.notes)


def test_what_does_not_belong_together_is_said(recording):
    found = propose(
        recording(**{"t": TIME, "speed__[m/s]": SPEED, "yaw_rate__[rad/s]": RATE, "ay__[m/s2]": 5 * SPEED * RATE})
    )
    assert any("lateral acceleration over speed times yaw rate is 5: a column is another" in n for n in found.notes)


def test_a_file_without_signals_is_refused(recording):
    with pytest.raises(UserError, match="no column looks like a signal of a vehicle: 'a', 'b'"):
        propose(recording(a=TIME, b=RATE))


def truck(**columns):
    """Return what a logger of a truck with trailer writes, the articulation angle in degrees."""
    behind = 0.3 * np.sin(0.5 * (TIME - 0.6))
    angle = -np.cumsum(RATE - behind) * 0.02
    return {
        "t_s": TIME,
        "EBS_TrailerSpeed_kmh": 3.6 * SPEED,
        "LWS_Angle": np.degrees(STEER),
        "ESC_YawRate": np.degrees(RATE),
        "TEBS_YawRate": np.degrees(behind),
        "ESC_LatAcc": noisy(SPEED * RATE, 0.1),
        "Auflieger.Querbeschleunigung": noisy(SPEED * behind, 0.1, 2),
    } | {name: scale * noisy(angle, 1e-4, 3) for name, scale in columns.items()}


@pytest.mark.parametrize(
    ("column", "unit", "sign"),
    [
        ("ARTIC_Angle", "deg", 1),
        ("Knickwinkel", "deg", -1),
        ("articulation", "rad", -1),
        ("hitch angle [deg]", "deg", 1),
    ],
)
def test_a_truck_with_trailer_has_signals_of_two_bodies(recording, column, unit, sign):
    scale = sign * (180 / np.pi if unit == "deg" else 1.0)
    found = guessed(recording(**truck(**{column.replace(" ", "__"): scale})))
    assert found == {
        "speed": ("EBS_TrailerSpeed_kmh", "km/h", 1),
        "steering_wheel_angle": ("LWS_Angle", "deg", 1),
        "yaw_rate_tractor": ("ESC_YawRate", "deg/s", 1),
        "yaw_rate_trailer": ("TEBS_YawRate", "deg/s", 1),
        "articulation_angle": (column, unit, sign),
        "lateral_acceleration_tractor": ("ESC_LatAcc", "m/s^2", 1),
        "lateral_acceleration_trailer": ("Auflieger.Querbeschleunigung", "m/s^2", 1),
    }


def test_an_angle_that_does_not_turn_as_the_yaw_rates_do_is_left_as_its_values_say(recording):
    found = propose(recording(**(truck() | {"artic": noisy(0 * TIME, 0.05)})))
    angle = next(g for g in found.guesses if g.signal == "articulation_angle")
    assert (angle.unit, angle.sign) == ("rad", 1)
    assert "unit by its values" in angle.why[1]
    alone = guessed(recording(t=TIME, artic=RATE, yaw_rate=RATE))  # of one body the yaw rate is known: the tractor's
    assert set(alone) == {"articulation_angle", "yaw_rate_tractor"}


@pytest.mark.parametrize(("epoch", "clocks"), [(0.0, ["can.time", "imu.time"]), (1.7e9, ["can.time"])])
def test_every_structure_has_its_clock_and_a_time_of_day_is_none(tmp_path, epoch, clocks):
    scipy_io = pytest.importorskip("scipy.io")
    path, late = tmp_path / "a.mat", TIME + 0.007
    scipy_io.savemat(
        path,
        {"can": {"time": TIME, "speed": SPEED}, "imu": {"time": epoch + late, "yaw_rate": 0.3 * np.sin(0.5 * late)}},
    )
    assert [c.column for c in propose(path).clocks] == clocks


@pytest.mark.parametrize(("table", "right"), [(DEVELOPED, 0.95), (HELD_OUT, 0.9), (FRESH, 0.9), (FURTHER, 0.9)])
def test_headers_of_loggers_buses_and_papers_are_read_right_or_left_out_with_a_reason(table, right, tmp_path):
    fared = judged(table, tmp_path, seeds=(1,))
    assert [line for line in fared if "wrong" in line] == []
    assert sum(line.endswith("right") for line in fared) / len(fared) >= right


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        *((w, "km/h") for w in ("km/h", "Km_h", "kph", "KMH", "[km|h]")),
        *((w, "mph") for w in ("MPH", "(mph)", "mi/h")),
        *((w, "knot") for w in ("kts", "knots", "kn")),
        *((w, "g_0") for w in ("G", "Gs", "[g]", "(G)")),
        *((w, "deg/s") for w in ("deg/s", "degps", "deg_s", "°/s", "Deg/Sec", "dps", "deg s-1")),
        *((w, "rad/s") for w in ("rad_s", "rad/sec", "1/s", "radps", "rad s^-1")),
        *((w, "m/s^2") for w in ("m_s2", "mps2", "m/s²", "m/s^2", "m s-2", "m/s/s")),
        ("mrad/s", "mrad/s"),
        ("ft/s", "ft/s"),
        ("1/min", "rpm"),
    ],
)
def test_units_are_read_however_they_are_written(written, unit):
    read = unit_of(written)
    assert read.text in (unit, "mile/h" if unit == "mph" else unit)
    assert unit_of("kN").si == ""


@pytest.mark.parametrize(
    "name",
    ["EEC1.EngineSpeed", "FanSpeed", "WindSpeed", "nMot", "TurbineSpeed", "rotor_speed", "OutputShaftSpeed",
     "whlspd_fl", "Raddrehzahl", "vehicle_speed_limit", "target_speed", "steering_rate",
     "gps_speed_accuracy", "deltaFL", "lat_accel_std"],
)  # fmt: skip
def test_what_is_not_the_motion_of_the_vehicle_is_no_signal(name):
    assert read_name(name).signal == ""


def test_an_engine_that_agrees_with_enough_free_units_is_not_the_vehicle(recording):
    engine = 24 * SPEED * 3.6
    columns = {"t": TIME, "EEC1.EngineSpeed": engine, "CCVS1.WheelBasedVehicleSpeed": 3.6 * SPEED}
    path = recording(**columns, **{"VDC2.YawRate": RATE, "VDC2.LatAcceleration": noisy(SPEED * RATE, 0.1)})
    proposed = propose(path)
    assert guessed(path)["speed"] == ("CCVS1.WheelBasedVehicleSpeed", "km/h", 1)
    assert "an engine" in proposed.left_out["EEC1.EngineSpeed"]
    assert "3 units and no signs chosen for 1 agreement, which confirms nothing" in proposed.text
    stated = {"v [km/h]": 3.6 * SPEED, "r [rad/s]": RATE, "ay [g]": noisy(SPEED * RATE, 0.1) / 9.81}
    text = propose(recording(t=TIME, **{name.replace(" ", "__"): values for name, values in stated.items()})).text
    assert "no units and no signs chosen for 1 agreement" in text
    assert "confirms nothing" not in text


def test_values_that_no_vehicle_reaches_exclude_a_column(recording):
    proposed = propose(recording(t=TIME, **{"Speed__(km/h)": 2600 + 0 * TIME}, yaw_rate=RATE))
    assert "speed" not in {g.signal for g in proposed.guesses}
    assert "2600 km/h are those of no vehicle" in proposed.left_out["Speed (km/h)"]


def test_of_several_columns_that_wins_which_moves_as_the_others(recording):
    slow = np.full_like(TIME, 15.0) + noisy(0 * TIME, 3.0, 5)
    columns = {"speed_a": slow, "speed_b": SPEED + 0 * TIME, "gyro_z": RATE, "ax": np.gradient(SPEED, TIME)}
    proposed = propose(recording(t=TIME, **columns, ay=noisy((SPEED * RATE), 0.1)))
    assert {g.signal: g.column for g in proposed.guesses}["speed"] == "speed_b"
    assert "agrees better with the others' motion" in proposed.left_out["speed_a"]


def test_a_telephone_that_lies_across_has_its_axes_by_the_motion(recording):
    columns = {"Accel X": noisy(SPEED * RATE, 0.1), "Accel Y": noisy(np.gradient(SPEED, TIME), 0.02, 3)}
    columns = {"speed (m/s)": SPEED, "gyro_z (rad/s)": RATE} | columns
    found = guessed(recording(t=TIME, **{name.replace(" ", "__"): values for name, values in columns.items()}))
    assert (found["lateral_acceleration"][0], found["longitudinal_acceleration"][0]) == ("Accel X", "Accel Y")


def test_velocities_in_fixed_axes_are_not_the_vehicles(recording):
    heading = np.cumsum(RATE) * 0.02 + 0.7
    velocities = {"pos.vx": SPEED * np.cos(heading), "pos.vy": SPEED * np.sin(heading)}
    proposed = propose(recording(t=TIME, yaw_rate=RATE, **velocities))
    assert {g.signal for g in proposed.guesses} == {"yaw_rate"}
    assert "not the vehicle's" in proposed.left_out["pos.vx"]


def test_positions_tell_which_of_two_counts_the_other_way(recording):
    heading = np.cumsum(RATE) * 0.02
    x, y = (np.cumsum(SPEED * f(heading)) * 0.02 for f in (np.cos, np.sin))
    columns = {"x": x, "y": y, "speed": SPEED, "yaw_rate": -RATE, "lateral_acceleration": noisy(SPEED * RATE, 0.1)}
    proposed = propose(recording(t=TIME, **columns))
    assert [g.signal for g in proposed.guesses if g.sign < 0] == ["yaw_rate"]
    assert any("sign against the course over ground" in why for g in proposed.guesses for why in g.why)


def test_an_angle_of_road_wheels_is_told_from_one_of_a_steering_wheel(recording):
    columns = {"speed": SPEED, "yaw_rate": RATE, "ay": noisy(SPEED * RATE, 0.1)}
    assert "road_wheel_angle" in guessed(recording(t=TIME, **columns, steer_ang=STEER / 16))
    assert "steering_wheel_angle" in guessed(recording(t=TIME, **columns, steer_ang=STEER))


def test_one_hertz_and_a_part_of_a_file(recording):
    path = recording(t=np.arange(400.0), speed=np.repeat([15.0, 25.0], 200) + np.tile([0.0, 1.0], 200))
    assert [c.unit for c in propose(path).clocks] == ["s"]
    part = propose(f"{path}@0s:100s")
    assert max(g.values.max() for g in part.guesses) == 16.0
    with pytest.raises(UserError, match="there is nothing in that span"):
        propose(f"{path}@500s:")


@pytest.mark.parametrize("name", ["genesis_g80/path1_6_20.mat", "revs_250lm"])
def test_measured_cars_are_read_with_road_wheel_angles_and_accelerations(name):
    path = Path(__file__).parents[3] / "shared" / "measured" / name
    if not path.exists():
        pytest.skip(f"the recording {name} is not part of the project")
    units = {signal: unit for signal, (_, unit, _) in guessed(path).items()}
    assert units.items() >= {
        "speed": "m/s", "yaw_rate": "rad/s", "road_wheel_angle": "rad", "lateral_velocity": "m/s",
        "lateral_acceleration": "m/s^2", "longitudinal_acceleration": "m/s^2",
    }.items()  # fmt: skip


def test_columns_of_several_clocks_are_compared(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    slow = TIME[::5]
    product = np.interp(slow, TIME, noisy(SPEED * RATE, 0.1))
    bus, unit = (
        {"time": slow, "VehSpd": 3.6 * SPEED[::5], "LatAcc": product},
        {"time": TIME, "YawRate": np.degrees(RATE)},
    )
    scipy_io.savemat(tmp_path / "a.mat", {"can": bus, "imu": unit})
    found = guessed(tmp_path / "a.mat")
    assert (found["speed"][1], found["yaw_rate"][1], found["lateral_acceleration"][1]) == ("km/h", "deg/s", "m/s^2")
    assert "lateral acceleration over speed times yaw rate: 1.0" in propose(tmp_path / "a.mat").text


@pytest.mark.parametrize("stem", ["linear.", "twist.linear.", "linear_"])
def test_the_linear_part_of_a_twist_is_a_velocity(recording, stem):
    seconds = np.floor(TIME) + 1.7e9
    turning = stem.replace("linear", "angular")
    columns = {"header.stamp.sec": seconds, "header.stamp.nsec": np.round(TIME % 1 * 1e9), f"{stem}x": SPEED}
    found = guessed(recording(**columns, **{f"{stem}y": 0.02 * np.sin(TIME), f"{turning}z": RATE}))
    assert found["speed"] == (f"{stem}x", "m/s", 1)
    assert found["lateral_velocity"] == (f"{stem}y", "m/s", 1)
    assert found["yaw_rate"] == (f"{turning}z", "rad/s", 1)
    assert "position_x" not in found


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_yaw_rate_of_the_quicker_unit_is_taken(tmp_path, noise):
    scipy_io = pytest.importorskip("scipy.io")
    slow = TIME[::5]
    odometry = {"time": slow, "yaw_rate": RATE[::5], "speed": SPEED[::5], "heading": np.cumsum(RATE)[::5] * 0.02}
    unit = {"time": TIME, "yaw_rate": noisy(RATE, noise), "ay": noisy(SPEED * RATE, 0.1)}
    scipy_io.savemat(tmp_path / "a.mat", {"odometry": odometry, "unit": unit})
    assert guessed(tmp_path / "a.mat")["yaw_rate"][0] == "unit.yaw_rate"
    assert "it has more samples" in propose(tmp_path / "a.mat").left_out["odometry.yaw_rate"]


@pytest.mark.parametrize(
    ("column", "places", "clockwise", "convention"),
    [
        ("Heading", True, True, "compass"),
        ("Heading", True, False, ""),
        ("GPS Course", False, True, "compass"),
        ("Heading", False, True, ""),
    ],
)
def test_a_compass_is_told_by_the_course_or_by_its_name(tmp_path, column, places, clockwise, convention):
    time = np.arange(0, 40, 0.05)
    speed, rate = 15 + np.sin(0.2 * time), 0.15 * np.sin(0.4 * time)
    heading = 0.3 + np.cumsum(rate) * 0.05
    east, north = (np.cumsum(speed * f(heading)) * 0.05 for f in (np.cos, np.sin))
    degrees = np.degrees(np.pi / 2 - heading if clockwise else heading) % 360
    table = {"time": time, "speed (m/s)": speed, "yaw rate (rad/s)": rate, f"{column} (deg)": degrees}
    if places:
        table |= {"East (m)": east, "North (m)": north}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    found = propose(tmp_path / "a.csv")
    (entry,) = (g for g in found.guesses if g.signal == "heading")
    assert entry.compass is (convention == "compass")
    (tmp_path / "map.toml").write_text(found.text)
    read = load_recording(tmp_path / "a.csv", tmp_path / "map.toml")["heading"]
    if convention or not clockwise:
        np.testing.assert_allclose(np.exp(1j * read), np.exp(1j * heading), atol=1e-3)
