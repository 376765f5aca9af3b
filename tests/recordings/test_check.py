"""``harness check``: whether signals agree with each other, forces and slip angles of the axles, the report."""

import io
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.models.signals import SIGNALS
from harness.recordings import load_recording
from harness.recordings.check import axle_curves
from harness.recordings.check.causes import EXCHANGED, catalogue
from harness.recordings.check.check_report import print_findings
from harness.recordings.check.examine import _upright, examine
from harness.recordings.check.run import _finest, check_tables
from harness.recordings.motion.consistency import AGREES, NOT_JUDGED, _differ, check, verdicts
from harness.recordings.motion.pose import tangent_plane
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import recording_of
from harness.recordings.readers import Table
from support.weaving_car import CLOCK, STEP, TIME, drive, stored


def late(values, delay):
    return np.interp(TIME - delay, TIME, values)


def noisy(**changes):
    """Recorded signals of the drive with sensor noise, some of them changed."""
    rng = np.random.default_rng(3)
    sigma = {"yaw_rate": 2e-3, "lateral_acceleration": 0.05, "longitudinal_acceleration": 0.05, "heading": 1e-4}
    signals = {k: v + rng.normal(0, sigma.get(k, 1e-3), len(v)) for k, v in drive(TIME).items() if k != "time"}
    return {**signals, **{k: change(signals[k]) for k, change in changes.items()}}


def recorded(signals):
    """Return signals as a recording, every column its own channel."""
    table = pd.DataFrame({"time": TIME, **signals})
    return recording_of(tables_of(table, mapped=False), "drive")


def findings(signals):
    return [str(finding) for finding in examine(recorded(signals)).findings]


def test_consistent_signals_raise_no_finding():
    found = examine(recorded(noisy()))
    assert found.findings == ()
    assert {f.verdict for f in found.fits} <= {AGREES, NOT_JUDGED}
    exact = {fit.relation.signal: fit for fit in found.fits if fit.relation.exact}
    assert {"yaw_rate", "lateral_acceleration", "longitudinal_velocity"} <= set(exact)
    for name in ("yaw_rate", "lateral_acceleration", "longitudinal_velocity"):
        assert exact[name].slope == pytest.approx(1, abs=0.01)
        assert abs(exact[name].delay) < max(2e-3, 4 * exact[name].delay_std)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"yaw_rate": lambda v: -v}, "yaw_rate: wrong sign"),
        ({"yaw_rate": np.degrees}, "yaw_rate: in degrees where the map says radians"),
        ({"yaw_rate": lambda v: np.radians(np.radians(v))}, "yaw_rate: in degrees converted to radians twice"),
        ({"longitudinal_velocity": lambda v: 3.6 * v}, "longitudinal_velocity: in km/h where the map says m/s"),
        ({"lateral_acceleration": lambda v: v / 9.80665}, "lateral_acceleration: in g where the map says m/s²"),
        ({"lateral_acceleration": lambda v: 1.3 * v}, r"lateral_acceleration: reads 2[2-9]\.\d+ ± .* % too much"),
        ({"lateral_acceleration": lambda v: v + 0.8}, r"lateral_acceleration: offset of 0\.[78]"),
        ({"road_wheel_angle": lambda v: -v}, "road_wheel_angle: wrong sign"),
        ({"yaw_rate": lambda v: late(v, 0.12)}, r"yaw_rate: 1(19|20|21)\.\d ± \d"),
        ({"heading": lambda v: np.pi / 2 - v}, "heading: a compass heading: clockwise from north"),
        ({"position_x": lambda v: -v}, "position_x: wrong sign"),
        ({"yaw_rate": lambda v: 0 * v}, "yaw_rate: never changes"),
    ],
)
def test_wrong_signs_units_scales_offsets_and_delays_are_found(changes, expected):
    found = findings(noisy(**changes))
    assert len(found) == 1, found
    assert re.search(expected, found[0]), found


def test_exchanged_channels_are_found():
    signals = noisy()
    signals["longitudinal_acceleration"], signals["lateral_acceleration"] = (
        signals["lateral_acceleration"],
        signals["longitudinal_acceleration"],
    )
    assert any("lateral_acceleration and longitudinal_acceleration: exchanged" in f for f in findings(signals))


