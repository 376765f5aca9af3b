"""The plant of other hands: its logger, its files, and the scoring of hand-made traces."""

import ast
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import bench.foreign
from bench.attribution.score import CURVE, FAILED
from bench.foreign import run
from bench.foreign.__main__ import main
from bench.foreign.cases import CASES, DRIVES, TRUTH, nominal_text, write_case
from bench.foreign.logger import SPEED_STEP, Logger, record
from bench.foreign.run import TRACE, run_case, task_of
from bench.foreign.score import compare, gathered, score, table
from bench.foreign.vehicle import OUTPUTS, PUBLISHED, STEP
from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.models.assembly.placement import split
from harness.models.parameters import ziaukas_2023
from harness.models.roles import EFFECTS
from harness.recordings import load_recording

FOLDER = Path(bench.foreign.__file__).parent
SIMULATOR = ("vehicle", "driver", "logger", "cases")
FAULTS = ("steering_delay", "speed_delay", "sensor_delay@yaw_rate", "sensor_delay@angle", "sensor_drift@yaw_rate")
STATED = {"mass": 1000.0, "ratio": 20.0}


# --- apart from what it judges


def test_the_simulator_imports_nothing_of_the_project():
    allowed = {"numpy", "numba", *sys.stdlib_module_names}
    own = {"bench.foreign", *(f"bench.foreign.{name}" for name in SIMULATOR)}
    for file in [FOLDER / f"{name}.py" for name in SIMULATOR] + [FOLDER / "__init__.py", FOLDER.parent / "__init__.py"]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module]
            for name in names:
                assert name in own or name.split(".")[0] in allowed, f"{file.name} imports {name}"
            assert not (isinstance(node, ast.Name) and node.id == "__import__")


def test_what_is_published_is_what_the_project_knows_of_the_vehicle():
    assert {name: ziaukas_2023.VALUES[name] for name in PUBLISHED} == PUBLISHED


# --- the logger


def quiet(**different):
    """Return a logger that adds no noise but that of its accelerometers."""
    delays = dict.fromkeys(("speed", "steering_wheel_angle", *OUTPUTS[1:]), 0.0)
    none = np.zeros(2)
    return Logger({**delays, **different.pop("delays", {})}, none, none, 0.0, speed_noise=0.0, **different)


def logged(logger, seed=0):
    """Return what is recorded of signals that all grow by 1 per s, and the time."""
    t = np.arange(20001) * STEP
    found = record(np.random.default_rng(seed), np.repeat(t[:, None], len(OUTPUTS), axis=1), t, logger, STEP)
    return found, found["t_s"]


def test_channels_are_late_in_units_of_the_file():
    found, t = logged(quiet(delays={"yaw_rate_tractor": 0.013}, articulation_gain=1.1))
    late, angle = np.radians(found["ESC_YawRate"]) - t, np.radians(found["ARTIC_Angle"]) - 1.1 * t
    assert np.nanmedian(late) == pytest.approx(-0.013)
    assert np.nanmedian(np.abs(angle)) == pytest.approx(0.0, abs=1e-12)
    assert np.nanmean(found["EBS_TrailerSpeed"] / 3.6 - t) == pytest.approx(-0.005, abs=1e-3)  # every other one is held


def test_speed_and_steering_wheel_are_counted_in_steps_and_samples_get_lost():
    found, t = logged(quiet(five=True))
    speed, wheel = found["EBS_TrailerSpeed"], found["LWS_Angle"]
    there = np.isfinite(speed[::2][:-1]) & np.isfinite(speed[1::2])
    assert (speed[::2][:-1][there] == speed[1::2][there]).all()
    assert np.nanmax(np.abs(speed / SPEED_STEP - np.round(speed / SPEED_STEP))) == 0.0
    steps = wheel[np.abs(np.radians(wheel) - t) < 0.1] * 10
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert 0 < sum(int(np.isnan(values).sum()) for values in found.values()) < 0.005 * t.size * len(found)
    assert np.nanmax(np.abs(found["ARTIC_Angle"] - np.degrees(t))) > 4.0  # an outlier
    assert "TEBS_LatAcc" in found
    assert "TEBS_LatAcc" not in logged(quiet())[0]


def test_a_logger_says_what_is_wrong_with_its_recordings():
    assert "sensor_gain@articulation_angle" in quiet(articulation_gain=1.035).faults
    assert "sensor_delay@lateral_acceleration_trailer" in quiet(five=True).faults
    faults = quiet().faults
    assert {"steering_delay", "speed_delay", "sensor_drift@yaw_rate_trailer"} < set(faults)
    assert not any("gain" in name or "acceleration_trailer" in name for name in faults)


