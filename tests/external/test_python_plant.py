"""A Python class of somebody else as the plant of a study."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.config import build_study, load_study
from harness.config.self_contained import self_contained
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.layout import root_attributes
from harness.study.provenance import differences
from harness.study.replay import Place
from harness.study.report.analysis import Analysis
from harness.study.report.sections import made
from harness.study.results import read
from harness.study.run import run_study
from harness.study.run_noise import Case
from harness.study.score_names import LOST, OK, STATUS
from harness.study.store import Store
from support.single_track import PLANT, STUDY


def study(folder, source=PLANT, **changes):
    (folder / "my_plant.py").write_text(source)
    return build_study({**STUDY, **changes}, folder / "foreign.toml")


def scores(study):
    evaluator = StudyEvaluator(study)
    evaluator.warm_up(0)
    results = [evaluator.evaluate(unit) for design in study.designs for unit in units(study, design)]
    said = evaluator.lost()
    evaluator.compiled.simulator.close()
    return {name: np.concatenate([r[name] for r in results]) for name in results[0]}, said


@pytest.fixture
def plain(tmp_path):
    return study(tmp_path)


def test_units_bounds_and_meanings_of_the_class_are_those_of_the_study(plain):
    model, description = plain.plant.model(), plain.plant.external.description
    parameters = {p.name: p for p in model.parameters}
    assert plain.plant.values == {"mass": 1200.0, "yaw_inertia": 1500.0, "front_stiffness": 8e4, "rear_stiffness": 9e4}
    assert parameters["front_stiffness"].unit == "N/rad"
    assert parameters["yaw_inertia"].lower == 100.0
    assert plain.plant.wheelbase == 2.6
    assert plain.plant.process_noise == {"side_force": 1e4}
    assert [round(p.scale, 6) for p in description.inputs] == [0.017453, 0.277778]
    assert plain.plant.sensors == plain.belief.sensors
    assert plain.plant.measurement_noise == {n: plain.belief.measurement_noise[n] for n in model.outputs}
    assert plain.designs[0].factors[0].levels == (1000.0, 1600.0)


def test_a_class_in_any_units_scores_as_it_does_in_si(tmp_path, plain):
    """The class in deg, km/h and kN against itself in SI: units are of no consequence but for rounding."""
    in_si = (
        PLANT.replace('"deg"', '"rad"').replace('"km/h"', '"m/s"').replace('"deg/s"', '"rad/s"').replace('"kN"', '"N"')
    )
    in_si = in_si.replace("/ 3.6", "").replace("math.radians(", "(").replace("math.degrees(", "(")
    in_si = in_si.replace('1000 * u["side_force"]', 'u["side_force"]')
    assert in_si != PLANT
    (tmp_path / "si").mkdir()
    for wanted, got in zip(scores(plain)[0].items(), scores(study(tmp_path / "si", in_si))[0].items(), strict=True):
        np.testing.assert_allclose(got[1], wanted[1], rtol=1e-9, atol=1e-12, err_msg=wanted[0])


def test_measurement_noise_is_that_of_the_believed_vehicle(tmp_path):
    """Runs of a plant of the library and of somebody else meet the same noise of the sensors."""
    still = {**STUDY["drive"][0], "amplitude": "0.001 deg"}
    foreign = study(tmp_path, drive=[still], plant={"python": "my_plant:Plant"})
    own = build_study({**STUDY, "drive": [still], "plant": {**STUDY["belief"], "noise": {"process_scale": 0.0}}})
    unit = units(own, own.designs[0])[0]
    evaluators = StudyEvaluator(own), StudyEvaluator(foreign)
    batches = [e.simulate(unit, e.cases(unit)) for e in evaluators]
    evaluators[1].compiled.simulator.close()
    for batch in batches:
        assert np.abs(batch.measurements).max() > 1e-3
    np.testing.assert_allclose(batches[0].measurements, batches[1].measurements, atol=1e-4)


def test_process_noise_moves_the_plant_and_its_absence_does_not(tmp_path, plain):
    evaluator = StudyEvaluator(plain)
    calm = StudyEvaluator(study(tmp_path, plant={"python": "my_plant:Plant"}))
    unit = units(plain, plain.designs[0])[0]
    cases = evaluator.cases(unit)[:8]
    moved, still = (e.simulate(unit, cases).truth[:, 0] for e in (evaluator, calm))
    for each in (evaluator, calm):
        each.compiled.simulator.close()
    assert np.ptp(still, axis=1).max() == 0.0
    assert np.ptp(moved, axis=1).max() > 1e-4


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("os._exit(5)", "ended with status 5"),
        ("os.kill(os.getpid(), 11)", "SIGSEGV"),
        ("raise ArithmeticError('too light')", "ArithmeticError: too light"),
        ("time.sleep(30)", "within 2 s"),
        ("out = {}", "no output 'lateral_acceleration'"),
        ("self.r = float('nan')", "its output 'yaw_rate' is no number at t = 1 s"),
    ],
)
def test_a_fault_loses_its_run_and_all_others_keep_their_bits(tmp_path, plain, fault, reason):
    source = "import os, time\n" + PLANT.replace(
        "        return out\n", f"        if m < 1100 and self.k == 100:\n            {fault}\n        return out\n"
    )
    whole, _ = scores(plain)
    broken, said = scores(study(tmp_path, source, plant={**STUDY["plant"], "timeout": "2 s"}))
    light = np.arange(len(whole[STATUS])) == 0
    assert (whole[STATUS] == OK).all()
    assert (broken[STATUS][light] == LOST).all()
    for name, values in whole.items():
        assert broken[name][~light].tobytes() == values[~light].tobytes(), name
    assert reason in " ".join(said)
    assert len(said) == 1
    assert "3 runs lost" in said[0]


@pytest.mark.parametrize(
    ("before", "behind", "words"),
    [
        ('"km/h"', '"kg"', "'kg' does not fit the unit 'm/s'"),
        ("yaw_rate", "yaw_rat", "no such signal; closest: yaw_rate"),
        ('"1.2 t"', '"1.2 tt"', "'tt' is no unit"),
        ("def step", "def stepp", "neither simulate"),
        ("parameters = ", "parameter = ", "declares no parameters"),
        ("import math", "import matth", "No module named 'matth'"),
        ("class Plant", "class Car", "has no 'Plant'; there are: Car"),
        (
            "class Plant:",
            "class Plant:\n    def __init__(self, x): pass",
            "missing 1 required positional argument: 'x'",
        ),
        ("import math", "import math, os\nos.abort()", "SIGABRT"),
        ("class Plant", "Plants = 1\nif False:\n  class Plant", "has no 'Plant'; no class or function is in it"),
        ('"2.6 m"', '"0 m"', ": wheelbase: must be positive"),
        ('"2.6 m", 16', '"2.6 m", -16', ": steering_ratio: must be positive"),
        ("1.2, 1.4\n", "1.2, 1.4\n    limits = {'yaw_rate': '-9 deg/s'}\n", "limits.yaw_rate: must be positive"),
        ('"lower": 100.0', '"lower": 1600.0', "parameters.yaw_inertia: it starts at 1500 kg"),
        ('"lower": 100.0', '"lower": 160.0, "upper": 50.0', "its lower bound 160 is above its upper one 50"),
        ("1.2, 1.4\n", "1.2, 1.4\n    limits = {'speed': 3}\n", "'speed' is none of its outputs"),
    ],
)
def test_a_class_that_cannot_be_understood_is_refused_in_one_line(tmp_path, before, behind, words):
    assert before in PLANT
    with pytest.raises(UserError) as refused:
        study(tmp_path, PLANT.replace(before, behind))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    assert "plant.python" in str(refused.value)


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        ({"python": "my_plant"}, "write 'module:Class'"),
        ({"python": "nobodys_plant:Plant"}, "no module 'nobodys_plant'"),
        ({"python": "my_plant:Plant", "fmu": "a.fmu"}, "a plant is one thing"),
        ({"python": "my_plant:Plant", "vehicle": "car"}, "belongs to a vehicle of the library"),
        ({"python": "my_plant:Plant", "map": "a.toml"}, "this belongs to an FMU"),
        ({"python": "my_plant:Plant", "sensors": "car_navigation"}, "does not publish"),
        ({"python": "my_plant:Plant", "values": {"yaw_inertia": 5}}, "lies below 100"),
        ({"python": "my_plant:Plant", "values": {"mas": 5}}, "no parameter 'mas'; closest: mass"),
        ({"python": "my_plant:Plant", "noise": {"process": {"side": 5}}}, "no disturbance 'side'"),
        ({"python": "my_plant:Plant", "timeout": "0 s"}, "give a positive one"),
    ],
)
def test_a_plant_that_is_stated_wrongly_is_refused_with_its_key(tmp_path, plant, words):
    with pytest.raises(UserError, match=words.replace("(", r"\(")):
        study(tmp_path, plant=plant)


@pytest.mark.parametrize(
    ("name", "words"),
    [("yaw/inertia", "separates folders"), ("yaw\\inertia", "separates"), ("m" * 300, "is too long"),
     ("process_noise_scale", "a parameter of the plant as well")],
)  # fmt: skip
def test_a_parameter_that_a_factor_cannot_name_is_refused_with_the_remedy(tmp_path, name, words):
    factor = {"parameter": name, "levels": [1400, 1600]}
    named = {"design": [{"name": "d", "factor": [factor]}]}
    with pytest.raises(UserError, match=f"design.0..factor.0..parameter: .*{words}.*another name in its class"):
        study(tmp_path, PLANT.replace('"yaw_inertia": {', f"{name!r}: {{"), **named)


def test_process_noise_that_a_plant_has_not_cannot_be_scaled(tmp_path):
    factor = {"parameter": "process_noise_scale", "of": "plant", "levels": [1, 4]}
    design = [{"name": "noise", "factor": [factor]}]
    assert study(tmp_path, design=design).designs[0].bands == 2
    with pytest.raises(UserError, match=r"factor.0..parameter: the plant has no process noise to multiply"):
        study(tmp_path, plant={"python": "my_plant:Plant"}, design=design)


def test_a_plant_that_always_fails_is_no_study(tmp_path):
    broken = study(tmp_path, PLANT.replace("        return out\n", "        raise ValueError('no road')\n"))
    with pytest.raises(UserError, match=r"fails before any factor is varied: .*ValueError: no road"):
        StudyEvaluator(broken).warm_up(0)


def test_a_store_says_what_the_plant_is_without_its_file(tmp_path, plain):
    from harness.common.files import parse_toml
    from harness.config.self_contained import self_contained

    content = parse_toml(self_contained(plain), "store")
    (tmp_path / "my_plant.py").unlink()
    again = build_study(content, tmp_path / "foreign.toml")
    assert again.hash == plain.hash
    assert json.loads(json.dumps(again.plant.external.description.as_dict())) == content["plant"]["described"]
    with pytest.raises(UserError, match=r"'my_plant:Plant' is needed, and my_plant\.py is not in"):
        StudyEvaluator(again)
    (tmp_path / "my_plant.py").write_text(PLANT + "# another\n")
    with pytest.raises(UserError, match="its content is another one"):
        StudyEvaluator(again)


def test_another_file_of_the_plant_or_an_estimator_is_named(tmp_path):
    (tmp_path / "mine.py").write_text("class Mine: pass\n")
    estimators = ["ekf", {"name": "mine", "kind": "external", "python": "mine:Mine"}]
    before = study(tmp_path, estimator=estimators)
    was = root_attributes(before)
    (tmp_path / "mine.py").write_text("class Mine: 'another'\n")
    other = study(tmp_path, estimator=estimators)
    assert "estimator 'mine', python" in differences(was, root_attributes(other), other)
    was = root_attributes(other)
    third = study(tmp_path, PLANT + "# another\n", estimator=estimators)
    assert "plant.described.digests.my_plant.py" in differences(was, root_attributes(third), third)


ONCE = (
    "import os, pathlib\nmark = pathlib.Path(__file__).with_name('mark')\nmark.exists() and os.abort()\nmark.touch()\n"
)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (ONCE + PLANT, "plant.python: its process was ended by SIGABRT"),
        (PLANT.replace('"speed": "km/h"}', '"speed": "km/h", "sideslip_angle": "rad"}'), "plant.python: inputs: "),
    ],
    ids=["ends when loaded", "an input that no drive has"],
)
def test_what_a_plant_does_when_it_is_loaded_is_said_with_file_and_key(tmp_path, source, words):
    foreign = study(tmp_path, source)
    with pytest.raises(UserError) as refused:
        StudyEvaluator(foreign).warm_up(0)
    assert str(refused.value).startswith(f"{foreign.path}: {words}")


def test_a_store_and_its_report_say_what_is_believed_and_what_the_signals_are(tmp_path):
    factors = {"mass": ["1.2 t", "1.6 t"], "front_stiffness": ["80 kN/rad", "90 kN/rad"]}
    designs = [{"name": n, "factor": [{"parameter": n, "levels": levels}]} for n, levels in factors.items()]
    foreign = study(tmp_path, design=designs)
    Store(foreign, lambda: StudyEvaluator(foreign), tmp_path / "out")
    store = read(tmp_path / "out")
    assert [d.factors[0].is_believed for d in store.designs] == [True, False]
    blocks = made.blocks(Analysis(store))
    (sheet,) = (b for b in blocks if "variable of the plant" in getattr(b, "header", ()))
    assert ["output", "yaw rate", "yaw_rate", "rad/s", "0.0174532925", "0"] in sheet.rows


def test_a_whole_drive_at_once_is_the_same_as_step_by_step(tmp_path, plain):
    whole = PLANT + (
        "    def simulate(self, time, u, values):\n"
        "        self.reset(values)\n"
        "        rows = [self.step({n: c[k] for n, c in u.items()}, time[1] - time[0]) for k in range(len(time))]\n"
        "        return {n: [row[n] for row in rows] for n in self.outputs}\n"
    )
    (tmp_path / "whole").mkdir()
    stepped, at_once = scores(plain)[0], scores(study(tmp_path / "whole", whole))[0]
    for name, values in stepped.items():
        np.testing.assert_allclose(at_once[name], values, rtol=1e-12, atol=1e-14, err_msg=name)


def test_a_remedy_may_add_the_sensors_that_plant_and_belief_both_have(tmp_path):
    from harness.remedy.choices import equipments

    with_gyro = study(tmp_path, belief={**STUDY["belief"], "sensors": "yaw_rate"})
    assert with_gyro.plant.sensors == "yaw_rate"
    added = {e.sensors for e in equipments(with_gyro)}
    assert "car_series" in added
    assert "car_navigation" not in added


def test_the_report_says_what_the_plant_is_and_where_process_noise_acts(tmp_path, plain):
    from harness.study.layout import root_attributes

    (description,) = (json.loads(root_attributes(s)["description"])["plant"]["foreign"] for s in (plain,))
    assert description["kind"] == "Python class"
    assert description["process_noise_acts_on"] == ["side_force"]
    assert description["units"] == {"side_force": "N"}
    calm = study(tmp_path, PLANT.replace('disturbances = {"side_force": "kN"}', ""), plant={"python": "my_plant:Plant"})
    (description,) = (json.loads(root_attributes(s)["description"])["plant"]["foreign"] for s in (calm,))
    assert "none" in description["process_noise_acts_on"]


def test_the_command_and_the_report_say_which_runs_were_lost_and_the_next_run_tries_them_again(tmp_path):
    source = "import os\n" + PLANT.replace(
        "        return out\n",
        "        if m < 1100 and 'BAD' in os.environ: raise ValueError('too light')\n        return out\n",
    )
    (tmp_path / "my_plant.py").write_text(source)
    (tmp_path / "study.toml").write_text(toml_text(STUDY))

    def harness(*words, **environment):
        command = [sys.executable, "-m", "harness", *words]
        there = {**os.environ, **environment}
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False, env=there)
        assert done.returncode == 0, done.stderr
        return done

    words = "my_plant:Plant: 3 runs lost: ValueError: too light"
    assert words in harness("run", "study.toml", "--out", "res", BAD="1").stderr
    report = (tmp_path / "res" / "report.html").read_text()
    assert words in report
    assert "code lost 3 of 3 runs at 1 t" in report
    assert "goes out of control in" not in report
    assert "lost" in harness("status", "res").stdout
    assert "3 runs to do" in harness("run", "study.toml", "--out", "res").stderr
    report = (tmp_path / "res" / "report.html").read_text()
    assert "code lost" not in report
    assert words not in report
    assert "lost" not in harness("status", "res").stdout


def test_the_page_of_a_result_is_there_without_the_plant_and_a_click_says_what_is_missing(tmp_path, plain, monkeypatch):
    pytest.importorskip("bokeh")
    from harness.view.run_panel import Runs
    from harness.view.study_page import build

    monkeypatch.chdir(tmp_path)
    run_study(plain, tmp_path / "res", jobs=1)
    (tmp_path / "my_plant.py").unlink()
    build(tmp_path / "res")
    with pytest.raises(UserError, match=r"'my_plant:Plant' is needed, and my_plant\.py is not in"):
        Runs(tmp_path / "res").compute(Place(0, 0, 0))


def test_its_sensors_degrade_as_those_of_a_vehicle_do(tmp_path, plain):
    """Of a neutral degradation the bits are those without it; of a bias the readings are off by that."""
    levels = [{"parameter": "dropout_share", "levels": ["0 %", "50 %"]}]
    plant = {**STUDY["plant"], "effects": ["dropout"]}
    degraded = study(tmp_path, plant=plant, design=[{"name": "gaps", "repeats": 2, "factor": levels}])
    without = study(tmp_path, design=[{"name": "gaps", "repeats": 2}])
    evaluators = StudyEvaluator(degraded), StudyEvaluator(without)
    whole, gaps = (u for u in units(degraded, degraded.designs[0]) if u.drive == 0)
    cases = [Case(0, 0), Case(0, 1)]
    batches = [e.simulate(u, cases) for e, u in ((evaluators[0], whole), (evaluators[0], gaps), (evaluators[1], whole))]
    for evaluator in evaluators:
        evaluator.compiled.simulator.close()
    measured = [batch.measurements[..., :2] for batch in batches]
    assert measured[0].tobytes() == measured[2].tobytes()
    missing = np.isnan(measured[1])
    assert missing.mean() == pytest.approx(0.5, abs=0.05)
    assert np.array_equal(measured[1][~missing], measured[0][~missing])


@pytest.mark.parametrize("effects", [["steering_lag"], ["dropout", "dropout"], ["dropout@roll_rate"], ["drupout"]])
def test_other_effects_are_of_vehicles_of_the_library(tmp_path, effects):
    with pytest.raises(UserError, match=r"plant\.effects"):
        study(tmp_path, plant={**STUDY["plant"], "effects": effects})


def test_a_store_keeps_the_degradations_of_its_sensors(tmp_path):
    built = study(tmp_path, plant={**STUDY["plant"], "effects": ["dropout"], "values": {"dropout_share": 0.2}})
    (tmp_path / "again.toml").write_text(self_contained(built))
    again = load_study(tmp_path / "again.toml")
    assert (again.plant.effects, again.plant.values["dropout_share"]) == (("dropout",), 0.2)
