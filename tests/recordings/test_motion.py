"""Motion of measured drives: lags, derivatives, and what a point elsewhere on the body would have felt."""

import numpy as np
import pytest

from harness.recordings import load_recording
from harness.recordings.motion import kinematics
from harness.recordings.motion.kinematics import DERIVED, Sources, local_polynomial
from harness.recordings.read.resample import first_order_lag
from support.weaving_car import CLOCK, STEP, TIME, drive, stored


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


@pytest.mark.parametrize("name", [n for n in DERIVED if n in drive(TIME)])
def test_a_signal_follows_from_each_set_of_others(name):
    """Also where more is recorded, of which another set needs what is missing."""
    exact = drive(TIME)
    sets, compute = DERIVED[name]
    for needs in sets:
        for further in ("", "position_x", "heading", "yaw_rate", "lateral_velocity", "speed"):
            there = {n: v for n, v in exact.items() if n in (*needs, further) and n != name}
            derived = compute(Sources(there, STEP, 0.3))
            scale = np.std(exact[name])
            np.testing.assert_allclose(
                derived[50:-50], exact[name][50:-50], atol=0.02 * scale, err_msg=str(there.keys())
            )
