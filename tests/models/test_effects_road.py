"""Effects of road and air against physics: signs, balances, energy."""

from __future__ import annotations

import numpy as np
import pytest

from harness.models.parameters import ziaukas_2023
from support.effects import G, built, look, point, rates, values
from support.numeric import euler, evaluator


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


@pytest.mark.parametrize(("heading", "pushed"), [(0.0, 3.0), (np.pi / 2, -7.0), (np.pi, -3.0), (-np.pi / 2, 7.0)])
def test_a_wind_over_ground_pushes_from_the_side_that_the_heading_tells(heading, pushed):
    """Towards +x with 7 and towards +y with 3 N s/m; a car that heads for +x has +y to its left."""
    own = {"wind_force_x": 7.0, "wind_force_y": 3.0, "wind_ahead": 0.8}
    ports = ("external_lateral_force", "external_yaw_moment")
    force, moment = look("car", ("steady_wind",), ports, own, heading=heading, speed=20.0)
    assert force == pytest.approx(20.0 * pushed)
    assert moment == pytest.approx(0.8 * force)


def test_a_trailer_meets_the_wind_by_its_own_heading():
    own = {f"wind_{n}_{b}": v for b in ("tractor", "trailer") for n, v in (("force_y", 5.0), ("ahead", 1.0))}
    ports = ("external_lateral_force_tractor", "external_lateral_force_trailer", "speed_tractor")
    folded = {"heading": 0.3, "articulation_angle": np.pi / 2 - 0.3, "speed": 15.0}
    tractor, trailer, speed = look("semitrailer", ("steady_wind",), ports, own, **folded)
    assert tractor == pytest.approx(5.0 * speed * np.cos(0.3))
    assert trailer == pytest.approx(0.0, abs=1e-9)
