"""An inertial unit that stands or lies otherwise than the vehicle's axes."""

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import UserError
from harness.recordings import load_recording
from harness.recordings.check.run import check_recording
from harness.recordings.motion.mounting import angles, axes, rotation

TIME = np.arange(0, 60, 0.02)
SPEED, RATE = 15 + 3 * np.sin(0.3 * TIME), 0.15 * np.sin(0.7 * TIME)
FORCE = np.array([0.9 * np.cos(0.3 * TIME), SPEED * RATE, np.full(len(TIME), 9.81)])
TURNING = np.array([np.zeros(len(TIME)), np.zeros(len(TIME)), RATE])
MOUNTINGS = [(0.0, 0.0, 90.0), (90.0, 0.0, 0.0), (180.0, 0.0, 45.0), (0.0, -90.0, 20.0), (-30.0, 20.0, -100.0)]


def drive(folder, mounting):
    """Write a drive as a turned unit records it, with a map that takes it as not turned."""
    noise = np.random.default_rng(1)
    turn = rotation(*np.radians(mounting))
    force, turning = turn.T @ FORCE + noise.normal(0, 0.02, FORCE.shape), turn.T @ TURNING
    turning = turning + noise.normal(0, 0.001, FORCE.shape)
    columns = {"t": TIME, "v": SPEED}
    columns |= {f"acc_{axis}": force[n] for n, axis in enumerate("xyz")}
    columns |= {f"gyr_{axis}": turning[n] for n, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(folder / "a.csv", index=False)
    return {
        "time": {"channel": "t", "unit": "s"},
        "longitudinal_velocity": {"channel": "v", "unit": "m/s"},
        "lateral_acceleration": {"channel": "acc_y", "unit": "m/s^2"},
        "longitudinal_acceleration": {"channel": "acc_x", "unit": "m/s^2"},
        "yaw_rate": {"channel": "gyr_z", "unit": "rad/s"},
    }


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_a_turned_unit_is_found_and_read_in_the_axes_of_the_vehicle(tmp_path, mounting):
    content = drive(tmp_path, mounting)
    outcome = check_recording(tmp_path / "a.csv", content)
    (finding,) = (f for f in outcome.findings if f.kind == "mounting")
    assert "acc_x, acc_y, acc_z: the unit is mounted turned" in finding.words
    mended = outcome.remedy.content
    unit = mended["mounting"]["imu"]
    stated = rotation(*(np.radians(float(unit[key].split()[0])) for key in ("roll", "pitch", "yaw")))
    np.testing.assert_allclose(stated, rotation(*np.radians(mounting)), atol=0.01)
    recording = load_recording(tmp_path / "a.csv", mended)
    for name, values in {
        "lateral_acceleration": FORCE[1],
        "longitudinal_acceleration": FORCE[0],
        "yaw_rate": RATE,
    }.items():
        assert np.sqrt(np.mean((recording[name] - values) ** 2)) < 0.05, name


def test_a_unit_along_the_axes_of_the_vehicle_is_left_alone(tmp_path):
    outcome = check_recording(tmp_path / "a.csv", drive(tmp_path, (2.0, 1.0, -3.0)))
    assert not any(f.kind == "mounting" for f in outcome.findings)


def test_angles_are_those_of_the_rotation_and_a_force_without_gravity_tells_nothing():
    for mounting in MOUNTINGS:
        turn = rotation(*np.radians(mounting))
        np.testing.assert_allclose(rotation(*angles(turn)), turn, atol=1e-12)
    np.testing.assert_allclose(rotation(np.pi / 2, 0, 0) @ [0, 1, 0], [0, 0, 1], atol=1e-12)  # y of the unit is up
    assert axes(FORCE - [[0], [0], [9.81]], TURNING, SPEED, FORCE[0]) is None


@pytest.mark.parametrize(
    ("names", "said"),
    [(["acc_x", "acc_y"], "name three columns"), (["acc_x", "acc_y", "b"], "are not three columns of")],
)
def test_columns_of_a_mounting_that_are_no_three_are_refused(tmp_path, names, said):
    content = drive(tmp_path, (0.0, 0.0, 0.0)) | {"mounting": {"imu": {"acceleration": names, "yaw": "90 deg"}}}
    with pytest.raises(UserError, match=said):
        load_recording(tmp_path / "a.csv", content)