def test_a_slope_that_is_no_sign_error_is_called_none():
    """A lateral velocity that has little to do with the motion must not be called reversed."""
    signals = noisy(lateral_velocity=lambda v: -0.1 * np.sin(0.37 * TIME))
    found = findings(signals)
    assert not any("lateral_velocity: wrong sign" in f for f in found), found


@pytest.mark.parametrize("seed", range(3))
def test_drifting_positions_of_a_vehicle_at_rest_say_nothing_of_the_unit_of_its_speed(seed):
    rng, seconds = np.random.default_rng(seed), np.arange(0.0, np.ceil(TIME[-1]) + 1)
    every = {name: rng.normal(0, size, len(seconds)) for name, size in (("x", 0.5), ("y", 0.5), ("v", 0.12))}
    place = {f"position_{axis}": np.interp(TIME, seconds, np.cumsum(every[axis])) for axis in "xy"}
    signals = {**place, "speed": np.interp(TIME, seconds, np.abs(every["v"])), "heading": np.full(len(TIME), 1.0)}
    examined = examine(recorded(signals))
    assert not [f for f in examined.findings if "speed" in f.signals]
    (fit,) = (f for f in examined.fits if f.relation.formula == "speed over ground")
    assert (fit.verdict, fit.reasons[0][:9]) == (NOT_JUDGED, "too slow:")


@pytest.mark.parametrize(("arm", "delay"), [(1.5, 0.0), (-1.2, 0.0), (0.0, 0.06), (-2.5, 0.0)])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("varies", [0.0, 4.0])
def test_a_delay_is_told_from_a_lever_arm_where_the_speed_varies_only(arm, delay, seed, varies):
    rng, time = np.random.default_rng(seed), np.arange(0, 60, 0.01)
    speed, rate = 20 + varies * np.sin(0.15 * time), 0.15 * np.sin(0.7 * time) + 0.1 * np.sin(1.9 * time + 1)
    pull = np.interp(time - delay, time, speed * rate + arm * np.gradient(rate, time))
    signals = {
        "longitudinal_velocity": speed,
        "yaw_rate": rate,
        "lateral_velocity": 0 * time,
        "lateral_acceleration": pull,
    }
    noise = {"yaw_rate": 0.004, "lateral_acceleration": 0.1, "longitudinal_velocity": 0.02, "lateral_velocity": 0.005}
    table = pd.DataFrame({"time": time, **{n: v + rng.normal(0, noise[n], len(v)) for n, v in signals.items()}})
    examined = examine(recording_of(tables_of(table, mapped=False), "drive"))
    late = [f for f in examined.findings if "late" in f.words or "delay" in f.words]
    (fit,) = (f for f in examined.fits if f.relation.formula == "dv_y/dt + v_x r")
    assert bool(late) == (delay > 0 and varies > 0)
    if varies:
        assert fit.arm == pytest.approx(arm, abs=0.2)
        assert np.isnan(fit.delay) or fit.delay == pytest.approx(delay, abs=0.01)
    else:
        assert np.isnan(fit.delay)
        assert "lever arm" in fit.calm
        assert fit.arm == pytest.approx(arm - 20 * delay, abs=0.2)


def test_what_cannot_be_judged_is_said_with_its_reason():
    calm = {"speed": 20 + 0.01 * np.sin(TIME), "yaw_rate": 1e-3 * np.sin(TIME), "heading": 1e-3 - 1e-3 * np.cos(TIME)}
    rng = np.random.default_rng(8)
    calm = {n: v + 1e-2 * rng.normal(size=len(v)) for n, v in calm.items()}
    said = verdicts(examine(recorded(calm)).fits)
    assert re.search(r"1 comparison: 0 agree, 1 could not be judged because: .*too calm: varies by", said), said
    short = pd.DataFrame({"time": [0.0, 0.01], "heading": [0.0, 0.1], "yaw_rate": [0.1, 0.1]})
    found = check_tables(tables_of(short, mapped=False), "two rows")
    assert "could not be judged" in found.summary
    assert "both are known on 0 samples" in found.summary