# --- the files of a case


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a case with short drives."""
    found = tmp_path_factory.mktemp("foreign") / "h"
    write_case(CASES["h"], found, 24.0)
    return found


def test_a_case_is_read_by_its_channel_map(folder):
    recording = load_recording(folder / "d1.csv", folder / "map.toml")
    assert recording.sizes["time"] == 2401
    logger = quiet()
    assert {"speed", "steering_wheel_angle", *logger.outputs} <= set(recording.data_vars)
    assert 9.0 < float(recording["speed"].mean()) < 16.0
    assert float(np.abs(recording["articulation_angle"]).max()) < 0.3
    true = json.loads((folder / TRUTH).read_text(encoding="utf-8"))
    assert set(true["drives"]) == set(DRIVES)
    assert true["delays"].keys() == {"speed", "steering_wheel_angle", *logger.outputs}
    assert all(0.0 <= late <= 0.02 for late in true["delays"].values())


def test_a_case_is_a_task_with_the_sensors_of_its_logger_and_the_published_values(folder):
    task = task_of(folder)
    assert [len(task.train), len(task.test)] == [2, 1]
    assert task.spec.tyre == "brush"
    assert tuple(task.spec.model().outputs) == quiet().outputs
    assert set(task.spec.measurement_noise) == set(quiet().outputs)
    assert {name: task.spec.values[name] for name in PUBLISHED} == PUBLISHED
    assert task.free == ("stiffness_peak_11", "stiffness_peak_12", "stiffness_peak_2")
    five = parse_toml(nominal_text(quiet(five=True)), "nominal.toml")
    assert five["measurement_noise"].keys() == set(quiet(five=True).outputs)


def test_cases_name_effects_of_the_library_and_parameters_of_the_vehicle():
    assert "".join(CASES) == "abcdefghijklm"
    for case in CASES.values():
        assert {split(name)[0] for name in case.effects} <= set(EFFECTS.names())
        assert case.values.keys() <= PUBLISHED.keys()
        assert bool(case.effects) == (case.kind in ("effect", "sensor"))


# --- the scoring


def true(kind="nothing", effects=(), values=(), faults=FAULTS, delays=None):
    known = delays or {"speed": 0.0, "steering_wheel_angle": 0.01, "yaw_rate": 0.004, "angle": 0.02}
    return {"name": "x", "missing": "it", "kind": kind, "effects": list(effects), "faults": list(faults)} | {
        "values": dict.fromkeys(values, 1.0),
        "delays": known,
    }


def effect(name, value=0.0):
    file, place = split(name)
    return {"effect": file, "place": place, "parameters": {f"{file}_{place}": {"value": value, "std": 1e-4}}}


def model_with(probability, *names):
    return {"added": [[{"name": n, "kind": "effect"}] for n in names], "probability": probability}


def posterior(*models, none=0.0, **hypotheses):
    found = [{"name": n.replace("__", "@"), "kind": "effect", "probability": v} for n, v in hypotheses.items()]
    return {"none_of_these": none, "hypotheses": found, "models": list(models)}


def traced(*added, verdict="amended", parameters=(), unnamed=None, posterior=None):
    effects = [a if isinstance(a, dict) else effect(a) for a in added]
    return {"verdict": verdict, "added": effects, "parameters": list(parameters), "unnamed": unnamed} | {
        "posterior": posterior
    }


def right(known, found):
    return compare(known, found, STATED).right


def test_faults_of_the_recording_that_are_there_are_findings():
    found = compare(true(), traced("steering_delay", "sensor_drift@yaw_rate"), STATED)
    assert found.right
    assert found.vehicle == ()
    assert found.recording == ("steering_delay", "sensor_drift@yaw_rate")
    assert not right(true(), traced("steering_delay", "roll_steer"))
    assert not right(true(), traced("sensor_gain@angle"))
    assert not right(true("parameters", values=["mass"]), traced("roll_steer"))


def test_a_curve_without_a_name_is_a_claim():
    found = compare(true(), traced("steering_delay", unnamed={"curves": [{}]}), STATED)
    assert (found.right, found.vehicle) == (False, (CURVE,))
    assert right(true(), traced(verdict="unresolved", unnamed={"curves": [{}]}))


def test_wrong_values_are_no_claim_whatever_they_are_called():
    known = true("parameters", values=["mass", "ratio"])
    values = {"mass": {"value": 1100.0, "std": 20.0}, "ratio": {"value": 20.5, "std": 0.4}}
    together = compare(known, traced(parameters=[{"effect": "parameters", "parameters": values}]), STATED)
    assert (together.right, together.parameters) == (True, ("mass",))
    alone = {"effect": "ratio", "parameters": {"ratio": values["ratio"]}}
    assert compare(known, traced(parameters=[alone]), STATED).parameters == ("ratio",)
    assert right(known, traced("ratio"))


def test_every_true_effect_has_to_be_added_at_its_place():
    known = true("effect", ["road_bank", "lifted_axle@21"])
    assert right(known, traced("lifted_axle@21", "steering_delay", "road_bank"))
    assert not right(known, traced("road_bank"))
    assert not right(known, traced("road_bank", "lifted_axle@22"))


def test_of_a_planted_fault_nothing_else_may_be_claimed():
    known = true("sensor", ["sensor_gain@angle"], faults=[*FAULTS, "sensor_gain@angle"])
    found = compare(known, traced("sensor_gain@angle", "steering_delay"), STATED)
    assert (found.right, found.vehicle) == (True, ())
    assert not right(known, traced("sensor_gain@angle", "roll_steer"))
    assert not right(known, traced("sensor_gain@yaw_rate"))


def test_of_what_the_library_lacks_no_name_may_be_sure():
    known = true("unlisted")
    sure = posterior(roll_steer__11=0.5, roll_steer__12=0.45, steering_delay=1.0, none=0.01)
    unsure = posterior(roll_steer__11=0.5, roll_steer__12=0.3, steering_delay=1.0, none=0.01)
    assert not right(known, traced("roll_steer@11", verdict="unresolved", posterior=sure))
    found = compare(known, traced("roll_steer@11", verdict="unresolved", posterior=unsure), STATED)
    assert found.right
    assert math.isnan(found.truth)
    assert right(known, traced(posterior=posterior(roll_steer=1.0, none=0.2)))
    assert not right(known, traced("roll_steer"))
    assert right(known, traced("steering_delay", verdict="unresolved"))


def test_the_probability_of_the_truth_is_that_of_the_models_that_say_it():
    models = [
        model_with(0.5, "steering_delay"),
        model_with(0.25, "steering_delay", "roll_steer"),
        model_with(0.125, "steering_delay", "parameters"),
        model_with(0.0625, "mass"),
    ]
    found = traced(posterior=posterior(*models, none=0.0625))

    def probability(known):
        return compare(known, found, STATED).truth

    assert probability(true()) == 0.5
    assert probability(true("effect", ["roll_steer"])) == 0.25
    assert probability(true("parameters", values=["mass"])) == 0.1875
    assert probability(true("parameters", values=["mass", "ratio"])) == 0.125
    assert compare(true(), found, STATED).none == 0.0625
    assert math.isnan(compare(true(), traced(), STATED).truth)


def test_delays_are_compared_between_channels():
    late = [effect("steering_delay", 0.006), effect("sensor_delay@angle", 0.0165)]  # the wheel is the first of all
    known = {"speed": 0.5, "steering_wheel_angle": -0.002, "yaw_rate": 0.004, "angle": 0.02}
    assert compare(true(delays=known), traced(*late), STATED).delay == pytest.approx(0.5)
    assert compare(true(delays=known), traced(late[0]), STATED).delay == pytest.approx(16.0)
    with_speed = traced(*late, effect("speed_delay", -0.486))
    assert compare(true(delays=known), with_speed, STATED).delay == pytest.approx(10.5)


def test_a_case_that_could_not_be_traced_is_wrong_and_stands_in_the_table(folder, monkeypatch, capsys):
    def broken(*_):
        raise UserError("it cannot be")

    monkeypatch.setattr(run, "run_trace", broken)
    written = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert run_case("h", folder) == "it cannot be"
    assert {name: (folder / name).read_bytes() for name in written} == written
    assert (folder / FAILED).read_text(encoding="utf-8") == "it cannot be"
    assert score(folder).verdict == "failed"
    assert main(["--traced", "--out", str(folder.parent)]) == 0
    assert "`failed`" in capsys.readouterr().out
    row = (folder.parent / "foreign.md").read_text(encoding="utf-8").splitlines()[2]
    assert row.startswith("| h | the articulation sensor reads 3.5 % too much | `failed` |")
    assert row.endswith("| no |")


def test_a_case_is_traced_once(folder, monkeypatch, capsys):
    calls = []

    def fake(task, where, *_):
        calls.append(task)
        where.mkdir()
        found = traced("sensor_gain@articulation_angle", posterior=posterior(model_with(1.0)))
        (where / TRACE.name).write_text(json.dumps(found), encoding="utf-8")

    monkeypatch.setattr(run, "run_trace", fake)
    for _ in range(2):
        assert main(["--cases", "h", "--out", str(folder.parent)]) == 0
    assert len(calls) == 1
    assert not (folder / FAILED).exists()
    (found,) = gathered(folder.parent)
    assert found.right
    assert table([found]) in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--cases", "a", "zz"], "--cases: there is no case 'zz'; there are: a, b, c, d, e, f, g, h, i, j, k, l"),
        (["--jobs", "0"], "--jobs: 0 processes cannot trace; give 1 or more"),
        (["--traced"], "holds no case that was traced; leave out --traced"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(arguments, said, tmp_path, capsys):
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert list(tmp_path.iterdir()) == []
