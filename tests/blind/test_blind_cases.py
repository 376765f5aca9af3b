"""The blind plant's effects and cases: each acts, fades, is in the words of the library, and is sealed."""

from __future__ import annotations

import importlib.util
import json

import numpy as np
import plant
import pytest
from plant_cases import Channel, Drawn, Truth, cases, choose, draw, seeds
from plant_drives import stated
from plant_effects import CATALOGUE, Effect
from plant_environment import Changes, Column, Surroundings, draw_changes
from plant_equations import Car, Semitrailer
from plant_oracle import SIMILAR, library_times, library_values
from plant_sensors import NOISE, record
from plant_simulation import drive

from support.blind_vehicles import EARLY, NOMINAL, respond

pytestmark = pytest.mark.proof


# --- every effect


EVERY = [(vehicle, effect) for vehicle, catalogue in CATALOGUE.items() for effect in catalogue.values()]


def seen(truth: Truth, out: np.ndarray, plan) -> np.ndarray:
    """Return what sensors without noise show, ``(channels, samples)`` over their standard deviations."""
    known = {"steering_wheel_angle": plan.steering_wheel_angle[::2], "speed": plan.speed[::2]}
    known = {name: x[: len(out)] for name, x in known.items()}
    quiet = type("Quiet", (), {"standard_normal": staticmethod(np.zeros)})()
    columns = record(truth.vehicle, out, known, truth.sensors(), quiet)
    return np.array([columns[n] / NOISE[truth.vehicle][n] for n in columns if n in NOISE[truth.vehicle]])


def milder(effect: Effect, values: dict[str, float], share: float, vehicle: str) -> dict[str, float]:
    """Return the values with a share of their distance from where the effect is absent."""
    published = plant.published(vehicle)
    kept = ("slosh_frequency", "baffle_stiffness")  # without mass they do nothing
    return {
        k: v if k in kept else published.get(k, 0.0) + share * (v - published.get(k, 0.0)) for k, v in values.items()
    }


@pytest.fixture(scope="module")
def undisturbed(plans) -> dict[str, np.ndarray]:
    return {v: seen(t, respond(t, plans[v]), plans[v]) for v, t in NOMINAL.items()}


@pytest.mark.parametrize(("vehicle", "effect"), EVERY, ids=lambda x: getattr(x, "name", x))
def test_effect_acts_and_fades_to_the_vehicle_without_it(vehicle, effect, plans, undisturbed):
    place, values = effect.draw("medium", np.random.default_rng(1))
    distance = []
    for share in (1.0, 0.1):
        drawn = Drawn(effect.name, "medium", place, milder(effect, values, share, vehicle))
        truth = Truth(vehicle, {}, [drawn])
        difference = seen(truth, respond(truth, plans[vehicle]), plans[vehicle]) - undisturbed[vehicle]
        distance.append(np.sqrt((difference**2).sum()))
    assert distance[0] > 1.0, "nothing to be seen"
    assert distance[1] < 0.5 * distance[0]


def test_three_magnitudes_grow_and_every_key_belongs_to_something():
    for vehicle, effect in EVERY:
        known = {*Column._fields, *Surroundings._fields, *(Semitrailer if vehicle == "semitrailer" else Car)._fields}
        neutral = plant.published(vehicle)
        assert len(effect.units) == len(effect.values)
        for key, three in effect.values.items():
            for place in effect.places or ("",):
                name, _, channel = key.format(place).partition("@")
                assert name in (Channel._fields if channel else known), key
                assert not channel or channel in NOISE[vehicle]
            if key != "slosh_frequency":
                assert (np.diff(np.abs(np.array(three) - neutral.get(key, 0.0))) > 0).all(), key
        if effect.change:
            assert any(name.startswith(effect.change) for name in Changes._fields)


