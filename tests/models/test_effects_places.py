"""Effects at places: which parameters and states they get, and what is refused."""

from __future__ import annotations

import pytest

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble
from harness.models.assembly.candidates import placements
from harness.models.assembly.placement import load_effect
from harness.models.parameters import ziaukas_2023
from support.numeric import evaluator


def added(effects, vehicle="semitrailer", tyre="magic_formula", sensors="test_vehicle"):
    """Return the parameters and states that effects bring along."""
    built, plain = assemble(vehicle, tyre, effects, sensors), assemble(vehicle, tyre, (), sensors)
    return (
        [n for n in built.parameter_names if n not in plain.parameter_names],
        [s for s in built.states if s not in plain.states],
    )


def test_an_effect_has_parameters_for_every_body_and_shares_the_moments():
    parameters, states = added(["crosswind"])
    assert sorted(parameters) == [
        "crosswind_end",
        "crosswind_force_tractor",
        "crosswind_force_trailer",
        "crosswind_moment_tractor",
        "crosswind_moment_trailer",
        "crosswind_onset",
    ]
    assert states == []


def test_a_vehicle_of_one_body_needs_no_suffix():
    parameters, _ = added(["crosswind"], "car", "linear", "car_series")
    assert sorted(parameters) == ["crosswind_end", "crosswind_force", "crosswind_moment", "crosswind_onset"]


def test_a_place_is_chosen_by_its_name():
    parameters, _ = added(["crosswind@trailer"])
    assert "crosswind_force_trailer" in parameters
    assert "crosswind_force_tractor" not in parameters


def test_one_place_after_the_other_equals_both_at_once():
    both, apart = added(["crosswind"])[0], added(["crosswind@tractor", "crosswind@trailer"])[0]
    assert sorted(both) == sorted(apart)


def test_axles_that_share_a_tyre_share_its_effect():
    assert sorted(added(["tyre_stiffness_drift"])[0]) == [f"stiffness_drift_{group}" for group in ("11", "12", "2")]
    own = ("self_steering", "self_steering_lag")
    assert sorted(added(["self_steering_axle"])[0]) == [f"{p}_{a}" for p in own for a in ("11", "12", "21", "22", "23")]


def test_states_belong_to_the_place_too():
    parameters, states = added(["sensor_delay@yaw_rate_trailer"])
    assert parameters == ["sensor_delay_yaw_rate_trailer"]
    assert states == ["delayed_yaw_rate_trailer", "delayed_rate_yaw_rate_trailer"]


def test_a_state_may_be_shared_and_start_where_the_drive_does():
    built = assemble("semitrailer", "magic_formula", ["combined_slip"], "test_vehicle")
    assert [s for s in built.states if "speed" in s] == ["drive_speed"]
    assert built.start["drive_speed"] == "speed"


def test_a_sensor_error_has_the_unit_of_its_signal():
    built = assemble("semitrailer", "linear", ["sensor_bias"], "test_vehicle")
    found = {p.name: p for p in built.parameters if p.name.startswith("sensor_bias")}
    assert found["sensor_bias_articulation_angle"].unit == "rad"
    assert found["sensor_bias_lateral_force_axle_21"].unit == "N"
    assert found["sensor_bias_lateral_force_axle_21"].upper > 1e4 > found["sensor_bias_articulation_angle"].upper


def test_an_effect_may_add_an_input():
    assert "bank_angle" in assemble("car", "linear", ["road_bank_measured"]).inputs
    assert "bank_angle" not in assemble("car", "linear", ["road_bank"]).inputs


def test_a_process_of_an_effect_brings_its_noise():
    assert assemble("car", "linear", ["road_bank_varying"]).noise == {"bank_walk": 1.0}
    drifting = assemble("semitrailer", "linear", ["sensor_drift@yaw_rate_trailer"], "test_vehicle")
    assert drifting.noise == {"drift_yaw_rate_trailer": 0.01}
    assert drifting.start_variance["drift_yaw_rate_trailer"] == 1.0


@pytest.mark.parametrize(
    ("vehicle", "tyre", "effects", "says"),
    [
        (
            "semitrailer",
            "linear",
            ["crosswind@trailor"],
            "'crosswind' has no place 'trailor' on 'semitrailer'; closest",
        ),
        ("semitrailer", "linear", ["lifted_axle@11"], "'lifted_axle' has no place '11' on 'semitrailer'"),
        (
            "semitrailer",
            "linear",
            ["crosswind", "crosswind@trailer"],
            "'crosswind_force_trailer', which exists already",
        ),
        ("semitrailer", "linear", ["steering_lag@front"], "acts on the whole vehicle; write 'steering_lag'"),
        ("semitrailer", "linear", ["cross_wind"], "unknown effect 'cross_wind'; closest: crosswind"),
        ("semitrailer", "linear", ["tyre_relaxation"], "its tyre forces relax already"),
        ("semitrailer", "magic_formula", ["tyre_saturation"], "its tyre saturates already"),
        ("car", "linear", ["kingpin_damping"], "changes port 'coupling_moment', which 'car' does not publish"),
        ("car_reference_point", None, ["steering_compliance"], "reads 'lateral_force_steered_axle', which nothing"),
        ("car_two_track", "linear", ["liquid_slosh"], "reads 'inertial_mass', which nothing provides"),
    ],
)
def test_what_does_not_fit_is_refused(vehicle, tyre, effects, says):
    with pytest.raises(ModelError) as caught:
        assemble(vehicle, tyre, effects)
    assert says in str(caught.value)


def test_a_file_is_found_with_or_without_its_place():
    assert load_effect("crosswind@trailer") is load_effect("crosswind")


def test_the_library_of_a_vehicle_names_every_effect_that_fits_place_by_place():
    found = placements("semitrailer", "magic_formula", "test_vehicle")
    assert {"crosswind@tractor", "crosswind@trailer", "lifted_axle@22", "steering_lag", "road_bank"} <= set(found)
    assert {"sensor_bias@yaw_rate_tractor", "tyre_stiffness_drift@2"} <= set(found)
    assert not [n for n in found if n.startswith(("tyre_relaxation", "tyre_saturation", "lifted_axle@1"))]
    for name in found[::7]:
        assemble("semitrailer", "magic_formula", [name], "test_vehicle")


def test_effects_act_in_the_order_they_are_named():
    values = {**ziaukas_2023.VALUES, "steering_offset": 0.01, "steering_ratio_error": 1.0}
    angles = []
    for order in (["steering_offset", "steering_ratio"], ["steering_ratio", "steering_offset"]):
        built = assemble("semitrailer", "magic_formula", order)
        steering = [0.46 if n == "steering_wheel_angle" else 10.0 for n in built.inputs]
        angles += list(evaluator(built, values, ("road_wheel_angle",))([0.0] * len(built.states), steering))
    assert angles == pytest.approx([(0.02 + 0.01) / 2, 0.02 / 2 + 0.01])
