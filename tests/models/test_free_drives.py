"""Braking in a turn and free splines: what they do over time, and what they refuse."""

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.models.contracts import DriveContext
from harness.models.drives.spline import weights
from harness.simulation.drives import build_drive

CONTEXT = DriveContext(wheelbase=2.7, steering_ratio=16.0, step=0.01)


def test_the_wheel_is_held_while_the_speed_falls_by_the_deceleration():
    options = {"speed": 20.0, "radius": 150.0, "deceleration": 3.0, "final_speed": 8.0, "hold": 2.0, "lead_in": 1.0}
    profile = build_drive("brake_in_turn", options, CONTEXT)
    braking = np.diff(profile.speed) / 0.01
    assert braking.min() == pytest.approx(-3.0, rel=1e-6)
    begin = np.flatnonzero(braking < -1e-9)[0] * 0.01
    assert begin == pytest.approx(1.0 + 3.0 + 2.0, abs=0.05)
    held = profile.steering_wheel_angle[profile.time > 4.0]
    np.testing.assert_allclose(held, 16.0 * np.arctan(2.7 / 150.0))
    assert profile.speed[-1] == pytest.approx(8.0)
    with pytest.raises(ModelError, match="is not below the speed"):
        build_drive("brake_in_turn", {**options, "final_speed": 20.0}, CONTEXT)


def test_a_spline_stays_within_its_points_and_repeats_them():
    profile = build_drive("spline", {"steering": "0 1 1 0 -1 -1", "amplitude": 0.5, "spacing": 0.5, "lead_in": 1.0,
                                     "speeds": "1 0.8 1.2", "speed": 10.0, "duration": 20.0}, CONTEXT)  # fmt: skip
    wheel, t = profile.steering_wheel_angle, profile.time
    assert np.abs(wheel).max() <= 0.5
    assert np.abs(wheel).max() > 0.45
    np.testing.assert_allclose(wheel[t > 10.0][:300], wheel[t > 13.0][:300], atol=1e-12)  # a period of 3 s
    assert np.abs(np.diff(wheel, 2)).max() < 1e-3  # no corner
    np.testing.assert_array_equal(wheel[t <= 1.0], 0.0)
    assert profile.speed[0] == 10.0
    assert 8.0 <= profile.speed.min() < 9.0
    assert profile.speed[-1] > profile.speed.min()


def test_the_weights_of_control_points_add_up_to_one():
    table = weights(np.linspace(-1.0, 20.0, 500), 5)
    totals = table.sum(axis=1)
    along = np.linspace(-1.0, 20.0, 500)
    np.testing.assert_array_equal(totals[along <= 0.0], 0.0)
    np.testing.assert_allclose(totals[along >= 3.0], 1.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"steering": "0, 1"}, "is no list of numbers"),
        ({"steering": "0 nan"}, "is no list of numbers"),
        ({"steering": "0 1.5"}, "from -1 to 1"),
        ({"speeds": "1 0"}, "above zero"),
    ],
)
def test_points_that_are_none_are_refused(options, said):
    with pytest.raises(ModelError, match=said):
        build_drive("spline", options, CONTEXT)
