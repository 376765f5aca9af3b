"""Effects on loads, axles and tyres against physics: weight and balance, ellipse, brush tyre, relaxation."""

from __future__ import annotations

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble
from harness.models.roles import VEHICLES
from support.effects import VALUES, G, built, look, point, rates, values
from support.numeric import evaluator

ROLL = {f"roll_steer_frequency_{tyre}": 9.0 for tyre in ("11", "12", "2")}


def loads(vehicle: str, effects: tuple[str, ...], own: dict, **at) -> np.ndarray:
    axles = VEHICLES.load(vehicle).AXLES
    return np.array(look(vehicle, effects, tuple(f"vertical_load_axle_{a}" for a in axles), own, **at))


@pytest.mark.parametrize("lift", [-0.3, 0.4, 0.99])
@pytest.mark.parametrize("axle", ["21", "22", "23"])
def test_lifting_an_axle_keeps_weight_and_balance(axle, lift):
    v = VALUES["semitrailer"]
    found = dict(
        zip(
            ("11", "12", "21", "22", "23"),
            loads("semitrailer", ("lifted_axle",), {f"axle_lift_{axle}": lift}),
            strict=True,
        )
    )
    assert sum(found.values()) == pytest.approx((v["tractor_mass"] + v["trailer_mass"]) * G)
    on_axles = {a: found[a] for a in ("21", "22", "23")}
    about_kingpin = sum(load * (v["kingpin_from_rear"] - v[f"axle_{a}_from_rear"]) for a, load in on_axles.items())
    assert about_kingpin == pytest.approx(v["trailer_mass"] * G * (v["kingpin_from_rear"] - v["trailer_cog_from_rear"]))
    others = [load for a, load in on_axles.items() if a != axle]
    assert others[0] == pytest.approx(others[1])
    assert on_axles[axle] == pytest.approx((1 - lift) * others[0])


@pytest.mark.parametrize("vehicle", ["semitrailer", "car"])
def test_braking_moves_load_forward_and_keeps_the_weight(vehicle):
    bodies = ("_tractor", "_trailer") if vehicle == "semitrailer" else ("",)
    heights = {f"longitudinal_transfer_height{b}": 1.0 for b in bodies}
    braking = {f"pitch_speed{b}": 20.0 + 4.0 * 0.15 for b in bodies}  # 4 m/s^2 behind the pitch's lag
    steady = {f"pitch_speed{b}": 20.0 for b in bodies}
    effect = ("longitudinal_load_transfer",)
    still, brakes = loads(vehicle, effect, heights, **steady), loads(vehicle, effect, heights, **braking)
    assert still == pytest.approx(loads(vehicle, effect, {}, **braking))
    assert brakes.sum() == pytest.approx(still.sum())
    assert brakes[0] > still[0]
    assert brakes[-1] < still[-1]
    v = VALUES[vehicle]
    if vehicle == "car":
        moved = v["mass"] * 4.0 / (v["cog_to_front_axle"] + v["cog_to_rear_axle"])
        assert brakes - still == pytest.approx([moved, -moved])


def test_uphill_loads_the_rear_as_driving_does():
    effects = ("road_grade", "longitudinal_load_transfer")
    at, own = {"pitch_speed": 20.0}, {"longitudinal_transfer_height": 0.6}
    up = loads("car", effects, {**own, "road_grade": 0.1}, **at)
    drives = loads("car", effects, own, pitch_speed=20.0 - G * np.sin(0.1) * 0.15)
    assert up == pytest.approx(drives)
    assert up[1] > loads("car", effects, own, **at)[1]


