"""Options become the same model in every command, and a parameter file keeps what it states."""

import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.cli.options import ModelOptions, model_of
from harness.common.errors import UserError
from harness.config import resolve_single
from harness.config.parameter_set import set_text
from harness.models.roles import VEHICLES

ROOT = Path(__file__).parents[2]
SIGNALS = ("steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration", "lateral_velocity")


class Reached(Exception):
    """The work would begin."""


@pytest.fixture
def begun(monkeypatch):
    """Stop every command where its work begins, and keep the model that it would work with."""
    models = []

    def stop(model, *_, **__):
        models.append(getattr(model, "spec", model))
        raise Reached

    for place in (
        "harness.identification.fit_recordings.Innovations",
        "harness.diagnosis.run.run_trace",
        "harness.simulation.simulate.simulate_drive",
        "harness.cli.observability_report.report",
    ):
        monkeypatch.setattr(place, stop)
    return models


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder with three recordings of a car, a file of a traced car and a channel map."""
    time = np.round(np.arange(0, 25, 0.01), 9)
    for i, name in enumerate(("lap", "a", "b")):
        table = {n: np.sin(0.5 * time + i + k) * 0.1 + 20 * (n == "speed") for k, n in enumerate(SIGNALS)}
        pd.DataFrame({"time": time, **table}).to_csv(tmp_path / f"{name}.csv", index=False)
    spec = resolve_single(
        {
            "vehicle": "car",
            "parameters": "blanco_2021",
            "tyre": "linear",
            "effects": ["steering_lag", "sensor_bias@yaw_rate"],
            "sensors": "car_navigation",
            "values": {"steering_lag": "80 ms", "mass": "1000 kg"},
        },
        "test",
    )
    (tmp_path / "amended.toml").write_text(set_text(spec, "a test", {}))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def completed(options):
    return model_of(options).completed()


def run(line):
    return CliRunner().invoke(app, shlex.split(line))


COMMANDS = {
    "identify": "identify --model car --train lap.csv --free yaw_inertia --out out",
    "trace": "trace --model car --train a.csv --test b.csv --out out",
    "simulate": "simulate car --drive sine --option amplitude='1 deg' --sensors car_navigation --out out.csv",
    "observability": "observability car --sensors car_navigation --out out",
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_keeps_tyre_and_effects_of_a_parameter_file(command, folder, begun):
    done = run(f"{COMMANDS[command]} --parameters amended.toml")
    assert "Reached" in done.output
    (spec,) = begun
    assert (spec.tyre, spec.effects) == ("linear", ("steering_lag", "sensor_bias@yaw_rate"))
    assert (spec.values["steering_lag"], spec.values["mass"], spec.sensors) == (0.08, 1000.0, "car_navigation")
    assert "note" not in done.output


@pytest.mark.parametrize("command", COMMANDS)
def test_a_tyre_that_the_values_do_not_belong_to_is_refused(command, folder, begun):
    done = run(f"{COMMANDS[command]} --parameters amended.toml --tyre magic_formula")
    assert done.exit_code == 2
    assert "'amended.toml' belong to tyre 'linear', but plant.tyre is 'magic_formula'" in done.stderr
    assert begun == []


@pytest.mark.parametrize("command", [c for c in COMMANDS if c != "trace"])
def test_effects_that_are_given_take_the_place_of_the_files_with_a_note(command, folder, begun):
    done = run(f"{COMMANDS[command]} --parameters amended.toml --effect steering_lag")
    assert begun[0].effects == ("steering_lag",)
    note = "note: effects: the model has steering_lag, in place of steering_lag, sensor_bias@yaw_rate of amended.toml"
    assert note in done.stderr


def test_a_trace_is_told_of_replaced_effects_too(folder):
    _, notes = completed(ModelOptions("car", "amended.toml", effects=["steering_lag"], sensors="car_series"))
    assert notes == (
        "effects: the model has steering_lag, in place of steering_lag, sensor_bias@yaw_rate of amended.toml",
    )


def test_sensors_of_a_file_are_taken_unless_others_are_given(folder):
    path = folder / "amended.toml"
    path.write_text('sensors = "car_series"\n' + path.read_text())
    table, notes = completed(ModelOptions("car", "amended.toml"))
    assert (table["sensors"], notes) == ("car_series", ())
    table, notes = completed(ModelOptions("car", "amended.toml", sensors="car_lateral"))
    assert (table["sensors"], notes) == (
        "car_lateral",
        ("sensors: car_lateral, in place of car_series of amended.toml",),
    )
    assert resolve_single({"vehicle": "car", "parameters": "amended.toml"}, "a study").sensors == "car_series"
    path.write_text(path.read_text().replace("car_series", "car_serie"))
    with pytest.raises(UserError, match=r"amended\.toml: sensors: unknown sensor 'car_serie'; closest: car_series"):
        completed(ModelOptions("car", "amended.toml"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ModelOptions("car"),
            r"parameters: which values of 'car'\? There are blanco_2021, govindarajan_2018, lyons_2024, pac",
        ),
        (
            ModelOptions("car", "blanco_2021"),
            r"sensors: which of 'car'\? There are car_lateral, car_navigation, car_s",
        ),
        (ModelOptions("car", "ziaukas_2023"), r"'ziaukas_2023' holds values of vehicle 'semitrailer', not of 'car'"),
    ],
)
def test_what_cannot_be_guessed_is_asked_for_with_the_choices(options, message, monkeypatch):
    monkeypatch.delattr(VEHICLES.load("car"), "USUAL")
    with pytest.raises(UserError, match=message):
        completed(options)


def test_the_usual_parameters_and_sensors_are_taken_and_a_choice_is_said():
    table, notes = completed(ModelOptions("car"))
    assert (table["parameters"], table["sensors"]) == ("govindarajan_2018", "car_series")
    (note,) = notes
    assert note.startswith("parameters: govindarajan_2018, the usual ones of 'car'; there are also blanco_2021")


@pytest.mark.parametrize("vehicle", VEHICLES.names())
def test_every_vehicle_can_be_named_alone(vehicle):
    assert resolve_single(completed(ModelOptions(vehicle))[0], "command line").vehicle == vehicle


def test_what_follows_needs_no_option():
    assert completed(ModelOptions("semitrailer"))[0] == {
        "vehicle": "semitrailer",
        "parameters": "ziaukas_2023",
        "tyre": "magic_formula",
        "sensors": "series",
    }
    alone = completed(ModelOptions("scalar_example"))[0]
    assert (alone["sensors"], "tyre" in alone) == ("example", False)
