"""The cars of the particle studies against physics: signs, steady turns, and the limit that friction sets."""

from __future__ import annotations

import numpy as np
import pytest

from harness.models.assembly.assemble import assemble
from harness.models.parameters import lex_2015, lyons_2024, sun_2015
from support.numeric import euler, evaluator

G = 9.81
SUN, LEX = sun_2015.VALUES, lex_2015.VALUES


def newton(x, speed, speed_rate, steer, mass=1500.0):
    """Return the derivatives of ``car_reference_point`` from forces and moments about the CoG."""
    v_y, w, _ = x
    l_f, L, h = SUN["cog_to_front_axle"], SUN["axle_distance"], SUN["cog_height"]
    l_r, J = L - l_f, mass / SUN["mass_over_inertia"]
    a_x = speed_rate - w * v_y - w**2 * l_r  # of the CoG, which lies l_r ahead of the reference
    front = (l_r * mass * G - h * mass * a_x) / L  # moments about the rear contact
    rear = mass * G - front
    force_f = front * SUN["stiffness_over_load_front"] * (steer - (v_y + L * w) / speed)
    force_r = rear * SUN["stiffness_over_load_rear"] * (-v_y / speed)
    dw = (l_f * force_f - l_r * force_r) / J
    a_y = (force_f + force_r) / mass  # of the CoG: that of the reference plus dw l_r
    return [a_y - dw * l_r - w * speed, dw, w]


def test_reference_point_equations_are_newton_and_euler():
    model = assemble("car_reference_point")
    f = evaluator(model, SUN)
    rng = np.random.default_rng(0)
    for _ in range(50):
        x, speed, rate = rng.normal(size=3) * [1.0, 0.5, 1.0], rng.uniform(3, 40), rng.uniform(-5, 3)
        steer = rng.normal() * 0.1
        inputs = {"steering_wheel_angle": steer * SUN["steering_ratio"], "speed": speed, "speed_rate": rate}
        got = f(x, np.array([inputs[n] for n in model.inputs]))
        assert got == pytest.approx(newton(x, speed, rate, steer), rel=1e-10, abs=1e-12)


def test_reference_point_turns_left_on_the_curvature_of_its_slip():
    """Steady ``r = v d / (L + (1 / C_sf - 1 / C_sr) v^2 / g)``, as stiffness goes with load; a_x is still small."""
    model = assemble("car_reference_point")
    f, steer = evaluator(model, SUN), 0.01
    for speed in (8.0, 14.0, 20.0):
        inputs = {"steering_wheel_angle": steer * SUN["steering_ratio"], "speed": speed, "speed_rate": 0.0}
        u = np.tile([inputs[n] for n in model.inputs], (2500, 1))
        end = euler(f, np.zeros(3), u, 0.01)[-1]
        slip = (1 / SUN["stiffness_over_load_front"] - 1 / SUN["stiffness_over_load_rear"]) * speed**2 / G
        assert end[1] == pytest.approx(speed * steer / (SUN["axle_distance"] + slip), rel=0.02)
        assert end[1] > 0
        assert end[2] > 0


def friction_car(tyre):
    model = assemble("car_friction", tyre)

    def lateral_acceleration(friction, slip, speed=20.0):
        """Return a_y where both axles have the same slip angle."""
        x = np.array([-np.tan(slip) * speed, 0.0, friction])
        u = np.array([{"steering_wheel_angle": 0.0, "speed": speed}[n] for n in model.inputs])
        return evaluator(model, LEX, ("lateral_acceleration",))(x, u)[0]

    return lateral_acceleration


@pytest.mark.parametrize("tyre", ["brush", "magic_formula"])
@pytest.mark.parametrize("friction", [0.3, 0.6, 0.9])
def test_friction_limits_the_lateral_acceleration(tyre, friction):
    a_y = np.array([friction_car(tyre)(friction, slip) for slip in np.linspace(0, 0.5, 60)])
    assert a_y.max() <= friction * G * (1 + 1e-12)
    assert a_y.max() > 0.99 * friction * G


