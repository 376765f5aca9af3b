"""Effects of moving bodies and sensors against physics: momentum, lever arms; left and right mirrored for all."""

from __future__ import annotations

import numpy as np
import pytest

from harness.models.roles import EFFECTS
from support.effects import VALUES, G, built, look, point, rates, values
from support.numeric import evaluator


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


def test_a_sensor_that_is_turned_reads_a_part_of_what_lies_across():
    """Turned to the left by 0.05 rad; the vehicle brakes, the speed behind its lag of 50 ms is 0.2 m/s higher."""
    names, turned = ("lateral_acceleration", "lateral_velocity"), (np.cos(0.05), np.sin(0.05))
    own = {f"sensor_misalignment_{name}": 0.05 for name in names}
    at = {"misaligned_speed_lateral_acceleration": 20.2, "lateral_velocity": -0.5, "yaw_rate": 0.2}
    read = (*names, *(f"sensor_{name}" for name in names))
    a, v, read_a, read_v = look("car", ("sensor_misalignment",), read, own, **at)
    assert read_a == pytest.approx(turned[0] * a + turned[1] * 4.0)
    assert read_v == pytest.approx(turned[0] * v - turned[1] * 20.0)
    own = {"sensor_misalignment_longitudinal_acceleration": 0.05}
    names = ("lateral_acceleration", "longitudinal_acceleration", "sensor_longitudinal_acceleration")
    a, along, reading = look("car_two_track", ("sensor_misalignment",), names, own, lateral_force_axle_fl=6e3)
    assert a > 1.0
    assert reading == pytest.approx(turned[0] * along + turned[1] * a)


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


def test_an_accelerometer_dives_with_the_nose_of_a_car_that_brakes():
    """Behind the pitch: 4 m/s^2 of braking make 0.02 rad, by which the reading is lower, and the body settles there."""
    own = {"pitch_gain": 0.005, "pitch_frequency": 8.0}
    names, braked = ("sensor_longitudinal_acceleration", "longitudinal_acceleration"), {"speed": 15.0}
    at = {**braked, "leaning_longitudinal_acceleration": -4.0}
    reading, true = look("car_two_track", ("accelerometer_pitch",), names, own, **at)
    assert true < -1.0
    assert reading == pytest.approx(true * np.cos(0.02) - G * np.sin(0.02))
    still = {**braked, "leaning_longitudinal_acceleration": true}
    moved = rates("car_two_track", ("accelerometer_pitch",), own, **still)
    assert moved["leaning_rate_longitudinal_acceleration"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("effect", "state", "sign"), [("brake_pull", "brake_speed", 1), ("drive_pull", "pull_speed", -1)]
)
def test_what_pulls_at_one_side_turns_the_body_by_force_times_offset(effect, state, sign):
    """To the left of the middle brakes turn to the left and a drive to the right; the other one does nothing."""
    own, name = {effect: 0.1}, ("external_yaw_moment",)
    ahead = {state: 20.0 + sign * 0.15 * 3.0}  # 3 m/s^2 of braking or driving, behind the lag
    mass = VALUES["car"]["mass"]
    assert look("car", (effect,), name, own, **ahead) == pytest.approx([sign * 0.1 * mass * 3.0])
    assert look("car", (effect,), name, own, **{state: 20.0 - sign * 0.45}) == pytest.approx([0.0])


def test_each_body_of_a_truck_brakes_for_itself_and_the_tractor_drives_all():
    v, names = VALUES["semitrailer"], ("external_yaw_moment_tractor", "external_yaw_moment_trailer")
    at = {"speed_tractor": 20.0, "brake_speed_tractor": 20.3, "brake_speed_trailer": 20.3}
    braked = look("semitrailer", ("brake_pull",), names, {"brake_pull_trailer": 0.1}, **at)
    assert braked == pytest.approx([0.0, 0.1 * v["trailer_mass"] * 2.0])
    (driven, _) = look("semitrailer", ("drive_pull",), names, {"drive_pull": 0.1}, pull_speed=19.7)
    assert driven == pytest.approx(-0.1 * (v["tractor_mass"] + v["trailer_mass"]) * 2.0)


EVEN = {
    "time",
    "speed",
    "pitch_speed",
    "drive_speed",
    "brake_speed",
    "pull_speed",
    "longitudinal_velocity",
    "friction_coefficient",
    "speed_delayed",
    "speed_delayed_rate",
}
LEANS_TO_ONE_SIDE = {
    "brake_pull",
    "drive_pull",
    "tyre_curvature",
    "crosswind",
    "road_bank",
    "steering_offset",
    "tyre_force_offset",
    "sensor_bias",
    "sensor_misalignment",
    "road_bank_varying",
    "road_bank_measured",
    "steady_wind",
}


@pytest.mark.parametrize("effect", [e for e in EFFECTS.names() if e not in LEANS_TO_ONE_SIDE])
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