@pytest.mark.parametrize(("vehicle", "effect"), EVERY, ids=lambda x: getattr(x, "name", x))
def test_oracle_speaks_the_words_of_the_library(vehicle, effect):
    values = [effect.draw(m, np.random.default_rng(2)) for m in ("small", "medium", "large")]
    drawn = [Drawn(effect.name, m, *v) for m, v in zip(("small", "medium", "large"), values, strict=True)]
    if not effect.in_library:
        assert importlib.util.find_spec(f"harness.models.effects.{effect.name}") is None
        return
    library = importlib.import_module(f"harness.models.effects.{effect.name}")
    for e in drawn:
        truth = Truth(vehicle, {}, [e])
        said = {**library_values(e, truth.equations()), **library_times(e, EARLY)}
        assert said or effect.name in SIMILAR
        for name, value in said.items():
            found = [p for p in library.PARAMETERS if name == p.name or name.startswith(f"{p.name}_")]
            assert found, f"'{name}' is no parameter of {effect.name}"
            exact = max(found, key=lambda p: len(p.name))
            assert exact.unit == "{signal}" or exact.lower <= value <= exact.upper, name
    assert set(effect.equivalent) <= {*CATALOGUE[vehicle], *(f"parameter:{k}" for k in plant.published(vehicle))}


# --- cases, seal, command line


def test_the_list_covers_what_was_asked():
    found = cases()
    for vehicle, catalogue in CATALOGUE.items():
        for effect in catalogue.values():
            assert all(f"{vehicle}-{effect.name}-{m}" in found for m in ("small", "medium", "large"))
    assert {case.kind for case in found.values()} == {"none", "parameters", "effect", "pair", "unlisted"}
    assert {choose(seed).kind for seed in range(40)} == {"none", "parameters", "effect", "pair", "unlisted"}
    for case in found.values():
        assert set(case.effects) <= set(CATALOGUE[case.vehicle])


def test_a_case_depends_on_its_name_and_repeat_alone():
    case = cases()["car-crosswind-medium"]
    first, second = seeds(case, 0), seeds(case, 0)
    truths = [draw(case, np.random.default_rng(s[0])) for s in (first, second, seeds(case, 1))]
    assert truths[0] == truths[1] != truths[2]
    runs = [drive(truths[0], s) for s in (first[1], second[1], first[2])]
    for name, column in runs[0].recording.items():
        np.testing.assert_array_equal(column, runs[1].recording[name])
    assert not np.array_equal(runs[0].recording["yaw_rate"], runs[2].recording["yaw_rate"])
    assert abs(runs[0].changes.gust_begin - runs[2].changes.gust_begin) > 0.01


def test_change_times_leave_room_on_both_sides():
    for seed in range(50):
        c = draw_changes(np.random.default_rng(seed))
        assert all(30.0 <= t <= 90.0 for t in c)
        assert c.gust_end - c.gust_begin >= 18.0


def test_recordings_and_seal(tmp_path, capsys):
    name = "semitrailer-crosswind+kingpin_friction"
    assert plant.main(["--case", name, "--repeat", "2", "--out", str(tmp_path)]) == 0
    assert "crosswind" not in capsys.readouterr().out
    for drive_name in plant.DRIVES:
        lines = (tmp_path / f"{drive_name}.csv").read_text().splitlines()
        assert lines[0].replace('"', "").split(",") == ["time", *NOISE["semitrailer"]]
        assert len(lines) == 12002
    belief = json.loads((tmp_path / "belief.json").read_text())
    assert set(belief) == {"vehicle", "parameters", "noise"}
    assert "gust_force_trailer" not in belief["parameters"]
    sealed = json.loads((tmp_path / "sealed.json").read_text())
    assert sealed["schema"] == plant.SCHEMA
    assert (sealed["case"], sealed["repeat"], sealed["kind"]) == (name, 2, "pair")
    assert sealed["expected_verdict"] == "amended"
    assert [e["name"] for e in sealed["effects"]] == ["crosswind", "kingpin_friction"]
    gust, friction = (e["parameters"] for e in sealed["effects"])
    assert abs(gust["gust_force_trailer"]["value"]) == 4000.0
    assert (
        sealed["effects"][0]["oracle"]["parameters"]["crosswind_force_trailer"] == gust["gust_force_trailer"]["value"]
    )
    onsets = {d["crosswind_onset"] for d in sealed["effects"][0]["oracle"]["per_drive"].values()}
    assert len(onsets) == 3
    assert friction == {"kingpin_dry_moment": {"value": 8000.0, "unit": "N*m"}}
    assert set(sealed["parameters"]) == {"stiffness_peak_11", "stiffness_peak_12", "stiffness_peak_2"}
    assert set(sealed["drives"]) == set(plant.DRIVES)
    assert len({d["changes"]["gust_begin"] for d in sealed["drives"].values()}) == 3


