import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

import harness.models.drives.sine
import harness.models.vehicles.semitrailer
from harness.common.errors import ModelError, UserError
from harness.models.contracts import DriveContext, Profile
from harness.models.drives._shapes import lateral_acceleration
from harness.simulation.drives import build_drive

ROOT = Path(__file__).resolve().parents[2]
GENESIS = ROOT.parent / "shared" / "measured" / "genesis_g80"
CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)


# --- options ---


def test_text_with_units_equals_numbers_in_si():
    text = {"amplitude": "30 deg", "frequency": "0.25 Hz", "speed": "36 km/h", "duration": "1 min"}
    si = {"amplitude": np.pi / 6, "frequency": 0.25, "speed": 10.0, "duration": 60}
    a, b = build_drive("sine", text, CONTEXT), build_drive("sine", si, CONTEXT)
    np.testing.assert_allclose(a.steering_wheel_angle, b.steering_wheel_angle, rtol=1e-12)
    np.testing.assert_allclose(a.speed, b.speed, rtol=1e-12)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("sinus", {}, "unknown drive 'sinus'; closest: sine"),
        ("sine", {"amplitud": 1}, "unknown option 'amplitud'; closest: amplitude"),
        (
            "sine",
            {"amplitude": "30 km/h"},
            "amplitude: '30 km/h' does not fit; a quantity in rad is expected",
        ),
        ("sine", {"amplitude": "30"}, "amplitude: '30' has no unit"),
        ("sine", {"frequency": "90 Hz"}, "frequency: '90 Hz' lies outside 0.005 to 5 Hz"),
        ("sine", {"speed": -3}, "speed: -3 lies outside"),
        ("sine", {"speed": [3]}, "speed: expected a number in m/s"),
        ("steady_circle", {"direction": 1}, "direction: expected text, got 1"),
        ("from_file", {}, "option 'file' is missing"),
    ],
)
def test_bad_options_name_the_place_and_the_remedy(kind, options, message):
    with pytest.raises(UserError) as error:
        build_drive(kind, options, CONTEXT, "study.toml, drive 'x'")
    assert str(error.value).startswith("study.toml, drive 'x'")
    assert message in str(error.value)


@pytest.mark.parametrize("field", ["wheelbase", "steering_ratio", "step"])
def test_impossible_context_is_refused(field):
    with pytest.raises(UserError, match="must be positive"):
        build_drive("sine", {}, dataclasses.replace(CONTEXT, **{field: 0.0}))


def test_the_limit_holds_for_a_kind_that_does_not_declare_it(monkeypatch):
    monkeypatch.setattr(harness.models.drives.sine, "OPTIONS", harness.models.drives.sine.OPTIONS[:3])
    monkeypatch.setattr(harness.models.drives.sine, "generate", _profile_of(steering=0.9, speed=22.0))
    with pytest.raises(ModelError, match="drive 'sine': asks for 5"):
        build_drive("sine", {}, CONTEXT)
    assert build_drive("sine", {"lateral_acceleration_limit": 6}, CONTEXT).speed[0] == 22.0


def test_the_remedies_of_the_limit_are_right(monkeypatch):
    monkeypatch.setattr(harness.models.drives.sine, "generate", _profile_of(steering=0.9, speed=22.0))
    with pytest.raises(ModelError) as error:
        build_drive("sine", {}, CONTEXT)
    speed, wheel = map(float, re.search(r"to (\S+) m/s or .* to (\S+) deg", str(error.value)).groups())
    for s, v in ((0.9, speed), (np.radians(wheel), 22.0)):
        profile = _profile_of(steering=s, speed=v)({}, CONTEXT)
        assert np.abs(lateral_acceleration(profile, CONTEXT)).max() == pytest.approx(3.0, rel=3e-3)


def _profile_of(steering: float, speed: float):
    time = np.arange(500) * 0.01
    wheel = steering * np.clip((time - 1) / 2, 0, 1)
    return lambda options, context: Profile(time, wheel, np.full(500, speed))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": np.ones(499)}, "vectors of one length"),
        ({"steering_wheel_angle": np.full(500, np.nan)}, "steering_wheel_angle is not finite at sample 0"),
        ({"time": np.arange(500) * 0.02}, "time is 0.02.* at sample 1, not 0.01"),
        ({"time": np.arange(500) * 0.01 + 1}, "at sample 0, not 0.0"),
        ({"speed": np.zeros(500)}, "must stay positive"),
    ],
)
def test_a_profile_that_breaks_the_contract_is_refused(monkeypatch, change, message):
    def generate(options, context):
        return dataclasses.replace(_profile_of(0.1, 5.0)(options, context), **change)

    monkeypatch.setattr(harness.models.drives.sine, "generate", generate)
    with pytest.raises(ModelError, match=message):
        build_drive("sine", {}, CONTEXT)