def test_a_sample_beyond_any_measurement_is_missing(recwarn):
    signals = noisy()
    signals["yaw_rate"][700], signals["heading"][900] = 1e300, np.inf
    found = check_tables(tables_of(pd.DataFrame({"time": TIME, **signals}), mapped=False), "drive")
    assert found.findings == ()
    assert sum("infinite or beyond any measurement" in w for w in found.warnings) == 2
    assert [str(w.message) for w in recwarn] == []


def test_times_in_ms_are_found_and_the_map_is_mended():
    tables = tables_of(pd.DataFrame({"time": 1e3 * TIME, **noisy()}), mapped=False)
    found = check_tables(tables, "drive")
    assert [f.kind for f in found.findings] == ["time"]
    assert found.remedy.lines == ('time = { channel = "time", unit = "ms" }',)
    assert found.remedy.passes


def test_the_lines_that_mend_keep_what_the_map_says():
    signals = noisy()
    table = pd.DataFrame({"t": TIME, "w": -np.degrees(signals["yaw_rate"]), "psi": signals["heading"]})
    content = {
        "time": {"channel": "t", "unit": "s"},
        "yaw_rate": {"channel": "w", "unit": "rad/s", "sign": -1},
        "heading": {"channel": "psi", "unit": "rad"},
    }
    found = check_tables(tables_of(table, mapped=True), "drive", content)
    assert found.remedy.lines == ('yaw_rate = { channel = "w", unit = "deg/s", sign = -1 }',)
    assert found.remedy.passes
    assert content["yaw_rate"]["unit"] == "rad/s"


def test_nothing_is_mended_of_a_right_map_with_one_clock():
    signals = noisy()
    content = {"time": {"channel": "t [s]", "unit": "s"}}
    content |= {n: {"channel": f"{n} [SI]", "unit": SIGNALS[n].unit} for n in signals}
    table = pd.DataFrame({"t [s]": TIME, **{f"{n} [SI]": v for n, v in signals.items()}})
    found = check_tables(tables_of(table, mapped=True), "drive", content)
    assert found.findings == ()
    assert found.remedy is None
    console = Console(width=300, record=True, file=io.StringIO())
    print_findings(found, console)
    assert "yaw_rate [SI]" in console.export_text()  # brackets are no markup


def test_a_clock_that_drifts_is_mended():
    signals, gnss = noisy(), ("position_x", "position_y", "heading")
    fast = pd.DataFrame({"t": 1.001 * TIME, **{n: v for n, v in signals.items() if n not in gnss}})
    slow = pd.DataFrame({"t2": TIME, **{n: signals[n] for n in gnss}})
    tables = [*tables_of(fast, mapped=True), *tables_of(slow, mapped=True)]
    content = {"time": [{"channel": "t", "unit": "s"}, {"channel": "t2", "unit": "s"}]}
    content |= {n: {"channel": n, "unit": SIGNALS[n].unit} for n in signals}
    found = check_tables(tables, "drive", content)
    assert "drift" in {f.kind for f in found.findings}
    clock = next(c for c in found.remedy.content["time"] if "factor" in c)
    expected = 1 / 1.001 if clock["channel"] == "t" else 1.001
    assert clock["factor"] == pytest.approx(expected, abs=1e-4)
    assert found.remedy.passes


def test_latitude_and_longitude_are_positions_in_metres():
    """A degree of latitude and of longitude at 45°, from the ellipsoid's radii of curvature."""
    a, e2, phi = 6_378_137.0, 0.00669437999014, np.radians(45.0)
    step = 1e-5
    east, north = tangent_plane(np.array([phi, phi + step, phi]), np.array([0.2, 0.2, 0.2 + step]))
    root = np.sqrt(1 - e2 * np.sin(phi) ** 2)
    assert north[1] == pytest.approx(step * a * (1 - e2) / root**3, rel=1e-5)
    assert east[2] == pytest.approx(step * a / root * np.cos(phi), rel=1e-5)
    assert east[0] == north[0] == 0


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


