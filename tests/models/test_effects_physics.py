"""Each effect against physics: signs, balances, energy, symmetry, and limits that are known in closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from _numeric import euler, evaluator, jacobian

from models import registry
from models.assemble import Model, assemble
from models.parameters import althoff_2020, govindarajan_2018, ziaukas_2023

G = 9.81
SENSORS = {"semitrailer": "test_vehicle_inertial", "car": "car_navigation", "car_two_track": "car_inertial"}
VALUES = {"semitrailer": ziaukas_2023.VALUES, "car": govindarajan_2018.VALUES, "car_two_track": althoff_2020.VALUES}


@cache
def built(vehicle: str, effects: tuple[str, ...], tyre: str = "magic_formula") -> Model:
    return assemble(vehicle, tyre, effects, SENSORS[vehicle])


def values(model: Model, vehicle: str, **own: float) -> dict[str, float]:
    neutral = {p.name: p.neutral for p in model.parameters if p.neutral is not None}
    return {**VALUES[vehicle], **neutral, **own}


def point(model: Model, **given: float) -> tuple[np.ndarray, np.ndarray]:
    """Return state and inputs by name; what is not given is zero, the speed 20 m/s."""
    given = {"speed": 20.0, "longitudinal_velocity": 20.0, "friction_coefficient": 1.0, **given}
    return tuple(np.array([given.get(n, 0.0) for n in names]) for names in (model.states, model.inputs))


def look(vehicle: str, effects: tuple[str, ...], quantities: tuple[str, ...], own: dict, tyre="magic_formula", **at):
    """Return named quantities of a model at a point."""
    model = built(vehicle, effects, tyre)
    known = (*model.ports, *model.states, *model.inputs)
    assert all(q in known for q in quantities)
    return evaluator(model, values(model, vehicle, **own), quantities)(*point(model, **at))


def rates(vehicle: str, effects: tuple[str, ...], own: dict, tyre="magic_formula", **at) -> dict[str, float]:
    """Return the derivatives of the states by name at a point."""
    model = built(vehicle, effects, tyre)
    found = evaluator(model, values(model, vehicle, **own))(*point(model, **at))
    return dict(zip(model.states, found, strict=True))


# --- road


@pytest.mark.parametrize("vehicle", ["semitrailer", "car", "car_two_track"])
def test_a_bank_pulls_downhill_and_the_accelerometer_does_not_feel_it(vehicle):
    accelerometer = "lateral_acceleration_tractor" if vehicle == "semitrailer" else "lateral_acceleration"
    own = {"road_bank": 0.1}
    banked = rates(vehicle, ("road_bank",), own)
    for state in (s for s in banked if s.startswith("lateral_velocity")):
        assert banked[state] == pytest.approx(-G * np.sin(0.1))
    felt = look(vehicle, ("road_bank",), (accelerometer,), own)
    assert felt == pytest.approx([0.0], abs=1e-9)


def test_the_truck_settles_on_a_bank_with_tyre_forces_that_carry_its_weight():
    model = built("semitrailer", ("road_bank",))
    f = evaluator(model, values(model, "semitrailer", road_bank=0.02))
    x, u = point(model)
    x = euler(f, x, np.tile(u, (6000, 1)), 0.005)[-1]
    assert f(x, u) == pytest.approx(np.zeros(len(x)), abs=0.05 * G)  # a slow turn downhill remains
    tyres = [x[i] for i, n in enumerate(model.states) if n.startswith("lateral_force")]
    total = ziaukas_2023.VALUES["tractor_mass"] + ziaukas_2023.VALUES["trailer_mass"]
    turning = x[model.states.index("yaw_rate_tractor")] * 20.0
    assert sum(tyres) == pytest.approx(total * (G * np.sin(0.02) + turning), rel=0.02)


def test_the_three_banks_are_one_bank():
    constant = rates("car", ("road_bank",), {"road_bank": 0.03})["lateral_velocity"]
    measured = rates("car", ("road_bank_measured",), {"bank_share": 1.0}, bank_angle=0.03)["lateral_velocity"]
    own = {"bank_wander": 0.01, "bank_memory": 5.0}
    varying = rates("car", ("road_bank_varying",), own, bank_walk=3.0)
    assert measured == pytest.approx(constant)
    assert varying["lateral_velocity"] == pytest.approx(constant)
    assert varying["bank_walk"] == pytest.approx(-3.0 / 5.0)


def test_a_grade_slows_a_car_that_computes_its_speed():
    at = {"yaw_rate": 0.1, "lateral_velocity": 0.3}
    up, level = (rates("car_two_track", ("road_grade",), {"road_grade": g}, **at) for g in (0.05, 0.0))
    assert up["longitudinal_velocity"] - level["longitudinal_velocity"] == pytest.approx(-G * np.sin(0.05))
    assert up["lateral_velocity"] == level["lateral_velocity"]


def test_friction_changes_the_capacity_of_the_truck_and_stays_positive():
    own = {"friction_change": -0.4, "friction_change_time": 5.0, "friction_change_duration": 2.0}
    quantities = ("friction_coefficient", "lateral_force_capacity_axle_21")
    before, half, after = (look("semitrailer", ("friction_change",), quantities, own, time=t) for t in (5.0, 6.0, 7.0))
    assert [before[0], half[0], after[0]] == pytest.approx([0.9, 0.7, 0.5])
    assert after[1] == pytest.approx(5 / 9 * before[1])
    gone = look("semitrailer", ("friction_change",), quantities, {**own, "friction_change": -1.5}, time=9.0)
    assert gone[0] > 0


# --- air


def test_a_gust_pushes_between_onset_and_end_only():
    own = {
        "crosswind_force_trailer": 5e3,
        "crosswind_moment_tractor": -2e3,
        "crosswind_onset": 3.0,
        "crosswind_end": 6.0,
    }
    quantities = ("external_lateral_force_trailer", "external_yaw_moment_tractor", "external_lateral_force_tractor")
    for time, share in ((2.9, 0.0), (3.1, 0.5), (4.0, 1.0), (6.0, 1.0), (6.1, 0.5), (6.3, 0.0)):
        found = look("semitrailer", ("crosswind",), quantities, own, time=time)
        assert found == pytest.approx([share * 5e3, -share * 2e3, 0.0])


def test_still_air_takes_energy_out_of_lateral_motion():
    own = {"aerodynamic_side_force": 3.0}
    for v_y in (-1.5, 0.8):
        (force,) = look("car", ("aerodynamic_side_force",), ("external_lateral_force",), own, lateral_velocity=v_y)
        assert force == pytest.approx(-3.0 * 20.0 * v_y)
        assert force * v_y < 0


# --- steering


def test_offset_and_ratio_of_the_steering():
    ratio = VALUES["car"]["steering_ratio"]
    (offset,) = look(
        "car", ("steering_offset",), ("road_wheel_angle",), {"steering_offset": 0.01}, steering_wheel_angle=1.0
    )
    (slower,) = look(
        "car", ("steering_ratio",), ("road_wheel_angle",), {"steering_ratio_error": 0.25}, steering_wheel_angle=1.0
    )
    assert offset == pytest.approx(1 / ratio + 0.01)
    assert slower == pytest.approx(1 / (1.25 * ratio))


@pytest.mark.parametrize("progression", [-0.8, 0.5, 3.0])
def test_a_progressive_ratio_is_odd_monotonic_and_reaches_its_gain(progression):
    own = {"steering_progression": progression, "steering_centre_width": 0.05}
    ratio = VALUES["car"]["steering_ratio"]
    wheel = np.linspace(-1.0, 1.0, 201)

    def f(angle: float) -> float:
        at = {"steering_wheel_angle": angle * ratio}
        return look("car", ("steering_ratio_nonlinear",), ("road_wheel_angle",), own, **at)[0]

    angle = np.array([f(d) for d in wheel])
    assert angle == pytest.approx(-angle[::-1])
    assert (np.diff(angle) > 0).all()
    assert angle[-1] == pytest.approx((1 + progression) * 1.0, rel=0.01)
    assert f(0.05) == pytest.approx(0.05 * (1 + progression / 2))


def follow(effect: str, own: dict, wheel: np.ndarray, step: float, tyre: str = "linear") -> np.ndarray:
    """Return the road-wheel angle over time for one of the steering wheel, of a car at rest otherwise."""
    model = built("car", (effect,), tyre)
    numbers = values(model, "car", **own)
    f, angle = evaluator(model, numbers), evaluator(model, numbers, ("road_wheel_angle",))
    inputs = np.array([point(model, steering_wheel_angle=w, speed=2.0)[1] for w in wheel])
    x = euler(f, point(model)[0], inputs, step)
    return np.array([angle(state, u)[0] for state, u in zip(x, inputs, strict=True)])


@pytest.mark.parametrize("effect", ["steering_lag", "steering_delay"])
@pytest.mark.parametrize("amount", [0.0, 0.02, 0.1, 0.2])
def test_lag_and_delay_have_gain_and_phase_of_their_names(effect, amount):
    """Measured at 1 Hz, where a driver steers; exact at zero."""
    step, omega, ratio = 1e-3, 2 * np.pi, VALUES["car"]["steering_ratio"]
    time = np.arange(0, 4, step)
    angle = follow(effect, {effect: amount}, ratio * np.sin(omega * time), step)[-1000:]
    gain = 2 * np.mean(angle * np.exp(-1j * omega * time[-1000:])) * 1j
    wanted = 1 / (1 + 1j * omega * amount) if effect == "steering_lag" else np.exp(-1j * omega * amount)
    assert abs(gain - wanted) < (1e-9 if amount == 0 else 0.02)


@pytest.mark.parametrize("effect", ["steering_lag", "steering_delay", "sensor_delay@yaw_rate", "tyre_relaxation"])
@pytest.mark.parametrize("amount", [0.0, 0.01, 0.3])
def test_states_of_lags_are_stable_in_steps_of_ten_milliseconds(effect, amount):
    model = built("car", (effect,), "linear")
    name = next(n for n in model.parameter_names if n.startswith(effect.partition("@")[0]))
    own = dict.fromkeys([n for n in model.parameter_names if n.startswith(name[:12])], amount)
    f = evaluator(model, values(model, "car", **{n: v for n, v in own.items() if n not in VALUES["car"]}))
    x, u = point(model, speed=35.0)
    A = np.eye(len(x)) + 0.01 * jacobian(f, x, u, np.ones(len(x)))
    assert np.abs(np.linalg.eigvals(A)).max() < 1.0


def test_compliant_steering_yields_to_the_force_and_lessens_the_turn():
    model = built("car", ("steering_compliance",), "linear")
    _, u = point(model, steering_wheel_angle=0.5)
    turn = {}
    for compliance in (0.0, 2e-6):
        numbers = values(model, "car", steering_compliance=compliance)
        x = euler(evaluator(model, numbers), point(model)[0], np.tile(u, (1500, 1)), 0.005)[-1]
        force, angle = evaluator(model, numbers, ("lateral_force_steered_axle", "road_wheel_angle"))(x, u)
        turn[compliance] = x[model.states.index("yaw_rate")]
        assert angle == pytest.approx(0.5 / VALUES["car"]["steering_ratio"] - compliance * force, rel=1e-3)
    assert 0 < turn[2e-6] < turn[0.0]


def test_play_is_crossed_on_every_reversal_and_only_there():
    half, step = 0.01, 1e-3
    time = np.arange(0, 8, step)
    wheel = 0.05 * np.sin(2 * np.pi * 0.25 * time)
    angle = follow("steering_backlash", {"steering_backlash": half}, wheel * VALUES["car"]["steering_ratio"], step)
    late = time > 4
    lost = wheel - angle
    assert np.abs(lost).max() <= half
    rising, falling = np.gradient(wheel) > 1e-5, np.gradient(wheel) < -1e-5
    middle = late & (np.abs(wheel) < 0.005)
    assert lost[middle & rising] == pytest.approx(half, rel=0.15)  # pushed from below: the wheels are behind
    assert lost[middle & falling] == pytest.approx(-half, rel=0.15)
    area = np.sum((angle[late] - wheel[late]) * np.gradient(wheel[late]))
    assert area < -3 * half * 0.05  # a loop of hysteresis, of height 2 b and about 0.1 wide


# --- coupling


@pytest.mark.parametrize(("effect", "size"), [("kingpin_friction", 8e3), ("kingpin_damping", 2e4)])
def test_the_kingpin_takes_energy_from_turning_and_acts_on_both_bodies(effect, size):
    for rate in (-0.2, 0.3):
        at = {"yaw_rate_tractor": 0.1, "yaw_rate_trailer": 0.1 + rate}
        (moment,) = look("semitrailer", (effect,), ("coupling_moment",), {effect: size}, **at)
        assert moment * rate < 0
    assert abs(moment) == pytest.approx(8e3 if effect == "kingpin_friction" else 2e4 * 0.3)
    still = {"yaw_rate_tractor": 0.1, "yaw_rate_trailer": 0.1}
    assert look("semitrailer", (effect,), ("coupling_moment",), {effect: size}, **still) == pytest.approx([0.0])


# --- loads


def loads(vehicle: str, effects: tuple[str, ...], own: dict, **at) -> np.ndarray:
    axles = registry.load("models.vehicles", vehicle).AXLES
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


# --- axles and tyres


def test_an_axle_that_steers_itself_loses_slip_and_one_that_rolls_steers_into_the_bend():
    name = ("slip_angle_axle_23",)
    at = {"lateral_velocity_trailer": 0.4, "yaw_rate_trailer": 0.1}
    (plain,) = look("semitrailer", ("self_steering_axle",), name, {}, **at)
    (half,) = look("semitrailer", ("self_steering_axle",), name, {"self_steering_23": 0.5}, **at)
    (rolled,) = look("semitrailer", ("roll_steer",), name, {"roll_steer_2": 0.002}, **at)
    assert half == pytest.approx(plain / 2)
    assert rolled == pytest.approx(plain + 0.002 * 0.1 * 20.0)


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
    own = {"combined_slip_12": (share / mu) ** 2}
    at = {"lateral_velocity_tractor": -0.3}
    found = {
        a: look("semitrailer", ("combined_slip",), name, own, drive_speed=20.0 - 0.15 * a, **at)[0]
        for a in (-1.0, 0.0, 1.0)
    }
    F_x = v["tractor_mass"] + v["trailer_mass"]
    F_z = loads("semitrailer", ("combined_slip",), {}, drive_speed=20.0)[1]
    assert found[1.0] == pytest.approx(found[-1.0])
    assert found[1.0] / found[0.0] == pytest.approx(np.sqrt(1 - (F_x / (mu * F_z)) ** 2), rel=0.01)


# --- bodies


def test_yaw_control_turns_towards_its_reference():
    own = {"yaw_control_gain": 5e4, "yaw_control_speed": 20.0}
    ratio, length = (
        VALUES["car"]["steering_ratio"],
        VALUES["car"]["cog_to_front_axle"] + VALUES["car"]["cog_to_rear_axle"],
    )
    reference = 20.0 * 0.02 / (length * 2)
    for r in (0.0, reference, 2 * reference):
        at = {"steering_wheel_angle": 0.02 * ratio, "yaw_rate": r}
        (moment,) = look("car", ("yaw_moment_control",), ("external_yaw_moment",), own, **at)
        assert moment == pytest.approx(5e4 * (reference - r), abs=1e-6)


SLOSH = {"slosh_share_trailer": 0.3, "slosh_frequency_trailer": 3.0, "slosh_damping_trailer": 0.05}


def test_liquid_that_leans_in_a_steady_bend_weighs_as_if_it_were_solid():
    """At rest against the wall, y = -a / omega^2, the whole mass accelerates at a under the tyres' force."""
    solid = look(
        "semitrailer",
        ("liquid_slosh@trailer",),
        ("lateral_acceleration_trailer",),
        {**SLOSH, "slosh_share_trailer": 0.0},
        lateral_force_axle_21=1e4,
    )[0]
    at = {"lateral_force_axle_21": 1e4, "slosh_displacement_trailer": -solid / 3.0**2}
    (liquid,) = look("semitrailer", ("liquid_slosh@trailer",), ("lateral_acceleration_trailer",), SLOSH, **at)
    assert liquid == pytest.approx(solid)
    assert rates("semitrailer", ("liquid_slosh@trailer",), SLOSH, **at)["slosh_velocity_trailer"] == pytest.approx(
        0.0, abs=1e-9
    )
    quick = look(
        "semitrailer", ("liquid_slosh@trailer",), ("lateral_acceleration_trailer",), SLOSH, lateral_force_axle_21=1e4
    )[0]
    assert quick > solid  # the liquid stays behind: less mass to move