@pytest.mark.parametrize(("tyre", "power"), [("brush", 1), ("magic_formula", 2)])
def test_friction_does_not_show_at_small_slip(tyre, power):
    """The force of two frictions differs by a share that goes to zero with the slip, or with its square."""
    a_y = friction_car(tyre)
    gaps = [a_y(0.9, slip) / a_y(0.3, slip) - 1 for slip in (1e-4, 1e-3)]
    assert gaps[1] / gaps[0] == pytest.approx(10.0**power, rel=0.05)
    assert gaps[0] < 2e-3
    assert a_y(0.9, 0.2) / a_y(0.3, 0.2) > 2.5


def test_friction_below_zero_keeps_the_side_of_the_force():
    for tyre in ("brush", "magic_formula"):
        assert friction_car(tyre)(-0.5, 0.02) > 0


def test_brush_is_the_formula_of_the_two_zones():
    """Pacejka 2012, 3.8 and 3.11: cubic until all of the contact slides, then the limit."""
    model = assemble("car_friction", "brush")
    names = [f"{kind}_axle_front" for kind in ("steady_lateral_force", "cornering_stiffness", "vertical_load")]
    f = evaluator(model, LEX, names)
    for slip in np.linspace(-0.3, 0.3, 41):
        x = np.array([-np.tan(slip) * 20.0, 0.0, 0.6])
        force, stiffness, load = f(x, np.array([{"steering_wheel_angle": 0.0, "speed": 20.0}[n] for n in model.inputs]))
        t, limit = abs(np.tan(slip)), 0.6 * load
        expected = stiffness * t - (stiffness * t) ** 2 / (3 * limit) + (stiffness * t) ** 3 / (27 * limit**2)
        if stiffness * t > 3 * limit:
            expected = limit
        assert force == pytest.approx(np.sign(slip) * expected, rel=1e-12, abs=1e-9)


def test_axles_have_the_stiffness_of_the_source():
    model = assemble("car_friction", "brush")
    f = evaluator(model, LEX, [f"cornering_stiffness_axle_{end}" for end in ("front", "rear")])
    stiffness = f(np.array([0.0, 0.0, 0.9]), np.array([0.0, 20.0]))
    assert stiffness == pytest.approx([140e3, 130.2e3], rel=1e-4)


def test_slip_angles_use_the_lowest_speed_of_the_set():
    """Below it they are those at that speed, above it their own: a model car at walking pace is no standing car."""
    model = assemble("car", "magic_formula")
    f = evaluator(model, lyons_2024.VALUES, ["slip_angle_axle_front", "slip_angle_axle_rear"])
    lowest, x = lyons_2024.VALUES["lowest_speed"], np.array([0.05, 0.4])

    def slip(speed):
        return f(x, np.array([{"steering_wheel_angle": 0.1, "speed": speed}[n] for n in model.inputs]))

    assert slip(0.3 * lowest) == pytest.approx(slip(lowest), rel=1e-12)
    front, rear = (0.05 + 0.08049 * 0.4) / (2 * lowest), (0.05 - 0.09301 * 0.4) / (2 * lowest)
    assert slip(2 * lowest) == pytest.approx([0.1 - np.arctan(front), -np.arctan(rear)], rel=1e-12)


@pytest.mark.parametrize("begin", [0.995, 1.0, 1.0 + 1e-12, 1.0 - 1e-12])
def test_friction_change_changes_by_what_it_says(begin):
    """Also where it begins at a sample, to within the rounding of its time."""
    model = assemble("car_friction", "magic_formula", ["friction_change"])
    values = {**LEX, "friction_change": -0.6, "friction_change_time": begin, "friction_change_duration": 0.3}
    time = 0.01 * np.arange(300)
    inputs = {"steering_wheel_angle": 0 * time, "speed": 20 + 0 * time, "time": time}
    u = np.column_stack([inputs[n] for n in model.inputs])

    def f(x, u):
        return evaluator(model, values)(x, u)

    friction = euler(f, np.array([0.0, 0.0, 0.9]), u, 0.01)[:, 2]
    assert friction[:100] == pytest.approx(np.full(100, 0.9))
    assert friction[115] == pytest.approx(0.6, abs=0.021)  # half way, within a sample
    assert friction[131:] == pytest.approx(np.full(169, 0.3), abs=1e-9)
