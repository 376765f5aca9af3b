"""Sideslip angle as signal, target, sensor and reference of every vehicle whose bodies move."""

import numpy as np
import pytest

import harness as h
from harness.models.assembly.assemble import assemble
from harness.models.roles import VEHICLES
from harness.models.signals import SIGNALS
from harness.testing.parts import evaluate, random_point, tyres_of

CAR = {"parameters": "govindarajan_2018", "sensors": "yaw_rate, lateral_acceleration"}


@pytest.mark.parametrize("name", VEHICLES.names())
def test_it_is_the_direction_of_motion_of_each_body(name):
    built = assemble(name, tyres_of(name)[0])
    rng = np.random.default_rng(0)
    for body, moving in built.bodies.items():
        signal = "sideslip_angle" + (f"_{body}" if body else "")
        assert signal in built.published
        assert SIGNALS[signal].unit == "rad"
        for _ in range(5):
            point = random_point(built, name, rng) | {"speed": 20.0, "longitudinal_velocity": 20.0}
            point |= {s: 0.1 for s in built.states if s.endswith("angle")}
            angle, v_x, v_y = evaluate(built, [built.resolve(signal), moving.speed, moving.lateral_velocity], point)
            if v_x > 0.3 and "sideslip_angle" not in built.states:
                assert angle == pytest.approx(np.arctan2(v_y, v_x), abs=1e-12)


def test_a_model_that_is_not_asked_for_it_has_the_equations_that_it_had():
    assert "sideslip_angle" not in assemble("car", "linear").ports
    assert "sideslip_angle_trailer" not in assemble("semitrailer", "linear").ports


@pytest.fixture(scope="module")
def run():
    drive = h.drive("sine", duration="10 s", amplitude="30 deg")
    return h.simulate(h.model("car", **CAR), drive, signals=["sideslip_angle"], seed=1)


def test_its_reference_follows_from_lateral_velocity_and_speed(run):
    beta = np.arctan2(run.true_lateral_velocity, run.speed)
    np.testing.assert_allclose(run.true_sideslip_angle, beta, atol=1e-12)
    estimates = h.estimate(
        h.model("car", **CAR), run.drop_vars("true_sideslip_angle"), ["ekf"], signals=["sideslip_angle"]
    )
    errors = estimates.errors.xs("sideslip_angle", level="signal")
    assert 0.0 < errors.rmse.item() < 2e-3


def test_a_sensor_of_it_corrects_the_estimate(run):
    noise = {"measurement": {"sideslip_angle": 1e-6}}
    car = h.model("car", parameters="govindarajan_2018", sensors="yaw_rate, sideslip_angle", noise=noise)
    measured = h.simulate(car, h.drive("sine", duration="10 s", amplitude="30 deg"), seed=2)
    assert np.std(measured.sideslip_angle - np.arctan2(measured.true_lateral_velocity, measured.speed)) < 2e-3
    errors = h.estimate(car, measured, ["ekf"]).errors
    assert np.isfinite(errors["rmse"]).all()


def test_a_study_scores_it():
    study = {
        "name": "beta",
        "targets": ["sideslip_angle_tractor", "sideslip_angle_trailer"],
        "plant": {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "series"},
        "belief": {"unknown_inputs": ["steering_wheel_angle"]},
        "estimator": ["ekf"],
        "drive": [{"name": "sine", "kind": "sine", "duration": "10 s"}],
        "design": [{"name": "level", "repeats": 1}],
    }
    from harness.config import build_study

    assert build_study(study, "study.toml").targets == ("sideslip_angle_tractor", "sideslip_angle_trailer")