# --- from_file ---


def recording(time=None, steering=None, speed=None):
    time = np.arange(0, 30, 0.01) if time is None else time
    return {
        "t": time,
        "df": 0.03 * np.sin(0.6 * time) if steering is None else steering,
        "v": 10 + 2 * np.sin(0.2 * time) if speed is None else speed,
    }


def drive_of(columns, step=0.01, **options):
    context = dataclasses.replace(CONTEXT, step=step, base="here", read=lambda path: columns)
    names = {"file": "a.csv", "time": "t", "steering": "df", "speed": "v", "steering_is": "road_wheel"}
    return build_drive("from_file", {**names, **options}, context)


def test_reproduces_a_smooth_recording():
    profile = drive_of(recording(), fade=0)
    t = profile.time
    np.testing.assert_allclose(profile.steering_wheel_angle[100:-100], 23 * 0.03 * np.sin(0.6 * t)[100:-100], atol=2e-4)
    np.testing.assert_allclose(profile.speed[100:-100], (10 + 2 * np.sin(0.2 * t))[100:-100], atol=1e-3)
    assert t[-1] == pytest.approx(29.99)


def test_scales_starts_and_stops():
    plain = drive_of(recording(), fade=0)
    scaled = drive_of(recording(), fade=0, steering_scale="2 rad", speed_scale="3.6 km/h")
    np.testing.assert_allclose(scaled.steering_wheel_angle, 2 * plain.steering_wheel_angle)
    np.testing.assert_allclose(scaled.speed, plain.speed)
    wheel = drive_of(recording(), fade=0, steering_is="steering_wheel")
    np.testing.assert_allclose(23 * wheel.steering_wheel_angle, plain.steering_wheel_angle, atol=1e-12)
    part = drive_of(recording(), fade=0, start="5 s", stop="12 s")
    assert part.time[-1] == pytest.approx(7.0)
    np.testing.assert_allclose(part.speed[100:-100], plain.speed[600:1101], atol=1e-6)


def test_smooths_the_stairs_of_a_republished_channel():
    time = np.arange(0, 30, 0.01)
    held = np.floor(time / 0.1) * 0.1
    profile = drive_of(recording(time, steering=0.03 * np.sin(0.6 * held)), fade=0, cutoff="2 Hz")
    truth = 23 * 0.03 * np.sin(0.6 * (profile.time - 0.045))  # a held value is half an interval old
    np.testing.assert_allclose(profile.steering_wheel_angle[200:-200], truth[200:-200], atol=4e-3)
    stairs = np.abs(np.diff(23 * 0.03 * np.sin(0.6 * held))).max()
    assert np.abs(np.diff(profile.steering_wheel_angle)).max() < 0.25 * stairs


def test_a_longer_step_makes_no_alias():
    time = np.arange(0, 60, 0.01)
    columns = recording(time, steering=0.01 * np.sin(2 * np.pi * 9.5 * time))  # folds to 0.5 Hz at 10 Hz
    profile = drive_of(columns, step=0.1, cutoff="500 Hz", fade=0)
    assert np.abs(profile.steering_wheel_angle[5:-5]).max() < 0.01 * 23 * 0.01


def test_uneven_times_and_rows_written_twice():
    random = np.random.default_rng(0)
    time = np.cumsum(random.uniform(0.004, 0.036, 3000)) + 1.5e9
    twice = np.sort(np.concatenate([time, time[::50]]))
    smooth = recording(twice - twice[0])
    profile = drive_of({**smooth, "t": twice}, fade=0)
    np.testing.assert_allclose(
        profile.steering_wheel_angle[50:-50], 23 * 0.03 * np.sin(0.6 * profile.time)[50:-50], atol=1e-3
    )
    assert profile.notes["republished_rows"] == "60"


