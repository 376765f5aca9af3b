"""A body that rolls, against the equations of the mass above a roll axis, written out and integrated here."""

from __future__ import annotations

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.engine.compile import compile_model
from harness.engine.kernel_names import LANES
from harness.models.assembly.assemble import assemble
from support.effects import VALUES, G, built, look, point, rates, values
from support.numeric import euler, evaluator

SPRUNG, ABOVE_AXIS, INERTIA, STIFFNESS, DAMPING = 1900.0, 0.5, 900.0, 9e4, 5e3
"""kg; m from the roll axis to the CoG of the sprung mass; kg m^2 about that CoG; N m/rad of the springs; N m s/rad."""

SPEED, STEP = 25.0, 5e-4


def steering(time: np.ndarray) -> np.ndarray:
    """Return a road-wheel angle that steps and then weaves about the roll's frequency."""
    return 0.01 * (time > 0.2) + 0.01 * np.sin(2 * np.pi * 1.3 * time)


def by_hand(angle: np.ndarray) -> dict[str, np.ndarray]:
    """Integrate lateral velocity of the roll axis, yaw rate, roll angle and rate of a car on linear tyres."""
    v = VALUES["car"]
    m, l_f, l_r = v["mass"], v["cog_to_front_axle"], v["cog_to_rear_axle"]
    weight = m * G / (l_f + l_r)
    C_f, C_r = (
        v[f"stiffness_peak_{end}"] * np.sin(2 * np.arctan(load / v[f"stiffness_load_{end}"]))
        for end, load in (("front", weight * l_r), ("rear", weight * l_f))
    )
    moment = SPRUNG * ABOVE_AXIS
    mass_matrix = np.array([[m, -moment], [-moment, INERTIA + moment * ABOVE_AXIS]])
    v_y = r = roll = roll_rate = 0.0
    rows = []
    for delta in angle:
        F_f = C_f * np.tan(delta - np.arctan((v_y + l_f * r) / SPEED)) * np.cos(delta)
        F_r = C_r * np.tan(-np.arctan((v_y - l_r * r) / SPEED))
        axis, roll_acceleration = np.linalg.solve(
            mass_matrix, [F_f + F_r, -(STIFFNESS - moment * G) * roll - DAMPING * roll_rate]
        )
        rows.append((v_y - moment / m * roll_rate, r, roll, (F_f + F_r) / m))
        v_y += STEP * (axis - r * SPEED)
        r += STEP * (l_f * F_f - l_r * F_r) / v["yaw_inertia"]
        roll, roll_rate = roll + STEP * roll_rate, roll_rate + STEP * roll_acceleration
    return dict(zip(("lateral_velocity", "yaw_rate", "roll", "acceleration"), np.array(rows).T, strict=True))


def own() -> dict[str, float]:
    """Return the parameters of the effect for the body above (``_body_roll``)."""
    m, moment = VALUES["car"]["mass"], SPRUNG * ABOVE_AXIS
    stiffness = STIFFNESS - moment * G
    inertia = INERTIA + moment * ABOVE_AXIS - moment**2 / m
    gain = moment / stiffness
    return {
        "body_roll_gain": gain,
        "body_roll_sway": gain * moment / m,
        "body_roll_frequency": np.sqrt(stiffness / inertia),
        "body_roll_damping": DAMPING / (2 * np.sqrt(stiffness * inertia)),
    }


def run(**changed: float) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the run by hand, and yaw rate, lateral velocity and reading of the effect's model."""
    time = np.arange(0, 4, STEP)
    model = built("car", ("body_roll",), "linear")
    numbers = values(model, "car", **{**own(), **changed})
    x, u = point(model, speed=SPEED)
    inputs = np.tile(u, (len(time), 1))
    inputs[:, model.inputs.index("steering_wheel_angle")] = steering(time) * VALUES["car"]["steering_ratio"]
    states = euler(evaluator(model, numbers), x, inputs, STEP)
    look_at = evaluator(model, numbers, ("yaw_rate", "lateral_velocity", "sensor_lateral_acceleration"))
    return by_hand(steering(time)), np.array([look_at(*row) for row in zip(states, inputs, strict=True)])


def test_a_rolling_body_moves_as_a_mass_above_a_roll_axis():
    truth, found = run()
    reading = truth["acceleration"] * np.cos(truth["roll"]) + G * np.sin(truth["roll"])
    for column, wanted in zip(found.T, (truth["yaw_rate"], truth["lateral_velocity"], reading), strict=True):
        assert np.abs(column - wanted).max() < 0.004 * np.abs(wanted).max()
    assert np.abs(truth["roll"]).max() > np.radians(1)


