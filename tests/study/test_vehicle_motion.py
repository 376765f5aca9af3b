"""Poses of a vehicle follow from its velocities, and its bodies stay coupled."""

import numpy as np
import pytest
import xarray as xr

from harness.models.assembly.assemble import assemble
from harness.models.assembly.plan import Planner
from harness.models.roles import PARAMETERS, VEHICLES
from harness.study.motion import dead_reckoned, lateral_signal, motion, published


def moved(vehicle, parameters, tyre, **columns):
    model, values = assemble(vehicle, tyre), PARAMETERS.load(parameters).VALUES
    time = np.arange(2001) / 100
    shape = {name: np.broadcast_to(np.asarray(column, dtype=float), time.shape) for name, column in columns.items()}
    everything = xr.Dataset({n: ("time", v) for n, v in shape.items()}, coords={"time": time})
    plan = Planner(model, VEHICLES.load(vehicle)).plan(values)
    return motion(plan, model, everything, values), plan


def test_a_steady_turn_is_a_circle():
    speed, lateral, rate = 12.0, -0.4, 2 * np.pi / 20
    found, _ = moved(
        "car", "govindarajan_2018", "magic_formula", speed_over_ground=speed, lateral_velocity=lateral, yaw_rate=rate,
        road_wheel_angle=0.05, steady_lateral_force_axle_front=3e3, lateral_force_capacity_axle_front=6e3,
    )  # fmt: skip
    x, y = found["x"].values[:, 0], found["y"].values[:, 0]
    radius = np.hypot(speed, lateral) / rate
    centre = np.array([-lateral / rate, speed / rate])  # left of the velocity
    assert np.hypot(x - centre[0], y - centre[1]) == pytest.approx(radius, rel=1e-4)
    assert (x[-1], y[-1]) == pytest.approx((0, 0), abs=1e-6)
    front, rear = (found.sel(axle=a).isel(time=5) for a in ("front", "rear"))
    assert (float(front["steer"]), float(rear["steer"])) == (0.05, 0.0)
    assert float(front["friction_use"]) == 0.5
    assert np.isnan(rear["lateral_force"])


def test_tractor_and_trailer_hang_on_the_same_kingpin():
    angle = 0.3 * np.sin(np.arange(2001) / 100)
    rate = 0.2 * np.cos(np.arange(2001) / 300)
    found, plan = moved(
        "semitrailer", "ziaukas_2023", "magic_formula", speed_over_ground=8.0, speed_tractor=8.0,
        articulation_angle=angle,
        lateral_velocity_tractor=0.1, lateral_velocity_trailer=0.0, yaw_rate_tractor=rate, yaw_rate_trailer=0.0,
    )  # fmt: skip
    pins = [
        [
            found["x"].values[:, i] + plan.coupling[i] * np.cos(found["heading"].values[:, i]),
            found["y"].values[:, i] + plan.coupling[i] * np.sin(found["heading"].values[:, i]),
        ]
        for i in (0, 1)
    ]
    assert np.allclose(pins[0], pins[1])
    assert np.allclose(found["heading"].values[:, 1] - found["heading"].values[:, 0], angle)


def test_what_a_vehicle_publishes_and_how_its_lateral_velocity_is_called():
    model = assemble("car_two_track", "brush", ["crosswind"])
    names = published(model)
    assert {"yaw_rate", "slip_angle_axle_fl", "lateral_acceleration"} <= set(names)
    assert not any("_before_" in name for name in names)
    assert lateral_signal(model, "") == "lateral_velocity"
    assert lateral_signal(assemble("car_3dof"), "") is None


@pytest.mark.parametrize(("vehicle", "parameters"), [("car", "govindarajan_2018"), ("semitrailer", "ziaukas_2023")])
def test_the_true_motion_taken_as_an_estimate_leads_along_the_true_path(vehicle, parameters):
    time = np.arange(2001) / 100
    model, values = assemble(vehicle, "magic_formula"), PARAMETERS.load(parameters).VALUES
    turning = {s: 0.2 * np.sin(time + i) for i, s in enumerate(model.states)}
    own = {**values, **turning, "speed": 8.0 + 0.1 * time, "speed_rate": 0.1 + 0 * time}
    columns = {"steering_wheel_angle": 0 * time, **turning, "speed_over_ground": own["speed"]}
    if vehicle == "semitrailer":
        ahead = values["kingpin_from_rear"] - values["trailer_cog_from_rear"]
        left = turning["lateral_velocity_trailer"] + turning["yaw_rate_trailer"] * ahead
        theta = turning["articulation_angle"]
        columns["speed_tractor"] = own["speed"] * np.cos(theta) - left * np.sin(theta)
    found, _ = moved(vehicle, parameters, "magic_formula", road_wheel_angle=0.0, **columns)
    paths = dead_reckoned(
        model, {"EKF": own, "NARX": own | {"yaw_rate": np.nan * time, "yaw_rate_tractor": np.nan * time}}, time
    )
    assert list(paths) == ["EKF"]
    assert np.transpose(paths["EKF"]) == pytest.approx(np.column_stack([found["x"][:, 0], found["y"][:, 0]]), abs=1e-9)
    assert dead_reckoned(model, {"EKF": values}, time) == {}
