"""``harness check``: whether signals agree with each other, forces and slip angles of the axles, the report."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.recordings import axle_curves, load_recording
from harness.recordings.consistency import check
from support.weaving_car import CLOCK, STEP, TIME, drive, stored


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
    path, _ = stored(tmp_path, {"time": TIME, **signals})
    out = tmp_path / "report"
    arguments = ["check", str(path), "--out", str(out), "--parameters", "lex_2015"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "wrong sign" in done.output
    assert "gaps longer than 0.05 s: 1" in done.output
    assert "front axle" in done.output
    page = (out / "check.html").read_text()
    assert page.count("data:image/svg") >= 3  # agreement, axles, signals
    assert "wrong sign" in page
    assert (out / "check.pdf").read_bytes().startswith(b"%PDF")
    refused = CliRunner().invoke(app, ["check", str(path), "--out", str(out), "--parameters", "ziaukas_2023"])
    assert refused.exit_code == 2
    assert "axle curves need the set of a car" in refused.output