def test_a_body_that_does_not_sway_is_told_apart():
    truth, found = run(body_roll_sway=0.0)
    assert np.abs(found[:, 0] - truth["yaw_rate"]).max() > 0.02 * np.abs(truth["yaw_rate"]).max()


def test_each_body_of_a_truck_rolls_by_itself_and_moves_its_own_axles():
    names = ("slip_angle_axle_12", "slip_angle_axle_23")
    at = {"body_leaning_rate_trailer": 2.0}
    shapes = {f"body_roll_{name}_{body}": 1.0 for name in ("frequency", "damping") for body in ("tractor", "trailer")}
    plain = look("semitrailer", ("body_roll",), names, shapes, **at)
    rolling = look("semitrailer", ("body_roll",), names, {**shapes, "body_roll_sway_trailer": 0.015}, **at)
    assert rolling - plain == pytest.approx([0.0, -0.015 * 2.0 / 20.0])


def test_a_trailer_that_rolls_is_tied_at_its_roll_axis():
    """The accelerations are those of two bodies, one with a mass above its roll axis, and of what ties them."""
    model = built("semitrailer", ("body_roll",))
    v = VALUES["semitrailer"]
    m_1, J_1, h_1, m_2 = (
        v[n] for n in ("tractor_mass", "tractor_yaw_inertia", "tractor_cog_to_kingpin", "trailer_mass")
    )
    J_2 = v["trailer_inertia_scale"] * m_2 * (v["trailer_track"] ** 2 + v["trailer_length"] ** 2) / 12
    a_1, b_1 = v["tractor_cog_to_front_axle"], v["tractor_cog_to_rear_axle"]
    a_2 = v["kingpin_from_rear"] - v["trailer_cog_from_rear"]
    b_2 = np.array([v["trailer_cog_from_rear"] - v[f"axle_{axle}_from_rear"] for axle in ("21", "22", "23")])
    moment, inertia, stiffness, damping = 0.8 * m_2 * 1.2, 6e4, 2e6, 8e4  # of the trailer, about its roll axis
    reduced, gain = inertia - moment**2 / m_2, moment / stiffness
    own = {
        "body_roll_sway_trailer": gain * moment / m_2,
        "body_roll_frequency_trailer": np.sqrt(stiffness / reduced),
        "body_roll_damping_trailer": damping / (2 * np.sqrt(stiffness * reduced)),
    }
    leaning, leaning_rate, w_1, w_2, v_2 = 2.0, 3.0, 0.2, 0.3, 0.5
    F = np.array([9e3, -4e3, 5e3, 7e3, -2e3])
    forces = {f"lateral_force_axle_{axle}": force for axle, force in zip(model.axles, F, strict=True)}
    sway = own["body_roll_sway_trailer"] * leaning_rate
    motion = {"yaw_rate_tractor": w_1, "yaw_rate_trailer": w_2, "lateral_velocity_trailer": v_2, "speed": SPEED}
    motion |= {"lateral_velocity_tractor": h_1 * w_1 + v_2 + a_2 * w_2 + sway}  # as tied
    lean = {"body_leaning_trailer": leaning, "body_leaning_rate_trailer": leaning_rate}
    shapes = {"body_roll_frequency_tractor": 9.0, "body_roll_damping_tractor": 0.4, "constraint_rate": 0.0}
    moves = rates("semitrailer", ("body_roll",), {**own, **shapes}, **forces, **motion, **lean)

    # Lateral (of the trailer at its roll axis) and yaw acceleration of both, roll acceleration, coupling force.
    sums = [F[0] + F[1], a_1 * F[0] - b_1 * F[1], F[2:].sum(), -b_2 @ F[2:]]
    springs = -(stiffness * leaning + damping * leaning_rate) * gain
    equations = np.diag([m_1, J_1, m_2, J_2, inertia, 0.0])
    equations[2, 4] = equations[4, 2] = -moment
    equations[:5, 5] = equations[5, :5] = [1.0, -h_1, -1.0, -a_2, 0.0]
    A_1, yaw_1, A_2, yaw_2, roll, _ = np.linalg.solve(equations, [*sums, springs, 0.0])
    wanted = {
        "lateral_velocity_tractor": A_1 - w_1 * SPEED,
        "yaw_rate_tractor": yaw_1,
        "lateral_velocity_trailer": A_2 - moment / m_2 * roll - w_2 * SPEED,
        "yaw_rate_trailer": yaw_2,
        "body_leaning_rate_trailer": roll / gain,
    }
    assert {name: moves[name] for name in wanted} == pytest.approx(wanted, rel=1e-9)


