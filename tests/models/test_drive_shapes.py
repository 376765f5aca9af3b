"""Do the drives do what their options say?"""

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.models.contracts import DriveContext
from harness.models.drives import _shapes as shapes
from harness.simulation.drives import build_drive

CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)


def curvature(profile):
    return np.tan(profile.steering_wheel_angle / CONTEXT.steering_ratio) / CONTEXT.wheelbase


def heading(profile):
    return np.cumsum(curvature(profile) * profile.speed) * CONTEXT.step


def test_smooth_step_is_flat_at_both_ends_and_symmetric():
    x = np.linspace(-0.5, 1.5, 2001)
    y = shapes.smooth_step(x)
    assert y[0] == 0
    assert y[-1] == 1
    np.testing.assert_allclose(y + y[::-1], 1, atol=1e-12)
    assert np.abs(np.diff(y, 2)).max() < 6.1e-6  # largest curvature 5.77 times the square of the spacing


def test_smooth_ramp_is_the_integral_of_the_step():
    x = np.linspace(-1, 5, 6001)
    slope = np.gradient(shapes.smooth_ramp(x, 2.0), x)
    np.testing.assert_allclose(slope, shapes.smooth_step(x / 2.0), atol=1e-5)
    assert shapes.smooth_ramp(x, 2.0)[-1] == pytest.approx(4.0)


def test_sine_has_its_amplitude_and_frequency():
    options = {"amplitude": "30 deg", "frequency": "0.25 Hz", "lead_in": 0, "fade": 4, "duration": 84}
    steering = build_drive("sine", options, CONTEXT).steering_wheel_angle[400:8400]
    spectrum = np.abs(np.fft.rfft(steering)) * 2 / len(steering)
    frequencies = np.fft.rfftfreq(len(steering), 0.01)
    assert frequencies[spectrum.argmax()] == pytest.approx(0.25)
    assert spectrum.max() == pytest.approx(np.radians(30))


@pytest.mark.parametrize(("first", "last"), [(0.1, 1.0), (1.0, 0.1), (0.3, 0.3)])
def test_sweep_runs_from_the_first_to_the_last_frequency(first, last):
    options = {
        "first_frequency": first,
        "last_frequency": last,
        "duration": 103,
        "lead_in": 3,
        "amplitude": 0.3,
    }
    profile = build_drive("sine_sweep", options, CONTEXT)
    s = profile.steering_wheel_angle
    crossings = profile.time[1:][(s[1:] * s[:-1] < 0)]
    local = 0.5 / np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1]) - 3
    np.testing.assert_allclose(local, first * (last / first) ** (middle / 100), rtol=0.06)


def test_step_and_ramp_reach_their_amplitude():
    step = build_drive("step", {"amplitude": "-45 deg", "rise_time": "0.5 s", "lead_in": 3}, CONTEXT)
    assert step.steering_wheel_angle[300] == 0
    np.testing.assert_allclose(step.steering_wheel_angle[350:], np.radians(-45))
    ramp = build_drive("ramp", {"amplitude": "-120 deg", "rate": "10 deg/s", "rounding": 1}, CONTEXT)
    rate = np.diff(ramp.steering_wheel_angle) / 0.01
    assert np.degrees(rate[800]) == pytest.approx(-10)
    assert np.degrees(ramp.steering_wheel_angle[-1]) == pytest.approx(-120)
    assert np.degrees(np.abs(rate).max()) == pytest.approx(10)


def test_circle_holds_its_radius_and_tightens():
    circle = build_drive("steady_circle", {"radius": "40 m", "direction": "right"}, CONTEXT)
    np.testing.assert_allclose(curvature(circle)[900:], -1 / 40, rtol=1e-9)
    closing = build_drive("steady_circle", {"radius": 40, "tightening": 0.5, "speed": 6}, CONTEXT)
    assert 1 / curvature(closing)[-1] == pytest.approx(40 / 1.5)


def test_slowly_increasing_steer_stops_at_the_acceleration_wanted():
    options = {"lateral_acceleration": 1.5, "rate": "1 deg/s", "speed": 15, "duration": 60}
    profile = build_drive("slowly_increasing_steer", options, CONTEXT)
    assert 15**2 * curvature(profile)[-1] == pytest.approx(1.5)
    assert np.degrees(np.diff(profile.steering_wheel_angle).max() / 0.01) == pytest.approx(1.0)


def test_turns_gain_their_angle_at_their_speed():
    profile = build_drive("turn_90", {"duration": 25, "turn_speed": 4, "speed": 10}, CONTEXT)
    assert np.degrees(heading(profile)[-1]) == pytest.approx(90, abs=0.5)
    turning = curvature(profile) > 1e-4
    np.testing.assert_allclose(profile.speed[turning], 4.0, atol=1e-9)
    assert profile.speed[0] == pytest.approx(10)
    assert np.abs(np.diff(profile.speed)).max() / 0.01 < 0.8 * 1.01
    two = build_drive("turn_90", {"duration": 80}, CONTEXT)
    assert np.degrees(heading(two)[-1]) == pytest.approx(0, abs=0.5)
    assert np.degrees(heading(two).max()) == pytest.approx(90, abs=0.5)


def test_roundabout_bends_out_round_and_out():
    options = {"duration": 45, "angle": "180 deg", "entry_angle": "35 deg", "radius": "18 m"}
    profile = build_drive("roundabout", options, CONTEXT)
    psi = np.degrees(heading(profile))
    assert psi.min() == pytest.approx(-35, abs=0.5)
    assert psi.max() == pytest.approx(180 - 35, abs=1)
    assert psi[-1] == pytest.approx(180 - 70, abs=1)
    assert 1 / curvature(profile).max() == pytest.approx(18, rel=1e-3)


