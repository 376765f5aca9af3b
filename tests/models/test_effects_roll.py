"""A body that rolls, against the equations of the mass above a roll axis, written out and integrated here."""

from __future__ import annotations

import numpy as np
import pytest

from harness.common.errors import ModelError
from support.effects import VALUES, G, built, look, point, values
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


def test_a_car_that_rolls_already_is_refused():
    with pytest.raises(ModelError, match="rolls already"):
        built("car_two_track", ("body_roll",))
