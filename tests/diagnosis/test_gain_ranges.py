"""Positions measure the gains of a gyroscope and of the speed signal, and the search is held to that."""

import numpy as np
import pytest
import xarray as xr

from harness.diagnosis.gain_ranges import _regressed, gain_ranges
from harness.diagnosis.model.hypotheses import coordinates, hypotheses
from harness.diagnosis.report.summary import measured_ranges
from support.driven_car import FREE

GAIN, LOSS, WHEEL = "sensor_gain_error_yaw_rate", "sensor_speed_loss_yaw_rate", "wheel_radius_error"
STEP = 0.02


def smooth(rng, samples, seconds):
    """Return a smooth random signal of unit variance."""
    kernel = np.hanning(round(seconds / STEP))
    values = np.convolve(rng.normal(size=samples + len(kernel)), kernel, mode="valid")[:samples]
    return (values - values.mean()) / values.std()


def recorded(seed, gain=0.0, loss=0.0, wheel=0.0, duration=300.0, varied=4.0, noise=1.0):
    """Return a drive with sideslip, whose gyroscope and speed are off and whose positions are noisy."""
    rng = np.random.default_rng(seed)
    n = round(duration / STEP)
    v = 15.0 + varied * smooth(rng, n, 20.0)
    r = 0.2 * smooth(rng, n, 6.0)
    course = np.cumsum(r) * STEP + 1.4 * r / v - 0.004 * v * r
    x, y = (np.cumsum(v * part(course)) * STEP + rng.normal(0.0, 0.005 * noise, n) for part in (np.cos, np.sin))
    signals = {
        "yaw_rate": (1 + gain) * (1 - loss * v) * r + 0.005 + rng.normal(0.0, 0.003 * noise, n),
        "speed": (1 + wheel) * v + rng.normal(0.0, 0.02 * noise, n),
        "position_x": x,
        "position_y": y,
    }
    return xr.Dataset({k: ("time", s) for k, s in signals.items()}, {"time": STEP * np.arange(n)})


@pytest.mark.parametrize("wrong", [{}, {"gain": 0.06}, {"loss": 0.004}, {"wheel": -0.05}])
def test_what_is_off_is_within_its_range_and_what_is_not_cannot_be_far(wrong):
    names = {"gain": GAIN, "loss": LOSS, "wheel": WHEEL}
    for seed in range(3):
        found = gain_ranges([recorded(10 * seed + i, **wrong) for i in range(3)])
        for name, parameter in names.items():
            low, high = found[parameter]
            assert low <= wrong.get(name, 0.0) <= high
        assert found[WHEEL] == pytest.approx([wrong.get("wheel", 0.0) + s for s in (-0.01, 0.01)], abs=0.003)
        if "gain" not in wrong:
            assert max(map(abs, found[GAIN])) < 0.04
        if "loss" not in wrong:
            assert max(map(abs, found[LOSS])) < 0.003


def test_positions_once_a_second_do_not_exclude_the_truth():
    for gain in (0.0, 0.05, -0.05):
        coarse = []
        for drive in (recorded(i, gain=gain) for i in range(3)):
            time, some = drive["time"].to_numpy(), slice(None, None, round(1.0 / STEP))
            joined = {p: ("time", np.interp(time, time[some], drive[p][some])) for p in ("position_x", "position_y")}
            coarse.append(drive.assign(joined))
        low, high = gain_ranges(coarse)[GAIN]
        assert low <= gain <= high


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("gain", [-0.06, 0.0, 0.06])
def test_at_one_speed_a_gain_is_not_told_from_a_loss_by_speed(noise, gain):
    found = gain_ranges([recorded(i, gain=gain, varied=0.0, noise=noise) for i in range(3)])
    assert all(low < -0.5 and high > 0.5 for low, high in (found[GAIN],))
    assert found[LOSS][0] < -0.02 < 0.02 < found[LOSS][1]
    assert found[WHEEL] == pytest.approx((-0.01, 0.01), abs=0.003)


def test_a_speed_that_was_derived_from_the_positions_agrees_with_them():
    table = np.random.default_rng(0).uniform(50.0, 90.0, (40, 1))
    values, errors = _regressed(table[:, 0], table, 1)
    assert values == pytest.approx([1.0])
    assert errors < 1e-6


def test_what_has_no_positions_or_hardly_moves_says_nothing():
    drive = recorded(1)
    assert gain_ranges([drive.drop_vars("position_x")]) == {}
    assert gain_ranges([recorded(1, duration=60.0)]) == {}
    standing = drive.assign({p: 0.0 * drive[p] for p in ("position_x", "position_y")})
    assert gain_ranges([standing]) == {}
    gap = drive["position_x"].where(drive["time"] > 200.0)
    assert gain_ranges([drive.assign(position_x=gap)]) == {}


def test_the_search_is_held_to_the_ranges(augmented):
    held = augmented.within({GAIN: (-0.02, 0.01), WHEEL: (-0.5, 0.01)})
    values = held.stated()
    assert held.possible_range(GAIN, values) == (-0.02, 0.01)
    assert held.possible_range(WHEEL, values) == (-0.2, 0.01)
    gain = next(h for h in hypotheses(held, FREE) if h.name == "sensor_gain@yaw_rate")
    (one,) = (c for c in coordinates(held, FREE, (gain,), 1) if c.name == GAIN)
    assert (one.value(one.lower), one.value(one.upper)) == pytest.approx((-0.02, 0.01))
    assert augmented.possible_range(GAIN, values) == (-1.0, 2.0)
    off = augmented.within({GAIN: (0.04, 0.06), "stiffness_peak_front": (1.0, 2.0)})
    assert off.possible_range(GAIN, values) == (0.0, 0.06)  # that there is none is always possible
    assert off.bounds("stiffness_peak_front")[1] == augmented.spec.values["stiffness_peak_front"]


def test_the_report_says_to_what_the_search_was_held(augmented):
    held = augmented.within({GAIN: (-0.02, 0.01), WHEEL: (-0.5, 0.01), "of another vehicle": (0.0, 1.0)})
    said = measured_ranges(held)
    assert "sensor gain error yaw rate from -0.0200 to 0.0100" in said.replace("−", "-")
    assert "wheel radius error from -0.200 to 0.0100" in said.replace("−", "-")
    assert "of another vehicle" not in said
    assert measured_ranges(augmented) == ""