def test_slow_ends_are_cut_and_halts_raised():
    time = np.arange(0, 60, 0.01)
    speed = np.interp(time, [0, 5, 10, 25, 30, 35, 50, 55, 60], [0, 0, 10, 10, 0, 10, 10, 0, 0])
    profile = drive_of(recording(time, speed=speed), lowest_speed=2.0)
    assert profile.time[-1] == pytest.approx(54 - 6, abs=0.02)
    assert profile.speed.min() == pytest.approx(2.0, abs=1e-6)
    assert int(profile.notes["raised_to_lowest_speed"]) == pytest.approx(200, abs=2)


def with_value(column, index, value):
    columns = recording()
    columns[column] = columns[column].copy()
    columns[column][index] = value
    return columns


GAP = np.arange(0, 30, 0.01)
GAP = np.delete(GAP, slice(1000, 1020))


@pytest.mark.parametrize(
    ("columns", "options", "message"),
    [
        (recording(), {"steering": "dff"}, "no column 'dff' (option steering); closest: df"),
        (with_value("df", 777, np.nan), {}, "column 'df', sample 777: nan (1 in all)"),
        (with_value("v", 9, np.inf), {}, "column 'v', sample 9: inf"),
        (with_value("t", 12, np.nan), {}, "column 't', sample 12: nan; every sample needs a time"),
        (with_value("t", 500, 4.0), {}, "column 't', sample 500: time goes from 4.990000 to 4.000000"),
        (with_value("t", 500, 4.99), {"start": 2}, "column 't', sample 500: time goes from"),
        (recording(GAP), {}, "column 't', sample 1000: a gap of 0.2100 s, 9.99 s after the first sample"),
        (recording(speed=np.full(3000, -5.0)), {}, "less than 1 s at 1.5 m/s"),
        (with_value("v", slice(1000, 1100), -3.0), {}, "drives backwards (-3.00 m/s) 10.00 s after"),
        (
            recording(),
            {"start": 40},
            "nothing lies between start = 40 s and stop = inf s; the recording lasts 29.99",
        ),
        (recording(), {"steering_is": "wheel"}, "steering_is: 'wheel' is unknown"),
        (recording(), {"steering_scale": 3}, "asks for"),
    ],
)
def test_bad_recordings_name_file_column_and_sample(columns, options, message):
    with pytest.raises(ModelError) as error:
        drive_of(columns, **options)
    assert message in str(error.value)
    if "column" in message:
        assert str(Path("here") / "a.csv") in str(error.value)


def test_gap_may_be_allowed():
    assert drive_of(recording(GAP), largest_gap="0.25 s").time[-1] == pytest.approx(29.99)


def test_file_is_found_beside_the_study(tmp_path):
    columns = recording()
    np.savetxt(tmp_path / "a.csv", np.column_stack(list(columns.values())), "%.9f", ",", header="t,df,v")
    context = dataclasses.replace(CONTEXT, base=str(tmp_path))
    options = {"file": "a.csv", "time": "t", "steering": "df", "speed": "v", "steering_is": "road_wheel"}
    profile = build_drive("from_file", options, context)
    np.testing.assert_allclose(profile.speed, drive_of(columns).speed, atol=1e-8)
    with pytest.raises(UserError, match=r"b\.csv: the recording does not exist"):
        build_drive("from_file", {**options, "file": "b.csv"}, context)


@pytest.mark.skipif(not GENESIS.is_dir(), reason=f"{GENESIS} with the measured drives is absent")
def test_a_car_on_a_winding_road_becomes_a_truck():
    options = {
        "file": str(GENESIS / "cpg_slow_lap.mat"),
        "time": "t",
        "steering": "df",
        "speed": "v",
        "steering_is": "road_wheel",
        "steering_scale": 3.71 / (1.5213 + 1.4987),
    }
    with pytest.raises(ModelError, match=r"asks for 3\.2. m/s\^2"):
        build_drive("from_file", options, CONTEXT)
    profile = build_drive("from_file", {**options, "speed_scale": 0.9}, CONTEXT)
    assert 350 < profile.time[-1] < 361
    assert 1.5 <= profile.speed.min() < profile.speed.max() < 0.9 * 12.5
    assert np.degrees(np.abs(profile.steering_wheel_angle).max()) == pytest.approx(
        np.degrees(0.11339) * 3.71 / 3.02 * 23, rel=0.02
    )