@pytest.mark.parametrize("delay", ["1e140 s", "-20 min"])
def test_a_delay_that_leaves_nothing_of_a_channel_is_refused(tmp_path, delay):
    yaw_rate = f'{{ channel = "yaw_rate", unit = "rad/s", delay = "{delay}" }}'
    path, channels = stored(tmp_path, {"time": TIME, **noisy()}, time=CLOCK, yaw_rate=yaw_rate)
    with pytest.raises(UserError, match=r"yaw_rate\.delay: \S+ s is as long as .* or longer"):
        load_recording(path, channels)


def test_semitrailer_relations_hold():
    r1 = 0.3 * np.sin(0.5 * TIME)
    r2 = 0.3 * np.sin(0.5 * TIME - 0.4)
    angle = np.concatenate([[0], np.cumsum((r2 - r1)[1:] + (r2 - r1)[:-1]) * STEP / 2])
    angle += np.random.default_rng(6).normal(0, 1e-4, len(TIME))
    noise = np.random.default_rng(7).normal(0, 1e-3, (2, len(TIME)))
    signals = {"yaw_rate_tractor": r1 + noise[0], "yaw_rate_trailer": r2 + noise[1], "articulation_angle": angle}
    assert findings(signals) == []
    assert any("articulation_angle: wrong sign" in f for f in findings({**signals, "articulation_angle": -angle}))


CAR = axle_curves.Car(1500.0, 2500.0, 1.1, 1.6, 0.5)


def test_axle_forces_balance_the_motion():
    rng = np.random.default_rng(4)
    a_y, r_dot, a_x = rng.normal(size=(3, 50))
    front, rear = axle_curves.axle_forces(CAR, a_y, r_dot)
    np.testing.assert_allclose(front + rear, CAR.mass * a_y, rtol=1e-12)
    np.testing.assert_allclose(
        CAR.cog_to_front_axle * front - CAR.cog_to_rear_axle * rear, CAR.yaw_inertia * r_dot, atol=1e-9
    )
    loads = axle_curves.axle_loads(CAR, a_x)
    np.testing.assert_allclose(sum(loads), CAR.mass * axle_curves.GRAVITY, rtol=1e-12)
    assert (
        axle_curves.axle_loads(CAR, 1.0)[0] < axle_curves.axle_loads(CAR, 0.0)[0]
    )  # accelerating unloads the front axle


def test_slope_is_the_stiffness_of_a_linear_tyre():
    """A steady circle of the textbook's bicycle model, driven slowly to the left and to the right."""
    stiff_front, stiff_rear = 9.5, 12.0
    v = 15.0 + 0 * TIME
    a_y = 2.5 * np.sin(0.2 * TIME)
    r = a_y / v
    load_front, load_rear = axle_curves.axle_loads(CAR, 0.0)
    force_front, force_rear = axle_curves.axle_forces(CAR, a_y, 0.0)
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
    curves = axle_curves.axle_curves(CAR, signals)
    front = axle_curves.cornering_slope(curves.slip_front, curves.force_front, curves.load_front)
    rear = axle_curves.cornering_slope(curves.slip_rear, curves.force_rear, curves.load_rear)
    assert front.value == pytest.approx(stiff_front, rel=1e-9)
    assert rear.value == pytest.approx(stiff_rear, rel=1e-9)
    assert front.offset == pytest.approx(0, abs=1e-12)
    rng = np.random.default_rng(5)
    assert axle_curves.cornering_slope(rng.normal(size=500), rng.normal(size=500), np.full(500, 9.0)) is None