def test_liquid_neither_gains_nor_loses_momentum():
    """With every tyre force zero, the lateral momentum of both bodies and the liquid does not change."""
    v = VALUES["semitrailer"]
    at = {"slosh_displacement_trailer": 0.2, "slosh_velocity_trailer": -0.3}
    found = rates("semitrailer", ("liquid_slosh@trailer",), SLOSH, **at)
    solid = (1 - 0.3) * v["trailer_mass"] * found["lateral_velocity_trailer"]
    liquid = 0.3 * v["trailer_mass"] * (found["lateral_velocity_trailer"] + found["slosh_velocity_trailer"])
    tractor = v["tractor_mass"] * found["lateral_velocity_tractor"]
    assert solid + liquid + tractor == pytest.approx(0.0, abs=1e-6 * v["trailer_mass"])
    assert abs(solid) > 1.0


# --- sensors


def test_errors_of_sensors_are_in_the_reading_only():
    at = {"yaw_rate_trailer": 0.2, "yaw_rate_tractor": 0.1, "articulation_angle": 0.05}
    cases = {
        "sensor_bias": ({"sensor_bias_yaw_rate_trailer": 0.01}, 0.21),
        "sensor_gain": ({"sensor_gain_error_yaw_rate_trailer": 0.1}, 0.22),
        "sensor_gain_speed": ({"sensor_speed_loss_yaw_rate_trailer": 1 / 200}, 0.2 * (1 - 20 / 200)),
    }
    for effect, (own, reading) in cases.items():
        assert look("semitrailer", (effect,), ("sensor_yaw_rate_trailer",), own, **at) == pytest.approx([reading])
        assert rates("semitrailer", (effect,), own, **at) == rates("semitrailer", (effect,), {}, **at)


