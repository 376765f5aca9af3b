"""Effects in ``[plant]`` and ``[belief]``: places, values with units, neutral defaults, their noise, and errors."""

from __future__ import annotations

import pytest

from harness.configure.parameter_set import set_from_file
from harness.configure.vehicle import resolve_single
from harness.errors import UserError


def plant(effects: list[str], **values: object):
    table = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "linear", "sensors": "test_vehicle"}
    return resolve_single({**table, "effects": effects, "values": values}, "[plant]")


def test_values_of_effects_are_stated_by_place_with_units_and_are_neutral_otherwise():
    moments = {"crosswind_onset": "20 s", "crosswind_end": "24 s"}
    spec = plant(["crosswind", "sensor_bias@yaw_rate_trailer"], crosswind_force_trailer="6 kN", **moments)
    assert spec.values["crosswind_force_trailer"] == pytest.approx(6000.0)
    assert spec.values["crosswind_force_tractor"] == 0.0
    assert spec.values["sensor_bias_yaw_rate_trailer"] == 0.0
    assert spec.model().effects == ("crosswind", "sensor_bias@yaw_rate_trailer")


def test_an_angle_of_a_sensor_takes_degrees():
    spec = plant(["sensor_bias@articulation_angle"], sensor_bias_articulation_angle="1 deg")
    assert spec.values["sensor_bias_articulation_angle"] == pytest.approx(0.0174533, rel=1e-5)


def test_the_process_of_a_varying_bank_has_its_noise_and_a_lag_has_none():
    spec = plant(["road_bank_varying", "steering_lag"], bank_memory="5 s")
    assert spec.process_noise["bank_walk"] == pytest.approx(1.0 * spec.step)
    assert spec.process_noise["steering_lagged"] == 0.0


@pytest.mark.parametrize(
    ("effects", "values", "says"),
    [
        (["crosswind@trailor"], {}, "has no place 'trailor' on 'semitrailer'; closest: trailer"),
        (["crosswind"], {}, "no value for crosswind_onset, crosswind_end"),
        (["sensor_bias@yaw_rate_trailer"], {"sensor_bias_yaw_rate_trailer": "1 m"}, "sensor_bias_yaw_rate_trailer"),
        (["sensor_bias@yaw_rate_trailer"], {"sensor_bias_yaw_rate_trailer": "90 deg/s"}, "above 0.3 rad/s"),
        (["steering_lag@11"], {}, "acts on the whole vehicle"),
    ],
)
def test_errors_name_the_place(effects, values, says):
    with pytest.raises(UserError) as caught:
        plant(effects, **values)
    assert says in str(caught.value)


def test_a_parameter_file_may_hold_what_an_identification_found_for_effects(tmp_path):
    path = tmp_path / "found.toml"
    path.write_text(
        'vehicle = "semitrailer"\nnoise_step = "10 ms"\n[values]\n'
        'crosswind_force_trailer = "2 kN"\naxle_lift_23 = 0.5\nsensor_bias_yaw_rate_trailer = "1 deg/s"\n'
    )
    found = set_from_file("found.toml", tmp_path, "[plant]").values
    assert found["crosswind_force_trailer"] == pytest.approx(2000.0)
    assert found["sensor_bias_yaw_rate_trailer"] == pytest.approx(0.01745, rel=1e-3)
