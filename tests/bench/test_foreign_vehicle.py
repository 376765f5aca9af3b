"""The plant of other hands: its equations, its driver and its road."""

import math

import numpy as np
import pytest

from bench.foreign.cases import CASES
from bench.foreign.driver import Driver, draw_bank, draw_speed, draw_wind, half_steps, wheel_angle
from bench.foreign.vehicle import BANK, GRAVITY, SPEED, STEP, WHEEL, YAW_MOMENT, brush, integrate, truck

R1, R2, THETA, AY1, AY2 = range(1, 6)


def driven(angle, seconds=6.0, speed=20.0, p=None):
    """Return the outputs of a drive at a steady speed; the steering-wheel angle is a number or a function of s."""
    t = half_steps(seconds)
    u = np.zeros((t.size, 6))
    u[:, WHEEL], u[:, SPEED] = angle(t) if callable(angle) else angle, speed
    return integrate(u, p or truck(), STEP)


# --- the vehicle


def test_a_brush_tyre_adheres_slides_and_carries_nothing_in_the_air():
    stiffness, load, friction = 4e5, 5e4, 0.8
    limit, sliding = friction * load, math.atan(3 * friction * load / stiffness)
    assert brush(0.0, stiffness, load, friction) == 0.0
    assert brush(1e-6, stiffness, load, friction) == pytest.approx(stiffness * 1e-6, rel=1e-4)
    halfway = math.atan(math.tan(sliding) / 2)
    assert brush(halfway, stiffness, load, friction) == pytest.approx(0.875 * limit)
    assert brush(1.01 * sliding, stiffness, load, friction) == limit
    assert brush(-1.01 * sliding, stiffness, load, friction) == -limit
    assert brush(-halfway, stiffness, load, friction) == -brush(halfway, stiffness, load, friction)
    assert brush(0.1, stiffness, 1e-3, friction) == 0.0


def test_static_loads_are_the_weight_and_balance_it():
    p = truck()
    loads = np.array([p.load_11, p.load_12, p.load_21, p.load_22, p.load_23])
    assert loads.sum() == pytest.approx((p.tractor_mass + p.trailer_mass) * GRAVITY)
    weight, rear = p.trailer_mass * GRAVITY, loads[2:]
    behind = np.array([p.axle_21, p.axle_22, p.axle_23])
    assert (weight - rear.sum()) * p.trailer_kingpin == pytest.approx(rear @ behind)
    lifted = truck(shares=(1e-6, 1.0, 1.0))
    assert lifted.load_21 < 1.0
    assert lifted.load_22 > p.load_22
    assert lifted.load_12 > p.load_12


def test_straight_ahead_stays_straight_and_keeps_its_speed():
    outputs = driven(0.0)
    assert np.abs(outputs[:, R1:]).max() == 0.0
    assert outputs[:, 0] == pytest.approx(20.0)


def test_left_and_right_are_alike():
    def weave(t):
        return 1.5 * np.sin(2 * np.pi * 0.4 * t)

    left, right = driven(weave), driven(lambda t: -weave(t))
    assert np.abs(left[:, THETA]).max() > 0.02
    assert left[:, 0] == pytest.approx(right[:, 0], rel=1e-12)
    assert left[:, R1:] == pytest.approx(-right[:, R1:], abs=1e-12)


@pytest.mark.parametrize("speed", [10.0, 20.0])
def test_a_steady_bend_follows_the_linear_handling_formula(speed):
    # Axles of the trailer at one place: three of them resist turning, which the formula does not know.
    p = truck()
    p = p._replace(axle_21=p.axle_22, axle_23=p.axle_22)
    asked = 0.1
    end = driven(wheel_angle(asked, speed), 20.0, speed, p)[-1]
    assert end[[AY1, AY2]] == pytest.approx(asked, rel=2e-3)
    assert end[[R1, R2]] == pytest.approx(asked / speed, rel=2e-3)
    length = p.trailer_kingpin + p.axle_22
    slip = (p.load_21 + p.load_22 + p.load_23) / GRAVITY * asked / (p.stiffness_21 + p.stiffness_22 + p.stiffness_23)
    rear = p.load_12 / GRAVITY * asked / p.stiffness_12
    turned = (length + p.kingpin - p.drive_axle) * asked / speed**2
    assert end[THETA] == pytest.approx(slip - rear - turned, rel=0.01)


def test_a_bank_and_wind_push_to_the_lower_and_to_the_lee_side():
    banked = driven(0.0, p=truck()._replace(bank=0.02))
    assert banked[-1, R1] < 0.0
    u = np.zeros((half_steps(6.0).size, 6))
    u[:, SPEED], u[:, BANK] = 20.0, 0.02
    assert (integrate(u, truck(), STEP) == banked).all()
    u = np.zeros((half_steps(4.0).size, 6))
    u[:, SPEED], u[:, YAW_MOMENT] = 20.0, 1e4
    assert integrate(u, truck(), STEP)[500, R2] > 0.0


@pytest.mark.parametrize("name", [n for n, case in CASES.items() if case.acts or case.values])
def test_what_is_missing_changes_the_motion(name):
    case = CASES[name]
    other = driven(1.0, p=truck(case.values, shares=case.shares)._replace(**case.acts))
    assert np.abs(other - driven(1.0))[:, R1:].max() > 1e-3


def test_a_lag_of_the_steering_delays_the_yaw_rate_and_a_loss_of_friction_bounds_it():
    lagging = driven(1.0, p=truck()._replace(steering_lag=0.06))
    assert np.trapezoid(driven(1.0)[:, R1] - lagging[:, R1], dx=STEP) > 0.0
    icy = truck()._replace(later_friction=0.1, friction_change=1.0)
    before, after = driven(1.0, p=icy), driven(1.0)
    assert (before[:1001] == after[:1001]).all()
    assert 1.05 * 0.1 * GRAVITY > before[-1, AY1] > 0.0
    assert after[-1, AY1] > 2 * before[-1, AY1]


# --- the driver


def test_the_same_seed_drives_alike_and_within_what_was_asked():
    t = half_steps(60.0)

    def angles(seed):
        rng = np.random.default_rng(seed)
        speed, rate = draw_speed(rng, t)
        assert speed.min() >= 9.5
        assert speed.max() <= 24.0
        assert np.abs(rate).max() < 0.5
        return Driver(rng, t, speed).steering(3.0)

    assert (angles(1) == angles(1)).all()
    assert np.abs(angles(1)).max() < 4.5
    assert np.abs(angles(1) - angles(2)).max() > 0.1


def test_the_gust_blows_when_it_is_said_to():
    t = half_steps(120.0)
    wind, (begin, end) = draw_wind(np.random.default_rng(3), t)
    within = (t > begin + 2) & (t < end)
    assert wind[within].mean() > 2 * wind[~within].mean() > 0


def test_the_bank_goes_from_level_to_level_without_a_jump():
    t = half_steps(120.0)
    bank = draw_bank(np.random.default_rng(3), t)
    assert 0.005 < bank.std() < 0.03
    assert np.abs(bank).max() <= 0.03
    held = np.abs(np.diff(bank)) < 1e-12
    assert 0.3 < held.mean() < 0.9
    assert np.abs(np.diff(bank)).max() < 1.9 * 0.06 / 1.5 * (t[1] - t[0])
