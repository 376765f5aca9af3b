"""Field quality of the blind plant: what an ordinary logger leaves, and no more; the drives are those of clean ones."""

import json

import numpy as np
import plant
import pytest
from plant_cases import Drawn, Truth, cases, seeds
from plant_field import DELAY, DRIFT, GYROSCOPE, LOST, SPEED_STEP, STEERING_STEP, WHEEL_RADIUS, beyond, draw_logger
from plant_simulation import drive

from support.blind_vehicles import NOMINAL


@pytest.fixture(scope="module")
def both():
    """The same drive of a car, clean and in field quality, with the logger."""
    case, found = cases()["car-none"], []
    logger = draw_logger("car", np.random.default_rng(seeds(case, 0)[4]))
    for given in (None, logger):
        found.append(drive(NOMINAL["car"], seeds(case, 0)[1], given))
    return *found, logger


def test_the_drive_is_the_same_and_only_the_recording_differs(both):
    clean, field, _ = both
    np.testing.assert_array_equal(clean.truth, field.truth)
    assert clean.recording.keys() == field.recording.keys()


def test_steps_rates_and_losses_are_those_of_a_bus(both):
    _, field, _ = both
    time, speed = field.recording["time"], field.recording["speed"]
    assert 0.5 * LOST < 1 - len(time) / 12001 < 2 * LOST
    assert 0.0008 < np.std(time - np.round(time, 2)) < 0.0012
    assert np.all(np.diff(time) > 0)
    for name, step in (("speed", SPEED_STEP), ("steering_wheel_angle", STEERING_STEP)):
        counts = field.recording[name] / step
        spiked = np.abs(counts - np.round(counts)) > 1e-6
        assert spiked.sum() <= 8  # outliers alone are off the steps
    assert 0.45 < np.mean(np.diff(speed) == 0) < 0.6  # at 50 Hz, held to 100 Hz


def test_every_channel_is_as_late_as_the_logger_says(both):
    """The lag of the best match with the clean drive, on smoothed signals, against the drawn delay."""
    clean, field, logger = both
    grid = np.arange(1.0, 119.0, 0.01)
    for name in ("steering_wheel_angle", "lateral_velocity"):
        seen = np.interp(grid, field.recording["time"], field.recording[name])
        lags = np.arange(0.0, 0.0601, 0.001)
        misses = [
            np.median(np.abs(seen - np.interp(grid - lag, clean.recording["time"], clean.recording[name])))
            for lag in lags
        ]
        assert lags[int(np.argmin(misses))] == pytest.approx(logger.delays[name], abs=0.004)


def test_sizes_are_those_of_ordinary_sensors():
    loggers = [draw_logger("semitrailer", np.random.default_rng(i)) for i in range(30)]
    late = np.array([list(each.delays.values()) for each in loggers])
    assert 0 <= late.min() < late.max() <= DELAY
    assert (np.ptp(late, axis=1) > 0).all()  # channels differ
    assert max(abs(each.radius) for each in loggers) <= WHEEL_RADIUS
    gyros = np.array([each.noise["yaw_rate_trailer"] for each in loggers])
    assert np.radians(0.1) <= gyros.min()
    assert gyros.max() <= np.radians(0.3) == GYROSCOPE[1]


def test_planted_faults_of_sensors_exceed_what_the_recording_has():
    drawn = [
        Drawn("sensor_delay", "small", "yaw_rate", {"sensor_delay@yaw_rate": 0.01}),
        Drawn("sensor_bias", "small", "yaw_rate", {"bias@yaw_rate": -0.003}),
        Drawn("steering_delay", "small", "", {"delay": 0.01}),
        Drawn("sensor_gain", "small", "yaw_rate", {"gain_error@yaw_rate": 0.01}),
    ]
    late, bias, steering, gain = (e.values for e in beyond(Truth("car", {}, drawn)).effects)
    assert late["sensor_delay@yaw_rate"] > DELAY < steering["delay"]
    assert bias["bias@yaw_rate"] == pytest.approx(-0.003 - DRIFT)
    assert gain == {"gain_error@yaw_rate": 0.01}


def test_the_seal_says_what_is_wrong_with_the_recording_and_the_map_what_to_do(tmp_path):
    assert not plant.main(["--case", "car-none", "--quality", "field", "--out", str(tmp_path)])
    sealed = json.loads((tmp_path / "sealed.json").read_text())
    assert sealed["quality"] == "field"
    assert {f["name"] for f in sealed["recording"]} == {
        "steering_delay",
        "speed_delay",
        "sensor_delay",
        "sensor_bias",
        "sensor_drift",
        "wheel_radius_error",
    }
    delay = {f["place"]: f["delay"] for f in sealed["recording"] if "delay" in f}
    assert (
        max(delay.pop(n) for n in ("steering_wheel_angle", "speed")) < 0.0 < min(delay.values())
    )  # the vehicle is early
    assert "remove_spikes = true" in (tmp_path / "channels.toml").read_text()
    assert not plant.main(["--case", "car-none", "--out", str(tmp_path / "clean")])
    assert json.loads((tmp_path / "clean" / "sealed.json").read_text())["recording"] == []
