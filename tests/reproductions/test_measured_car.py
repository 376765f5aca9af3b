"""Cars identified from measured drives: where the search begins, what a calibration takes away, what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import harness as h
from harness.config import resolve_single
from harness.identification.coordinates import Coordinates
from harness.identification.measured_file import MeasuredStudy
from harness.recordings.check.axle_curves import axles_of
from reproductions.identify_measured import calibrated, from_slopes, main
from support.documented import recorded as log_of

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_navigation"}
FRONT, REAR = 60e3, 90e3
"""N/rad; stiffness of the axles of the recorded car, which is not that of the set."""
FILES = sorted(Path("studies/identify").glob("*.toml"))

FILE = """
title = "t"
recordings = "nowhere"
{more}
[model]
vehicle = "car"
parameters = "blanco_2021"
tyre = "linear"
sensors = "car_navigation"
[[train]]
file = "a.csv"
[[test]]
file = "b.csv"
"""


def recorded():
    """Return what the axles of a car of known stiffness leave in a recording, and its parameters."""
    values = resolve_single(CAR, "test").values
    time = np.arange(0.0, 60.0, 0.02)
    front, rear = 0.02 * np.sin(0.7 * time), 0.015 * np.sin(0.7 * time + 0.3)
    l_f, l_r, v = values["cog_to_front_axle"], values["cog_to_rear_axle"], 20.0
    turning = (l_f * FRONT * front - l_r * REAR * rear) / values["yaw_inertia"]
    r = np.cumsum(turning) * 0.02
    v_y = l_r * r - v * np.tan(rear)
    signals = {
        "lateral_acceleration": (FRONT * front + REAR * rear) / values["mass"],
        "yaw_acceleration": turning,
        "road_wheel_angle": front + np.arctan((v_y + l_f * r) / v),
        "longitudinal_velocity": np.full_like(time, v),
        "lateral_velocity": v_y,
        "yaw_rate": r,
    }
    return xr.Dataset({n: ("time", s) for n, s in signals.items()}, {"time": time}), values


def test_the_search_begins_at_the_stiffness_that_the_axles_show():
    recording, values = recorded()
    spec = resolve_single(CAR, "test")
    started = from_slopes(spec, axles_of([recording], values, "test"))
    model = spec.model()
    known = {p.name: started.values[p.name] for p in model.parameters}
    for axle, expected in (("front", FRONT), ("rear", REAR)):
        port = model.ports[f"cornering_stiffness_axle_{axle}"]
        while port.free_symbols - {s for s in port.free_symbols if s.name in known}:
            port = port.subs({s: model.ports[s.name] for s in port.free_symbols if s.name in model.ports})
        found = float(port.subs({s: known[s.name] for s in port.free_symbols}))
        assert found == pytest.approx(expected, rel=0.02)


def test_a_calibration_takes_away_what_the_sensors_and_the_steering_add():
    recording, values = recorded()
    found = {**values, "steering_ratio": 1.25, "steering_offset": 0.01, "reference_from_cog": 0.4}
    found |= {
        "sensor_bias_yaw_rate": 0.02,
        "sensor_bias_lateral_velocity": -0.1,
        "sensor_bias_lateral_acceleration": 0.5,
    }
    seen = recording.assign(
        steering_wheel_angle=1.25 * (recording["road_wheel_angle"] - 0.01),
        road_wheel_angle=0.0 * recording["road_wheel_angle"],
        yaw_rate=recording["yaw_rate"] + 0.02,
        lateral_velocity=recording["lateral_velocity"] + 0.4 * recording["yaw_rate"] - 0.1,
        lateral_acceleration=recording["lateral_acceleration"] + 0.5,
    )
    freed = calibrated(seen, found)
    for name in recording:
        np.testing.assert_allclose(freed[name], recording[name], atol=1e-12)


def test_noise_that_is_held_is_no_coordinate():
    spec = resolve_single(CAR, "test")
    held, free = (Coordinates.of(spec, ["yaw_inertia"], np.ones(3), process=p) for p in (False, True))
    assert not held.kind("process").any()
    assert free.kind("process").any()
    at = held.candidates(held.centre)
    assert [float(q) for q in at.process[:, 0]] == [spec.process_noise[s] for s in spec.model().states]


@pytest.mark.proof
def test_a_recorded_car_is_identified(tmp_path, capsys):
    car = h.model("car", "blanco_2021", tyre="linear", sensors="car_navigation", values={"yaw_inertia": 3000.0})
    (tmp_path / "nowhere").mkdir()
    for name, seed in (("a.csv", 1), ("b.csv", 2)):
        driven = log_of(car, seed, speed="20 m/s", amplitude="1.5 deg")
        driven.assign(longitudinal_velocity=driven["speed"]).to_csv(tmp_path / "nowhere" / name, index=False)
    path = tmp_path / "car.toml"
    path.write_text(FILE.format(more='free = ["yaw_inertia"]'))
    assert main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert f"wrote {tmp_path}/out/report.html" in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "identify.json").read_text(encoding="utf-8"))
    inertia = next(e for e in found["estimates"] if e["name"] == "yaw_inertia")
    assert inertia["value"] == pytest.approx(
        3000.0, rel=0.06
    )  # the set has 1605; the tyres are held as axles show them
    assert (tmp_path / "out" / "report.pdf").stat().st_size > 10_000


def test_without_the_folder_of_recordings_it_is_skipped(tmp_path, capsys):
    path = tmp_path / "car.toml"
    path.write_text(FILE.format(more=""))
    assert main([str(path), "--out", str(tmp_path / "out")]) == 0
    assert "skipped, there is no folder" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('free = ["yaw_inertai"]', "free[0]: the model has no parameter 'yaw_inertai'; closest: yaw_inertia"),
        ('colour = "red"', "colour"),
        ("settings = 3", "settings"),
    ],
)
def test_what_is_wrong_is_named_with_its_key(tmp_path, capsys, more, said):
    (tmp_path / "nowhere").mkdir()
    table = "time,speed,steering_wheel_angle\n" + "".join(f"{0.02 * k:.2f},20,0.0\n" for k in range(1500))
    for name in ("a.csv", "b.csv"):
        (tmp_path / "nowhere" / name).write_text(table)
    path = tmp_path / "car.toml"
    path.write_text(FILE.format(more=more))
    assert main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_the_files_of_the_project_are_valid(path):
    study = MeasuredStudy.read(path)
    assert set(study.raw.free) == set(study.fitted_parameters())
    assert study.channels is not None
    assert study.channels.is_file()