def planned(folder, seconds=25.0):
    """A table of a weave at a speed that rises, as ``harness next-drive`` writes them."""
    time = np.arange(0.0, seconds + 1e-9, 0.01)
    angle = 0.5 * np.sin(2.0 * np.pi * 0.4 * time)
    np.savetxt(folder / "1-weave.csv", np.column_stack([time, angle, angle / 16.0, 12.0 + 0.1 * time]), delimiter=",",
               header="time,steering_wheel_angle,road_wheel_angle,speed", comments="")  # fmt: skip
    return folder / "1-weave.csv"


@pytest.mark.parametrize("quality", ["clean", "field"])
def test_a_planned_drive_is_driven_by_the_same_vehicle(quality, tmp_path):
    name = ["--case", "car-crosswind-medium", "--repeat", "2", "--quality", quality]
    assert plant.main([*name, "--out", str(tmp_path / "own")]) == 0
    assert plant.main([*name, "--drive", str(planned(tmp_path)), "--out", str(tmp_path / "further")]) == 0
    seals = [json.loads((tmp_path / folder / "sealed.json").read_text()) for folder in ("own", "further")]
    for key in ("case", "parameters", "noise", "recording"):
        assert seals[0][key] == seals[1][key]
    assert [e["parameters"] for e in seals[0]["effects"]] == [e["parameters"] for e in seals[1]["effects"]]
    assert set(seals[1]["drives"]) == {"1-weave"}
    assert 0.25 * 25.0 < seals[1]["drives"]["1-weave"]["changes"]["gust_begin"] < 0.45 * 25.0
    recorded = np.genfromtxt(tmp_path / "further" / "1-weave.csv", delimiter=",", names=True)
    late = next((-f["delay"] for f in seals[1]["recording"] if f["name"] == "steering_delay"), 0.0)
    time = recorded["time"] - late
    off = recorded["steering_wheel_angle"] - 0.5 * np.sin(2.0 * np.pi * 0.4 * time)
    assert np.median(np.abs(off[time > 0.1])) < 2e-3
    assert np.median(np.abs(recorded["speed"] - 12.0 - 0.1 * time)) < 0.06
    assert not (tmp_path / "further" / "train_a.csv").exists()


def test_the_rate_of_a_stated_speed_is_its_slope():
    drive = stated(np.array([0.0, 2.0, 5.0]), np.array([0.1, 0.1, 0.4]), np.array([10.0, 14.0, 14.0]))
    at = np.searchsorted(drive.time, [-3.0, 1.0, 3.0, 5.0])
    np.testing.assert_allclose(drive.speed_rate[at], [0.0, 2.0, 0.0, 0.0])
    np.testing.assert_allclose(drive.speed[at], [10.0, 12.0, 14.0, 14.0])
    np.testing.assert_allclose(drive.steering_wheel_angle[at], [0.1, 0.1, 0.2, 0.4])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,speed\n0,10\n1,10\n", "steering_wheel_angle"),
        ("time,steering_wheel_angle,speed\n0,0,10\n0,0,10\n", "rise from 0"),
        ("time,steering_wheel_angle,speed\n0,0,10\n1,0,-1\n", "drives forward"),
        ("time,steering_wheel_angle,speed\n0,a,10\n1,0,1\n", "no table"),
    ],
)
def test_a_table_that_is_no_drive_is_refused(text, message, tmp_path, capsys):
    (tmp_path / "d.csv").write_text(text)
    assert plant.main(["--case", "car-none", "--drive", str(tmp_path / "d.csv"), "--out", str(tmp_path / "o")]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--case", "car-crosswind", "--out", "x"], "closest: car-crosswind"),
        (["--case", "car-none"], "give --case and --out"),
        (["--case", "car-none", "--out", "x", "--repeat", "-1"], "give 0 or more"),
    ],
)
def test_a_wrong_request_is_refused(arguments, message, capsys):
    with pytest.raises(SystemExit) as stop:
        plant.main(arguments)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