def test_a_lever_arm_follows_rigid_body_kinematics():
    """The reading equals that of the axle it is moved to, differentiated along a run."""
    model = built("car", ("sensor_lever_arm",))
    arm = {"sensor_lever_arm_lateral_acceleration": 1.2, "sensor_lever_arm_lateral_velocity": 1.2}
    numbers = values(model, "car", **arm)
    f = evaluator(model, numbers)
    read = evaluator(model, numbers, ("sensor_lateral_acceleration", "sensor_lateral_velocity"))
    x, u = point(model, lateral_velocity=0.3, yaw_rate=0.2, steering_wheel_angle=0.6)
    h = 1e-5
    ahead, behind = read(x + h * f(x, u), u)[1], read(x - h * f(x, u), u)[1]
    w = x[model.states.index("yaw_rate")]
    assert read(x, u)[1] == pytest.approx(0.3 + 1.2 * w)
    assert read(x, u)[0] == pytest.approx((ahead - behind) / (2 * h) + w * 20.0, rel=1e-6)


def test_a_leaning_accelerometer_reads_more_in_a_bend_and_settles_in_time():
    own = {"roll_gain": 0.01, "roll_frequency": 8.0}
    steady = {"leaning_lateral_acceleration": 3.0, "lateral_velocity": -0.5}
    reading, true = look(
        "car", ("accelerometer_roll",), ("sensor_lateral_acceleration", "lateral_acceleration"), own, **steady
    )
    assert reading == pytest.approx(true * np.cos(0.03) + G * np.sin(0.03))
    still = {"leaning_lateral_acceleration": true, "lateral_velocity": -0.5}
    moved = rates("car", ("accelerometer_roll",), own, **still)
    assert moved["leaning_rate_lateral_acceleration"] == pytest.approx(0.0, abs=1e-9)


