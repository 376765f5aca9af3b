"""Effects in ``[plant]`` and ``[belief]``: places, values with units, neutral defaults, their noise, and errors."""

from __future__ import annotations

import dataclasses

import pytest

from harness.common.errors import UserError
from harness.config import load_study
from harness.config.model import resolve_single
from harness.config.parameter_set import set_from_file, set_text
from harness.models.roles import DEGRADATIONS, PARAMETERS


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


FOUND = """vehicle = "semitrailer"
tyre = "{tyre}"
effects = ["kingpin_friction", "sensor_bias@yaw_rate_trailer", "sensor_bias@yaw_rate_tractor"]
noise_step = "10 ms"
[values]
kingpin_friction = 8000.0
kingpin_friction_rate = 0.01
sensor_bias_yaw_rate_trailer = 0.01
sensor_bias_yaw_rate_tractor = 0.02
{values}
"""
STUDY = """name = "found"
targets = ["articulation_angle"]
drive = [{{ name = "s", kind = "sine" }}]
plant = {{ vehicle = "semitrailer", parameters = "found.toml", sensors = "series"{plant} }}
belief = {{ {belief} }}
estimator = [{{ kind = "ekf" }}]
design = [{{ name = "d" }}]
"""


@pytest.fixture
def found(tmp_path):
    """Return a function that loads a study of a parameter file with effects."""
    published = PARAMETERS.load("ziaukas_2023")
    values = "\n".join(f"{n} = {v!r}" for n, v in published.VALUES.items())
    noise = [
        f"[{group}]\n" + "\n".join(f"{n} = {v!r}" for n, v in table.items())
        for group, table in (
            ("process_noise", published.PROCESS_NOISE),
            ("measurement_noise", published.MEASUREMENT_NOISE),
        )
    ]

    def load(plant: str = "", belief: str = "", tyre: str = "magic_formula"):
        (tmp_path / "found.toml").write_text("\n".join([FOUND.format(tyre=tyre, values=values), *noise]))
        (tmp_path / "study.toml").write_text(STUDY.format(plant=plant, belief=belief))
        return load_study(tmp_path / "study.toml")

    return load


def test_the_effects_of_a_parameter_file_are_in_force_where_their_sensors_are(found):
    study = found()
    assert study.plant.effects == study.belief.effects == ("kingpin_friction", "sensor_bias@yaw_rate_trailer")
    assert study.plant.tyre == "magic_formula"
    assert study.plant.values["kingpin_friction"] == 8000.0


def test_a_belief_in_another_set_has_none_of_them_and_effects_that_are_stated_stand(found):
    assert found(belief='parameters = "ziaukas_2023"').belief.effects == ()
    assert found(belief="effects = []").belief.effects == ()
    stated = found(plant=', effects = ["steering_lag"]')
    assert stated.plant.effects == stated.belief.effects == ("steering_lag",)


def test_a_set_that_belongs_to_another_tyre_or_vehicle_is_refused(found):
    with pytest.raises(UserError, match=r"'found\.toml' belong to tyre 'linear', but plant\.tyre is 'magic_formula'"):
        found(plant=', tyre = "magic_formula"', tyre="linear")
    with pytest.raises(UserError, match=r"found\.toml: tyre: unknown tyre 'magic'"):
        found(tyre="magic")
    with pytest.raises(UserError, match=r"belief\.parameters: .* is for vehicle 'car'"):
        found(belief='parameters = "blanco_2021"')


def test_a_model_written_as_a_parameter_file_is_that_model_again(tmp_path):
    spec = plant(["kingpin_friction"], kingpin_friction="5 kN*m", kingpin_friction_rate=0.01, trailer_mass="20 t")
    (tmp_path / "own.toml").write_text(set_text(spec, "a test", {"kingpin_friction": "N*m +- 3"}))
    assert "kingpin_friction = 5000.0 # N*m +- 3\n" in (tmp_path / "own.toml").read_text()
    table = {"vehicle": "semitrailer", "parameters": str(tmp_path / "own.toml")}
    again = resolve_single({**table, "sensors": "test_vehicle"}, "test")
    assert (again.tyre, again.effects, again.values) == (spec.tyre, spec.effects, spec.values)
    assert (again.process_noise, again.measurement_noise) == (spec.process_noise, spec.measurement_noise)
    more = resolve_single({**table, "sensors": "test_vehicle_inertial", "step": "20 ms"}, "test")
    published = PARAMETERS.load("ziaukas_2023")
    acceleration = published.MEASUREMENT_NOISE["lateral_acceleration_tractor"]
    assert more.measurement_noise["lateral_acceleration_tractor"] == acceleration
    assert more.process_noise["yaw_rate_trailer"] == pytest.approx(2 * spec.process_noise["yaw_rate_trailer"])


def test_a_unit_that_is_none_is_blamed_on_the_file_that_declares_it(monkeypatch):
    file = DEGRADATIONS.load("dropout")
    wrong = (dataclasses.replace(file.PARAMETERS[0], unit="foo"), *file.PARAMETERS[1:])
    monkeypatch.setattr(file, "PARAMETERS", wrong)
    with pytest.raises(UserError, match=r"dropout\.py: parameter 'dropout_share': 'foo' is no unit"):
        plant(["dropout"], dropout_share="20 %")