def test_a_tie_with_a_trailer_that_rolls_and_is_turned_stays_or_is_restored():
    model = built("semitrailer", ("body_roll",))
    shapes = {f"body_roll_{name}_{body}": 3.0 for name in ("frequency", "damping") for body in ("tractor", "trailer")}
    numbers = values(model, "semitrailer", **shapes, body_roll_sway_trailer=0.02, constraint_rate=7.0)
    at = dict(zip(model.states, np.random.default_rng(5).uniform(-1, 1, len(model.states)), strict=True))
    x, u = point(model, **at | {"articulation_angle": 0.4}, speed=SPEED)
    violation = evaluator(model, numbers, ("constraint_violation",))
    step = 1e-5 * evaluator(model, numbers)(x, u)
    change = (violation(x + step, u) - violation(x - step, u)) / 2e-5
    assert change == pytest.approx(-7.0 * violation(x, u), rel=1e-6)


def test_a_car_that_rolls_already_is_refused():
    with pytest.raises(ModelError, match="rolls already"):
        built("car_two_track", ("body_roll",))


def test_roll_steer_and_load_transfer_follow_a_body_that_rolls():
    """The axle's own states begin and move as those of the body; the transfer is that of what leans, not of ``v w``."""
    files = ("body_roll", "roll_steer", "lateral_load_transfer")
    model = built("car", files)
    transfer = {f"lateral_transfer_loss_{axle}": 0.5 for axle in ("front", "rear")}
    steer = {"roll_steer_rear": 0.002, "roll_steer_frequency_rear": 2.0, "roll_steer_frequency_front": 2.0}
    numbers = values(model, "car", **own(), **transfer, **steer)
    x, u = point(model, speed=SPEED, steering_wheel_angle=0.4)
    run = euler(evaluator(model, numbers), x, np.tile(u, (1000, 1)), 1e-3)
    column = {name: run[:, model.states.index(name)] for name in model.states}
    assert np.abs(column["body_leaning"]).max() > 1.0
    np.testing.assert_array_equal(column["roll_steer_leaning_rear"], column["body_leaning"])
    names = tuple(f"lateral_force_capacity_axle_{axle}" for axle in ("front", "rear"))
    plain = look("car", ("body_roll",), names, own())
    late = look("car", files, names, {**own(), **transfer, **steer}, body_leaning=3.0, yaw_rate=0.4)
    assert late == pytest.approx(np.array(plain) / (1 + 0.5 * (3.0 / G) ** 2))


def test_what_may_be_absent_takes_the_roll_of_the_body_where_it_is_there():
    parts = ("car", "magic_formula", ("body_roll", "roll_steer", "lateral_load_transfer"), "car_navigation")
    stated, optional = assemble(*parts), compile_model(assemble(*parts, optional=True), jacobians=False)
    shapes = {"roll_steer_frequency_rear": 3.0, "roll_steer_frequency_front": 3.0, **own()}
    there = {**shapes, "lateral_transfer_loss_rear": 0.5, "roll_steer_rear": 0.002, "roll_steer_front": 0.001}
    alone = {**there, "body_roll_gain": 0.0, "body_roll_sway": 0.0}
    without = assemble(parts[0], parts[1], parts[2][1:], parts[3])
    at = {"body_leaning": 3.0, "body_leaning_rate": 0.5, "yaw_rate": 0.3, "roll_steer_leaning_rear": 2.0}
    for numbers, reference in ((there, stated), (alone, without)):
        numbers = values(optional.model, "car", **numbers)
        x, u = point(optional.model, **at)
        work = np.empty((optional.nw, LANES))
        following = np.empty((optional.nx, LANES))
        lanes = [np.repeat(part[:, None], LANES, axis=1) for part in (x, u, optional.parameter_vector(numbers))]
        optional.kernels.next_state(lanes[0], lanes[1], optional.constants(lanes[2]), following, work)
        rate = dict(zip(optional.model.states, (following[:, 0] - x) / 0.01, strict=True))
        wanted = evaluator(reference, {n: numbers[n] for n in reference.parameter_names})(*point(reference, **at))
        assert [rate[n] for n in reference.states] == pytest.approx(wanted, rel=1e-9, abs=1e-9)
