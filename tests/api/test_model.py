"""Models, drives and estimators as objects: keys of files and arguments mean the same, and errors come at once."""

import re

import numpy as np
import pytest

import harness as h
from harness.config import resolve_single

CAR = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"}


def test_arguments_are_the_keys_of_a_plant():
    keys = {
        "values": {"mass": "1.6 t"},
        "noise": {"measurement_scale": 2.0},
        "effects": ["steering_lag"],
        "step": "20 ms",
    }
    found = h.model("car", "govindarajan_2018", tyre="magic_formula", sensors="car_series", **keys)
    assert found.spec == resolve_single({**CAR, **keys}, "test")
    assert (found.step, found.effects, found.outputs) == (0.02, ("steering_lag",), ("yaw_rate", "lateral_acceleration"))


def test_numbers_of_numpy_are_numbers():
    found = h.model("car", "govindarajan_2018", values={"mass": np.int64(1600)}, substeps=np.int64(2))
    assert found.parameters.value["mass"] == 1600
    assert found.parameters.unit["mass"] == "kg"


def test_what_is_replaced_takes_the_place_of_its_own_key_only():
    first = h.model("car", "govindarajan_2018", sensors="car_series", values={"mass": "1.6 t"})
    other = first.replace(values={"yaw_inertia": 3000.0}, substeps=4)
    assert other.parameters.value[["mass", "yaw_inertia"]].tolist() == [1600.0, 3000.0]
    assert (other.spec.substeps, first.spec.substeps) == (4, 1)
    assert first.parameters.value["yaw_inertia"] != 3000.0


def test_sensors_that_are_not_stated_follow_from_recordings():
    open_ = h.model("car", "govindarajan_2018")
    assert open_.states == ("lateral_velocity", "yaw_rate")
    assert open_.table([{"yaw_rate", "lateral_acceleration", "speed"}])["sensors"] == "car_series"
    with pytest.raises(h.UserError, match="sensors: the recordings contain no complete set of sensors of 'car'"):
        open_.table([{"speed"}])


def test_a_model_is_written_as_a_parameter_file_that_loads(tmp_path):
    first = h.model(
        "car", "govindarajan_2018", sensors="car_series", values={"mass": "1.6 t"}, effects=["steering_lag"]
    )
    path = first.write(tmp_path / "mine.toml", "the weighbridge")
    again = h.model("car", path, sensors="car_series")
    assert again.parameters.equals(first.parameters)
    assert again.noise.equals(first.noise)
    assert again.effects == ("steering_lag",)
    assert 'source = "the weighbridge"' in path.read_text()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: h.model("cra"), h.ModelError, "unknown vehicle 'cra'; closest: car"),
        (lambda: h.model("car", "lyons_2024", values={"mas": 1}), h.UserError, "no parameter 'mas'; closest: mass"),
        (lambda: h.model("car", "lyons_2024", values={"mass": "2 m"}), h.UserError, "'2 m' does not fit"),
        (lambda: h.model("car", "lyons_2024", effects="steering_lag"), h.UserError, "effects: input should be a valid"),
        (lambda: h.drive("sin"), h.UserError, "drive 'sin': kind: unknown drive 'sin'; closest: sine"),
        (lambda: h.drive("sine", name="weave", sped=1), h.UserError, "drive 'weave': sped: drive 'sine' has no option"),
        (lambda: h.Estimator("ukff"), h.UserError, "estimator 'ukff': kind: unknown estimator 'ukff'; closest: ukf"),
        (
            lambda: h.Estimator("ukf", alpa=1),
            h.UserError,
            "estimator 'ukf': alpa: estimator 'ukf' has no setting 'alpa'",
        ),
    ],
)
def test_what_is_wrong_is_said_at_once(make, error, message):
    with pytest.raises(error, match=re.escape(message)):
        make()


@pytest.mark.parametrize(
    "shown",
    [
        h.model("car", "lyons_2024", values={"mass": "1.6 t"}),
        h.drive("sine", name="<weave>"),
        h.Estimator("ukf", alpha=0.5),
        h.Diagnosis(),
    ],
    ids=lambda shown: type(shown).__name__,
)
def test_objects_show_themselves(shown):
    html = shown._repr_html_()
    assert html.count("<div>") == html.count("</div>") == 1
    assert "<weave>" not in html
    assert len(repr(shown).splitlines()) > 1