# --- symmetry


EVEN = {"time", "speed", "pitch_speed", "drive_speed", "longitudinal_velocity", "friction_coefficient"}
LEANS_TO_ONE_SIDE = {
    "crosswind",
    "road_bank",
    "steering_offset",
    "tyre_force_offset",
    "sensor_bias",
    "road_bank_varying",
    "road_bank_measured",
}


@pytest.mark.parametrize("effect", [e for e in registry.names("models.effects") if e not in LEANS_TO_ONE_SIDE])
def test_effects_without_a_side_are_mirrored(effect):
    """Left and right exchanged, every lateral quantity changes its sign and nothing else does."""
    for vehicle in ("semitrailer", "car"):
        for tyre in ("magic_formula", "linear"):
            try:
                model = built(vehicle, (effect,), tyre)
            except ValueError:
                continue
            rng = np.random.default_rng(3)
            added = [p for p in model.parameters if p.name not in VALUES[vehicle]]
            own = {p.name: p.lower + rng.uniform(0.6, 0.7) * (p.upper - p.lower) for p in added}
            f = evaluator(model, values(model, vehicle, **own))
            odd_x, odd_u = (
                np.array([1.0 if n in EVEN or n.startswith("pitch") else -1.0 for n in part])
                for part in (model.states, model.inputs)
            )
            odd_u[[i for i, n in enumerate(model.inputs) if n == "speed_rate"]] = 1.0
            x, u = rng.uniform(-0.3, 0.3, len(odd_x)), rng.uniform(0.1, 0.3, len(odd_u))
            u[list(model.inputs).index("speed")] = 15.0
            assert f(odd_x * x, odd_u * u) == pytest.approx(odd_x * f(x, u), rel=1e-9, abs=1e-9)
            return
    pytest.skip("fits neither vehicle")
