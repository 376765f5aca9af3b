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
    with pytest.raises(h.UserError, match="the recordings hold nothing that sensors of 'car' measure: yaw_rate, lat"):
        open_.table([{"speed"}])


def test_every_recorded_signal_is_measured_whose_noise_is_known(capsys):
    """No set of sensors is just that of the logger: its signals are the set."""
    truck = h.model("semitrailer", "ziaukas_2023")
    there = {"speed", "yaw_rate_tractor", "yaw_rate_trailer", "articulation_angle", "lateral_acceleration_tractor"}
    chosen = truck.table([there])["sensors"]
    assert chosen == "yaw_rate_tractor, yaw_rate_trailer, articulation_angle, lateral_acceleration_tractor"
    assert f"sensors: {chosen}; the recordings lack lateral_force_axle_21, and what only" in capsys.readouterr().err
    listed = tuple(chosen.split(", "))
    assert h.model("semitrailer", "ziaukas_2023", sensors=chosen).outputs == listed
    assert h.model("semitrailer", "ziaukas_2023", sensors=listed).outputs == listed
    assert truck.replace(sensors=listed[:2]).outputs == listed[:2]
    assert truck.table([there - {"articulation_angle"}])["sensors"] == "stability_control"
    assert "sensors: stability_control (lateral_acceleration_tractor, yaw_rate" in capsys.readouterr().err


def test_a_recorded_signal_of_unknown_noise_is_not_measured_and_a_set_with_one_does_no_harm(tmp_path, capsys):
    h.model("semitrailer", "ziaukas_2023", sensors="test_vehicle_inertial").write(tmp_path / "truck.toml", "me")
    head, noise = (tmp_path / "truck.toml").read_text().split("[measurement_noise]\n")
    yaw_rate = next(line for line in noise.splitlines() if line.startswith("yaw_rate_tractor"))
    head = "\n".join(line for line in head.splitlines() if not line.startswith("sensors"))
    (tmp_path / "truck.toml").write_text(f"{head}\n[measurement_noise]\n{yaw_rate}\n")
    truck = h.model("semitrailer", tmp_path / "truck.toml")  # the largest set has a force of axle 21
    there = {"speed", "yaw_rate_tractor", "articulation_angle"}
    assert truck.table([there])["sensors"] == "yaw_rate_tractor"
    assert "articulation_angle of the recordings is not used, because nobody knows" in capsys.readouterr().err
    with pytest.raises(h.UserError, match=r"nobody knows the noise of articulation_angle; state .*measurement_noise"):
        truck.table([{"articulation_angle"}])
    stated = h.model("semitrailer", tmp_path / "truck.toml", noise={"measurement": {"articulation_angle": 1e-6}})
    assert stated.table([there])["sensors"] == "yaw_rate_tractor, articulation_angle"


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


def test_a_vehicle_that_no_set_of_sensors_fits_is_refused_in_one_line(monkeypatch):
    monkeypatch.setattr("harness.config.model_choice.fitting_sensors", lambda vehicle, tyre: [])
    with pytest.raises(h.UserError, match="sensors: no set measures what 'car' publishes; list what is measured"):
        h.model("car", "govindarajan_2018")
    assert h.model("car", "govindarajan_2018", sensors="yaw_rate").outputs == ("yaw_rate",)