def test_a_bend_costs_an_axle_capacity_and_stiffness_alike_to_both_sides():
    names = ("lateral_force_capacity_axle_21", "cornering_stiffness_axle_21", "cornering_stiffness_axle_11")
    own = {"lateral_transfer_loss_2": 0.5}
    effect = ("lateral_load_transfer",)
    straight = look("semitrailer", effect, names, own)
    left, right = (look("semitrailer", effect, names, own, yaw_rate_trailer=w) for w in (0.2, -0.2))
    assert left == pytest.approx(right)
    assert left[:2] / straight[:2] == pytest.approx([1 / (1 + 0.5 * (4.0 / G) ** 2)] * 2)
    assert left[2] == straight[2]


def test_a_shifted_load_moves_weight_and_keeps_it():
    own = {"payload_shift_trailer": -0.5, "payload_shift_time": 10.0}
    before, after = (loads("semitrailer", ("payload_shift",), own, time=t) for t in (10.0, 11.0))
    assert before == pytest.approx(loads("semitrailer", ("payload_shift",), {"payload_shift_time": 0.0}))
    assert after.sum() == pytest.approx(before.sum())
    assert after[2] > before[2]
    assert after[1] < before[1]
    moved = assemble("semitrailer", "magic_formula")
    there = {**VALUES["semitrailer"], "trailer_cog_from_rear": VALUES["semitrailer"]["trailer_cog_from_rear"] - 0.5}
    x, u = np.full(10, 0.1), np.array([0.5, 20.0, 0.0])
    model = built("semitrailer", ("payload_shift",))
    shifted = evaluator(model, values(model, "semitrailer", **own))(x, np.append(u, 11.0))
    assert shifted == pytest.approx(evaluator(moved, there)(x, u), rel=1e-9)


AT_ONCE = {f"self_steering_lag_{axle}": 0.0 for axle in ("11", "12", "21", "22", "23")}


def test_an_axle_that_steers_itself_loses_slip_and_one_that_rolls_steers_into_the_bend():
    name = ("slip_angle_axle_23",)
    at = {"lateral_velocity_trailer": 0.4, "yaw_rate_trailer": 0.1}
    (plain,) = look("semitrailer", ("self_steering_axle",), name, AT_ONCE, **at)
    (half,) = look("semitrailer", ("self_steering_axle",), name, {**AT_ONCE, "self_steering_23": 0.5}, **at)
    leaning = {**at, "roll_steer_leaning_2": 1.5}
    (rolled,) = look("semitrailer", ("roll_steer",), name, {**ROLL, "roll_steer_2": 0.002}, **leaning)
    assert half == pytest.approx(plain / 2)
    assert rolled == pytest.approx(plain + 0.002 * 1.5)


def test_wheels_that_trail_turn_behind_their_damper():
    effect, name = ("self_steering_axle",), ("slip_angle_axle_23",)
    at = {"lateral_velocity_trailer": 0.4, "yaw_rate_trailer": 0.1}
    own = {**AT_ONCE, "self_steering_23": 0.5, "self_steering_lag_23": 0.4}
    (plain,) = look("semitrailer", effect, name, AT_ONCE, **at)
    (still,) = look("semitrailer", effect, name, own, **at)
    (turned,) = look("semitrailer", effect, name, own, **at, swivelled_23=plain)
    assert still == pytest.approx(plain, rel=1e-3)
    assert turned == pytest.approx(plain / 2)
    assert rates("semitrailer", effect, own, **at)["swivelled_23"] == pytest.approx(plain / 0.4, rel=1e-3)


def test_what_steers_by_roll_follows_the_lateral_acceleration_of_its_own_body():
    own = {**ROLL, "roll_steer_2": 0.002}
    at = {"lateral_velocity_trailer": 0.4, "yaw_rate_trailer": 0.1}
    (a_y,) = look("semitrailer", ("roll_steer",), ("lateral_acceleration_trailer",), own, **at)
    moved = rates("semitrailer", ("roll_steer",), own, **at)
    assert moved["roll_steer_leaning_rate_2"] == pytest.approx(81.0 * a_y)


