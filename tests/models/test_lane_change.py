"""The double lane change follows its path, and the drives for cars keep what the standards state."""

from pathlib import Path

import numpy as np
import pytest

import harness as h
from harness.models.contracts import DriveContext
from harness.models.drives._shapes import lateral_acceleration
from harness.simulation.drives import build_drive, read_drives

SET = Path(__file__).parents[2] / "studies/drives/iso-car.toml"
OPTIONS = {"duration": "14 s", "speed": "20 m/s", "offset": "3.5 m", "change": "50 m", "stay": "5 m", "back": "45 m",
           "lateral_acceleration_limit": "20 m/s^2"}  # fmt: skip


def path_of(profile, context):
    """Position along and across the road of a vehicle that rolls without slip."""
    heading = np.cumsum(profile.speed * np.tan(profile.steering_wheel_angle / context.steering_ratio)) * context.step
    heading /= context.wheelbase
    x, y = (np.cumsum(profile.speed * f(heading)) * context.step for f in (np.cos, np.sin))
    return x, y


@pytest.mark.parametrize("direction", ["left", "right"])
def test_a_vehicle_without_slip_keeps_to_the_lanes(direction):
    context = DriveContext(2.7, 16.0, 0.001)
    x, y = path_of(build_drive("lane_change", OPTIONS | {"direction": direction}, context), context)
    across = y if direction == "left" else -y
    begin = 20.0 * 3.0
    there = np.interp(begin + np.array([0.0, 25.0, 50.0, 55.0, 77.5, 100.0, 120.0]), x, across)
    np.testing.assert_allclose(there, [0.0, 1.75, 3.5, 3.5, 1.75, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize(("parameters", "off"), [("pacejka_2006", 0.05), ("govindarajan_2018", 0.1)])
def test_a_car_that_understeers_changes_its_lane_all_the_same(parameters, off):
    car = h.model("car", parameters, sensors="yaw_rate, lateral_acceleration")
    run = h.simulate(car, h.drive("lane_change", **OPTIONS))
    heading = np.cumsum(run.yaw_rate.values) * 0.01
    y = np.cumsum(run.speed.values * np.sin(heading) + run.lateral_velocity.values * np.cos(heading)) * 0.01
    assert y.max() == pytest.approx(3.5, abs=off)
    assert 1.5 < np.abs(run.lateral_acceleration).max() < 6.0


def test_the_drives_of_the_standards():
    context = DriveContext(2.7, 16.0)
    drives = {n: build_drive(k, o, context) for n, (k, o) in read_drives(SET).items()}
    assert {n.split("-")[1] for n in drives} == {"3888", "4138", "7401", "19365"}
    peaks = {n: np.abs(lateral_acceleration(p, context)).max() for n, p in drives.items()}
    for name in ("step", "sine", "sweep", "random"):
        assert 3.4 < peaks[f"iso-7401-{name}"] <= 4.0 + 1e-6
    assert peaks["iso-4138-speed"] == pytest.approx(5.0, rel=1e-3)
    assert peaks["iso-3888-1"] == pytest.approx(7.51 * 3.5 / 45**2 * (80 / 3.6) ** 2, rel=0.02)
    sine = drives["iso-7401-sine"]
    turning = sine.time[np.abs(sine.steering_wheel_angle) > 1e-3 * np.abs(sine.steering_wheel_angle).max()]
    assert turning[-1] - turning[0] == pytest.approx(2.0, abs=0.1)  # one period of 0.5 Hz
