"""``unknown_parameters`` and ``considered_parameters``: what they become, and what is refused."""

import pytest

from harness.api.model import model, model_of
from harness.common.errors import UserError
from harness.common.units import to_si
from harness.config import build_study, resolve_single
from harness.models.signals import SIGNALS

BELIEF = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "series"}


def believed(*entries, key="unknown_parameters", **further):
    return resolve_single({**BELIEF, key: list(entries), **further}, "test", "belief")


def test_entries_become_states_behind_all_others():
    spec = believed(
        "trailer_mass",
        {"name": "trailer_cog_from_rear", "walk": "0.1 m/sqrt(h)", "prior": "1 m"},
        unknown_inputs=["steering_wheel_angle"],
    )
    made = spec.model()
    assert made.states[-3:] == ("steering_wheel_angle", "log_trailer_mass", "log_trailer_cog_from_rear")
    assert made.start_variance["log_trailer_mass"] == pytest.approx(0.1**2)  # a tenth where the set states nothing
    assert made.start_variance["log_trailer_cog_from_rear"] == pytest.approx((1 / 7.8) ** 2)
    assert spec.process_noise["log_trailer_mass"] == 0.0
    assert spec.process_noise["log_trailer_cog_from_rear"] == pytest.approx((0.1 / 7.8) ** 2 / 3600 * 0.01)
    assert SIGNALS["trailer_mass"].report_unit == "t"


def test_the_load_moves_all_that_follows_from_it():
    made = believed("payload_mass", {"name": "payload_from_rear", "prior": "1 m"}).model()
    assert set(made.estimated) == {
        "payload_mass", "payload_from_rear", "trailer_mass", "trailer_cog_from_rear", "trailer_inertia_scale",
    }  # fmt: skip
    assert str(made.resolve("trailer_mass")) == "trailer_mass_now"


def test_a_parameter_that_may_be_negative_is_no_logarithm():
    spec = believed(
        {"name": "sensor_bias_yaw_rate_trailer", "prior": "0.2 deg/s"}, effects=["sensor_bias@yaw_rate_trailer"]
    )
    assert spec.model().states[-1] == "shift_sensor_bias_yaw_rate_trailer"


def test_roots_of_units_are_read():
    assert to_si("6 m/sqrt(h)", "(m)/s**0.5", "here") == pytest.approx(0.1)
    assert to_si("60 %/sqrt(h)", "1/s**0.5", "here") == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (
            ["trailer_masss"],
            "unknown_parameters[0]: the belief has no parameter 'trailer_masss'; closest: trailer_mass",
        ),
        (["trailer_mass", "trailer_mass"], "unknown_parameters[1]: 'trailer_mass' is named twice"),
        (["constraint_rate"], "belongs to how the equations are solved"),
        (["payload_mass", "trailer_mass"], "'trailer_mass' follows from the load"),
        ([{"name": "trailer_mass", "prior": "1 m"}], "unknown_parameters[0].prior: '1 m' does not fit"),
        ([{"name": "trailer_mass", "prior": "0 t"}], "a standard deviation must be positive"),
        ([{"name": "trailer_mass", "walk": "1 t"}], "unknown_parameters[0].walk: '1 t' does not fit"),
        ([{"name": "trailer_mass", "walk": "-1 t/sqrt(h)"}], "no negative standard deviation"),
        ([{"name": "trailer_mass", "size": 1}], "size"),
    ],
)
def test_what_cannot_be_is_refused(entries, message):
    with pytest.raises(UserError) as refused:
        believed(*entries)
    assert message in str(refused.value)


def test_considered_parameters_do_not_walk():
    with pytest.raises(UserError, match="left alone; remove its walk"):
        believed({"name": "trailer_mass", "walk": "1 t/sqrt(h)"}, key="considered_parameters")


def test_a_load_that_is_none_is_refused():
    with pytest.raises(UserError, match="no more than the empty trailer"):
        believed("payload_mass", values={"trailer_mass": "7 t"})


def test_the_plant_is_sure_of_itself():
    with pytest.raises(UserError, match="only the belief is unsure of parameters"):
        resolve_single({**BELIEF, "unknown_parameters": ["trailer_mass"]}, "test", "plant")


def test_a_model_in_python_takes_them_and_gives_them_back():
    made = model(**BELIEF, unknown_parameters=["trailer_mass"], considered_parameters=["friction"])
    assert made.states[-2:] == ("log_trailer_mass", "log_friction")
    again = model_of(made.spec)
    assert again.spec.parameter_states == made.spec.parameter_states
    assert again.spec.process_noise == made.spec.process_noise


def study(**further):
    content = {
        "name": "mine",
        "targets": ["articulation_angle"],
        "drive": [{"name": "sine", "kind": "sine", "duration": "20 s"}],
        "plant": BELIEF,
        "estimator": [{"kind": "ekf"}],
        "design": [{"name": "level", "factor": [{"parameter": "trailer_mass", "levels": ["8 t"]}]}],
        **further,
    }
    return build_study(content, "mine.toml")


def test_unknown_parameters_are_targets_and_change_the_hash():
    plain, unknown = study(), study(belief={"unknown_parameters": ["trailer_mass"]})
    assert unknown.targets == ("articulation_angle", "trailer_mass")
    assert plain.hash != unknown.hash != study(belief={"unknown_parameters": ["friction"]}).hash
    assert study(score_after="5 s").hash not in (plain.hash, unknown.hash)
    assert study(score_after=0).hash == plain.hash


def test_the_time_before_scores_is_checked():
    with pytest.raises(UserError, match="score_after: a time from the beginning"):
        study(score_after="-5 s")