def test_a_forced_axle_turns_to_the_side_to_which_the_trailer_stands():
    """In a left bend the tractor points further left, the articulation angle is negative, the axle turns right."""
    at = {"articulation_angle": -0.1, "yaw_rate_trailer": 0.1}
    names = ("slip_angle_axle_22", "slip_angle_axle_23")
    plain, forced = (
        look("semitrailer", ("forced_steering",), names, {"forced_steering_23": k}, **at) for k in (0, 0.4)
    )
    assert forced == pytest.approx([plain[0], plain[1] - 0.04])


def test_a_vehicle_moves_at_the_speed_of_its_true_wheel_radius():
    """With a recorded speed that is too large by a share all is as with the lower one, rates of the speed too."""
    error, names = 0.05, ("speed_over_ground", "slip_angle_axle_23", "coupling_force")
    at = {"lateral_velocity_trailer": 0.4, "yaw_rate_trailer": 0.1, "articulation_angle": 0.05}
    model = built("semitrailer", ("wheel_radius_error",))
    read = evaluator(model, values(model, "semitrailer", wheel_radius_error=error), names)
    true = evaluator(model, values(model, "semitrailer"), names)
    recorded = point(model, speed=21.0, speed_rate=1.05, **at)
    moving = point(model, speed=20.0, speed_rate=1.0, **at)
    assert read(*recorded) == pytest.approx(true(*moving))


def test_relaxing_forces_build_up_over_their_way():
    length, speed, step = 0.8, 20.0, 1e-4
    model = built("car", ("tyre_relaxation",), "linear")
    numbers = values(model, "car", tyre_relaxation_front=length)
    f = evaluator(model, numbers)
    force = evaluator(model, numbers, ("steady_lateral_force_axle_front",))
    x, u = point(model, steering_wheel_angle=0.1)
    held = [i for i, n in enumerate(model.states) if not n.startswith("relaxed")]
    end = int(length / speed / step)
    run = []
    for _ in range(10 * end):
        run.append(force(x, u)[0])
        slope = f(x, u)
        slope[held] = 0.0
        x = x + step * slope
    after_length = (run[end] - run[0]) / (run[-1] - run[0])
    assert after_length == pytest.approx(1 - np.exp(-1), abs=0.03)


def test_a_linear_tyre_that_saturates_is_the_brush_tyre():
    """With inverse friction 1 / mu, at any slip; the brush tyre's slip is tan(alpha), the linear one's as well."""
    mu = VALUES["car"]["friction"]
    own = {"inverse_friction_front": 1 / mu, "inverse_friction_rear": 1 / mu}
    names = tuple(f"steady_lateral_force_axle_{a}" for a in ("front", "rear"))
    brush = built("car", (), "brush")
    for v_y in (-6.0, -0.5, 0.1, 1.0, 3.0):
        found = look("car", ("tyre_saturation",), names, own, tyre="linear", lateral_velocity=v_y, yaw_rate=0.1)
        x, u = point(brush, lateral_velocity=v_y, yaw_rate=0.1)
        assert found == pytest.approx(evaluator(brush, values(brush, "car"), names)(x, u), rel=1e-9)


def test_offset_and_drift_of_a_tyre():
    names = ("steady_lateral_force_axle_11", "steady_lateral_force_axle_12")
    assert look("semitrailer", ("tyre_force_offset",), names, {"tyre_force_offset_11": 300.0}) == pytest.approx(
        [300.0, 0.0]
    )
    stiffness = ("cornering_stiffness_axle_11",)
    start, later = (
        look("semitrailer", ("tyre_stiffness_drift",), stiffness, {"stiffness_drift_11": 1e-3}, time=t)
        for t in (0, 100)
    )
    assert later / start == pytest.approx([np.exp(0.1)])


