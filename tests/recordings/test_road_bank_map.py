"""The bank of a road, mapped by laps at different speeds."""

import numpy as np
import pytest
import xarray as xr

from harness.common.errors import UserError
from harness.recordings.smooth.road_bank_map import _passages, bank_map, with_bank

RADIUS = 50.0
BIAS, LEAN, LEVER = -0.6, 0.05, 0.3


def bank_at(angle):
    """Bank of a round road by place, with a part that follows the bend and one that does not (mean zero)."""
    return 0.04 * np.sin(3 * angle) + 0.02 * np.cos(angle)


def lap(speed, phase=0.0):
    """Return a lap of a circle whose radius swings with the place, driven along its middle without sideslip."""
    step, swing = 0.01, 0.3
    angle = np.arange(phase, phase + 2 * np.pi, speed * step / RADIUS)
    radius = RADIUS * (1 + swing * np.sin(2 * angle) / 4)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    heading = np.unwrap(np.arctan2(np.gradient(y, step), np.gradient(x, step)))
    v = np.hypot(np.gradient(x, step), np.gradient(y, step))
    r = np.gradient(heading, step)
    felt = BIAS + (1 + LEAN) * v * r + LEVER * np.gradient(r, step) + 9.81 * np.sin(bank_at(angle))
    time = ("time", step * np.arange(len(angle)))
    signals = {"position_x": x, "position_y": y, "heading": heading, "longitudinal_velocity": v}
    signals |= {"lateral_velocity": 0 * v, "yaw_rate": r, "lateral_acceleration": felt}
    return xr.Dataset({k: ("time", s) for k, s in signals.items()}, {"time": time}, {"file": f"lap at {speed}"}), angle


def test_laps_at_two_speeds_tell_the_bank_from_lean_bias_and_lever_arm():
    fitted, (other, angle) = [lap(8.0)[0], lap(12.0)[0]], lap(16.0, phase=1.0)
    found = bank_map(fitted).along(other)
    inner = slice(100, -100)
    assert np.std(found[inner] - bank_at(angle)[inner]) < 0.1 * np.std(bank_at(angle))


def test_what_one_drive_felt_of_the_road_is_in_the_maps_of_the_others_only():
    a, b, c = lap(8.0)[0], lap(12.0)[0], lap(16.0)[0]
    loud = a.assign(lateral_acceleration=a["lateral_acceleration"] + 5 * np.sin(7 * a["time"]))
    quiet, felt = ([d["bank_angle"].to_numpy() for d in with_bank([x, b, c], [])] for x in (a, loud))
    own, other = (np.std(x - y) for x, y in list(zip(quiet, felt, strict=True))[:2])
    assert own < 0.02 * other


def test_laps_at_one_speed_are_told_by_the_others_how_the_car_leans():
    drives = [lap(8.0), lap(12.0), lap(12.0)]
    found = with_bank([d for d, _ in drives], [])[0]["bank_angle"].to_numpy()
    expected = bank_at(drives[0][1])
    inner = slice(100, -100)
    assert np.std((found - expected)[inner]) < 0.1 * np.std(expected)


def test_one_lap_is_not_mapped_from_itself():
    with pytest.raises(UserError, match="at least two fitted drives"):
        with_bank([lap(8.0)[0]], [lap(12.0)[0]])


def test_a_drive_elsewhere_is_refused_by_name():
    elsewhere = lap(8.0)[0]
    elsewhere["position_x"] = elsewhere["position_x"] + 1000.0
    with pytest.raises(UserError, match=r"lap at 8\.0: only 0% of it lies on the mapped road"):
        bank_map([lap(8.0)[0], lap(12.0)[0]]).along(elsewhere)


def test_a_drive_that_stands_is_refused():
    standing = lap(8.0)[0]
    standing["longitudinal_velocity"] = 0 * standing["longitudinal_velocity"]
    with pytest.raises(UserError, match="never moves"):
        bank_map([standing, lap(8.0)[0]])


def noisy(drive, seed, bias):
    """Return a lap with a noisy lateral velocity and an accelerometer that has another bias."""
    noise = np.random.default_rng(seed).normal(0.0, 0.05, drive.sizes["time"])
    return drive.assign(
        lateral_velocity=drive["lateral_velocity"] + noise,
        lateral_acceleration=drive["lateral_acceleration"] + bias,
    )


def test_a_noisy_lateral_velocity_and_biases_of_drives_leave_the_lean_as_it_is():
    """Regressed on itself with noise, the lateral acceleration would seem to lean the car into the bend."""
    fitted = [noisy(lap(speed)[0], i, bias) for i, (speed, bias) in enumerate(((8.0, 0.0), (9.0, 0.3), (12.0, -0.2)))]
    lean, _, *biases = _passages(fitted).slopes()
    assert lean == pytest.approx(LEAN, abs=0.01)
    assert biases == pytest.approx([0.3, -0.2], abs=0.01)
    other, angle = lap(16.0, phase=1.0)
    found, inner = bank_map(fitted).along(other), slice(100, -100)
    assert np.std(found[inner] - bank_at(angle)[inner]) < 0.25 * np.std(bank_at(angle))