def test_check_prints_and_writes_what_it_found(tmp_path):
    signals = noisy(yaw_rate=lambda v: -v)
    signals["lateral_velocity"][1000:1500] = np.nan
    for name in ("position_x", "position_y", "yaw_acceleration", "longitudinal_acceleration"):
        del signals[name]
    path, _ = stored(
        tmp_path, {"time": TIME, **signals, "true_yaw_rate": -signals["yaw_rate"]}
    )  # as harness simulate does
    out = tmp_path / "report"
    arguments = ["check", str(path), "--out", str(out), "--parameters", "lex_2015"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "wrong sign" in done.output
    assert "gaps longer than 0.05 s: 1" in done.output
    assert "front axle" in done.output
    page = (out / "check.html").read_text()
    assert page.count("<svg ") >= 3  # agreement, axles, signals
    assert "wrong sign" in page
    assert "mended.toml" in done.output
    assert "true_yaw_rate" not in (out / "mended.toml").read_text()
    assert (out / "check.pdf").read_bytes().startswith(b"%PDF")
    truck = CliRunner().invoke(app, ["check", str(path), "--out", str(out), "--parameters", "ziaukas_2023"])
    assert truck.exit_code == 0, truck.output
    assert "axle curves need the set of a car" in truck.output
    absent = CliRunner().invoke(app, ["check", str(path), "--out", str(out), "--parameters", "nobody_1999"])
    assert absent.exit_code == 2, absent.output


@pytest.mark.parametrize(("order", "exchanged"), [(("speed", "speed_tractor"), 0), (("speed", "yaw_rate"), 2)])
def test_what_is_read_from_a_channel_is_wrong_together_and_once(order, exchanged):
    """Of twins every fault is there once, and they are not exchanged; positions by satellite have faults as a pair."""
    twins = dict.fromkeys(order, order) if exchanged == 0 else {}
    found = catalogue([*order, "latitude", "longitude"], {}, twins)
    keys = [(f.kind, f.signals, f.factor, f.words) for f in found]
    assert len(keys) == len(set(keys))
    assert sum(f.kind == EXCHANGED and set(f.signals) == set(order) for f in found) == exchanged
    assert {f.signals for f in found if "latitude" in f.signals and f.kind != EXCHANGED} == {("latitude", "longitude")}


def test_the_finest_clock_is_the_fastest_that_runs():
    """A clock whose stamps come several at a time tells no step."""
    stamps = {"fast": 0.01 * np.arange(9), "slow": 0.1 * np.arange(9), "bursts": np.repeat([0.0, 1.0, 2.0], 3)}
    tables = [Table({f"{name}.t": t, name: t}, clock=f"{name}.t") for name, t in stamps.items()]
    signals = zip(stamps, ("yaw_rate", "speed", "lateral_acceleration"), strict=True)
    content = {signal: {"channel": name, "unit": SIGNALS[signal].unit} for name, signal in signals}
    assert _finest(tables, content) == pytest.approx(0.01)
    assert _finest(tables[1:], content) == pytest.approx(0.1)
    assert _finest(tables[:1], content) is None


@pytest.mark.parametrize(
    ("mean", "amplitude", "holds"), [(-9.81, 2.0, True), (9.81, 2.0, True), (8.0, 2.0, False), (9.81, 9.0, False)]
)
def test_a_horizontal_acceleration_holds_gravity_where_it_is_steady_about_it(mean, amplitude, holds):
    values = mean + amplitude * np.sin(TIME)
    values[5] = np.nan
    signals = {"lateral_acceleration": values, "longitudinal_acceleration": 0.0 * TIME, "vertical_acceleration": values}
    assert _upright(signals) == (["lateral_acceleration"] if holds else [])


@pytest.mark.parametrize(("part", "differ"), [(0.0, False), (0.5, False), (1.0, True)])
def test_signals_differ_that_both_move_and_have_nothing_in_common(part, differ):
    """The coefficient of determination of two signals is the square of the share that they have in common."""
    rng = np.random.default_rng(0)
    relation = next(f.relation for f in examine(recorded(noisy())).fits if f.relation.signal == "yaw_rate")
    one, other = rng.normal(size=(2, 4000))
    both = one, np.sqrt(1.0 - part**2) * one + part * other
    fit = SimpleNamespace(measured=both[0], computed=both[1], step=STEP, relation=relation)
    assert _differ(fit) is differ
    assert not _differ(SimpleNamespace(measured=1e-9 * both[0], computed=1e-9 * both[1], step=STEP, relation=relation))