def test_manoeuvre_that_does_not_fit_is_refused():
    with pytest.raises(ModelError, match=r"lead-in and one manoeuvre take .* s, more than 10 s; raise"):
        build_drive("tight_turn", {"duration": "10 s"}, CONTEXT)


def test_winding_road_slows_for_bends_and_only_for_them():
    profile = build_drive("winding_road", {"comfort": 1.8, "speed": 18, "tightest_radius": 30}, CONTEXT)
    kappa, v = np.abs(curvature(profile)), profile.speed
    assert (v**2 * kappa).max() <= 1.8 + 1e-6
    assert (v**2 * kappa).max() > 1.7
    assert v.max() == pytest.approx(18)
    assert v.min() < 0.7 * 18
    assert 1 / kappa.max() >= 30
    assert len(np.flatnonzero(np.diff(np.sign(curvature(profile))))) >= 10
    with pytest.raises(ModelError, match="tightest_radius: 300 exceeds widest_radius"):
        build_drive("winding_road", {"tightest_radius": 300}, CONTEXT)


def test_random_sequence_spreads_over_its_range():
    options = {"amplitude": "30 deg", "duration": 600, "speed": 15, "speed_variation": 4}
    profile = build_drive("random_sequence", options, CONTEXT)
    share = profile.steering_wheel_angle / np.radians(30)
    assert np.abs(share).max() <= 1
    assert share.max() > 0.9
    assert share.min() < -0.9
    assert abs(share.mean()) < 0.15
    assert 11 <= profile.speed.min() < 12.5
    assert 17.5 < profile.speed.max() <= 19
    still = build_drive("random_sequence", {**options, "speed_variation": 0}, CONTEXT)
    np.testing.assert_array_equal(profile.steering_wheel_angle, still.steering_wheel_angle)
    with pytest.raises(ModelError, match="speed_variation"):
        build_drive("random_sequence", {"speed": 5, "speed_variation": 5}, CONTEXT)


def test_speed_change_is_smooth_and_complete():
    options = {"speed": "8 m/s", "speed_change": "6 m/s", "radius": "80 m", "duration": 60, "lead_in": 3}
    speed = build_drive("steady_circle", options, CONTEXT).speed
    assert (speed[:300] == 8).all()
    assert speed[-1] == pytest.approx(14)
    assert (np.diff(speed) >= 0).all()
    with pytest.raises(ModelError, match="speed_change: -8 m/s leaves 0 m/s"):
        build_drive("sine", {"speed": 8, "speed_change": -8}, CONTEXT)


def test_wheels_turned_across_are_refused_whatever_the_limit():
    context = DriveContext(wheelbase=3.71, steering_ratio=15.0)
    options = {"amplitude": "1500 deg", "speed": 0.5, "lateral_acceleration_limit": 20}
    with pytest.raises(ModelError, match="turns the road wheels to 100 deg"):
        build_drive("step", options, context)


# --- the manoeuvres of the NHTSA


def manoeuvre(kind: str, **options):
    return build_drive(kind, options | {"rounding": 0.01, "lateral_acceleration_limit": 200}, DriveContext(2.58, 16.0))


def test_sine_with_dwell_as_prescribed():
    profile = manoeuvre("sine_with_dwell", lead_in=1.0, amplitude="270 deg")
    angle = np.degrees(profile.steering_wheel_angle)
    period = 1 / 0.7
    quarter, dwelling = (
        100 + round(25 * period),
        (profile.time > 1.02 + 0.75 * period) & (profile.time < 1 + 0.75 * period + 0.5),
    )
    assert angle.max() == pytest.approx(270, rel=1e-3)
    assert angle.argmax() == pytest.approx(quarter, abs=1)
    assert angle[dwelling] == pytest.approx(-270, rel=1e-6)
    assert np.abs(angle[profile.time > 1.02 + period + 0.5]).max() == pytest.approx(0, abs=1e-9)
    assert profile.speed == pytest.approx(80 / 3.6)


def test_fishhook_as_prescribed():
    profile = manoeuvre("fishhook", lead_in=1.0, amplitude="240 deg")
    angle, time = np.degrees(profile.steering_wheel_angle), profile.time
    rate = np.diff(angle) / 0.01
    assert angle.max() == pytest.approx(240)
    assert np.abs(rate).max() == pytest.approx(720, rel=1e-6)
    assert (angle > 239.9).sum() * 0.01 == pytest.approx(0.25, abs=0.03)
    assert angle[(time > 2.3) & (time < 5.2)] == pytest.approx(-240)
    assert np.abs(angle[time > 7.4]).max() < 1e-9
    assert profile.speed == pytest.approx(25.0)


def test_j_turn_as_prescribed():
    profile = manoeuvre("j_turn", lead_in=1.0, amplitude="-200 deg")
    angle, time = np.degrees(profile.steering_wheel_angle), profile.time
    assert (np.diff(angle) / 0.01).min() == pytest.approx(-1000, rel=1e-6)
    assert angle[(time > 1.25) & (time < 5.1)] == pytest.approx(-200)
    assert np.abs(angle[time > 7.3]).max() < 1e-9
    assert profile.speed == pytest.approx(80 / 3.6)


def test_an_amplitude_of_zero_goes_straight():
    for kind in ("sine_with_dwell", "fishhook", "j_turn"):
        assert not manoeuvre(kind, amplitude=0.0).steering_wheel_angle.any()