def test_driving_and_braking_take_lateral_force_as_the_ellipse_does():
    v = VALUES["semitrailer"]
    name = ("steady_lateral_force_axle_12",)
    share, mu = 1.0, v["friction"]
    own = {"combined_slip_driving_12": (share / mu) ** 2, "combined_slip_braking_12": (0.5 * share / mu) ** 2}
    at = {"lateral_velocity_tractor": -0.3}
    found = {
        a: look("semitrailer", ("combined_slip",), name, own, drive_speed=20.0 - 0.15 * a, **at)[0]
        for a in (-1.0, 0.0, 1.0)
    }
    F_x = v["tractor_mass"] + v["trailer_mass"]
    F_z = loads("semitrailer", ("combined_slip",), {}, drive_speed=20.0)[1]
    for a, part in ((1.0, share), (-1.0, 0.5 * share)):
        assert found[a] / found[0.0] == pytest.approx(np.sqrt(1 - (part * F_x / (mu * F_z)) ** 2), rel=0.01)


@pytest.mark.parametrize("slip", [-0.3, -0.05, 0.02, 0.1, 0.25])
def test_a_curved_tyre_is_the_magic_formula_with_its_curvature(slip):
    v = VALUES["car"]
    l_f, l_r = v["cog_to_front_axle"], v["cog_to_rear_axle"]
    load = v["mass"] * G * l_f / (l_f + l_r)
    slope, limit = (
        v["stiffness_peak_rear"] * np.sin(2 * np.arctan(load / v["stiffness_load_rear"])),
        v["friction"] * load,
    )
    shape, curvature = v["shape_factor_rear"], -0.8 * (1 - 0.25 * np.sign(slip))  # p_Ey1 = -0.8, p_Ey3 = 0.25
    x = slope / (shape * limit) * np.tan(slip)
    wanted = limit * np.sin(shape * np.arctan(x - curvature * (x - np.arctan(x))))
    own = {"tyre_curvature_rear": -0.8, "tyre_curvature_side_rear": 0.2}
    name, at = ("steady_lateral_force_axle_rear",), {"lateral_velocity": -20.0 * np.tan(slip)}
    assert look("car", ("tyre_curvature",), name, own, **at) == pytest.approx([wanted], rel=1e-9)


def test_a_curvature_is_one_at_most_and_needs_the_magic_formula():
    name, at = ("steady_lateral_force_axle_rear",), {"lateral_velocity": -3.0}
    most, more = (
        look("car", ("tyre_curvature",), name, {"tyre_curvature_rear": 0.9, "tyre_curvature_side_rear": s}, **at)
        for s in (0.1, 0.6)
    )
    assert more == pytest.approx(most)
    with pytest.raises(ModelError, match="no curvature"):
        built("car", ("tyre_curvature",), "brush")


@pytest.mark.parametrize("compliance", [-1e-6, 2e-6])
def test_slip_and_force_of_a_compliant_axle_agree(compliance):
    """Without compliance, at the slip that is left, the tyre makes the force that takes the rest of it."""
    names = ("slip_angle_axle_rear", "steady_lateral_force_axle_rear", "slip_angle_axle_front")
    for v_y in (-4.0, -1.0, 0.3, 2.0):
        stiff = look("car", (), names, {}, lateral_velocity=v_y)
        slip, force, front = look(
            "car", ("axle_compliance_steer",), names, {"axle_compliance_steer_rear": compliance}, lateral_velocity=v_y
        )
        assert slip == pytest.approx(stiff[0] - compliance * force, rel=1e-3)
        assert force == pytest.approx(look("car", (), names, {}, lateral_velocity=-20.0 * np.tan(slip))[1], rel=1e-9)
        assert front == stiff[2]


def test_a_steered_axle_yields_by_its_steering_alone():
    assert "axle_compliance_steer_front" not in built("car", ("axle_compliance_steer",)).parameter_names
    with pytest.raises(ModelError, match="nothing to act on"):
        built("car", ("axle_compliance_steer@front",))
    at = {"lateral_force_axle_22": 2e4}
    turned = look(
        "semitrailer", ("axle_compliance_steer",), ("slip_angle_axle_22",), {"axle_compliance_steer_2": 1e-6}, **at
    )
    assert turned == pytest.approx([-0.02])
