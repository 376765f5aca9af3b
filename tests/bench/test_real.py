"""The realistic plants' cases: what is drawn, recorded, written and sealed, and the scoring of hand-made traces."""

import ast
import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bench.real
from bench.attribution.__main__ import main
from bench.attribution.gate import REAL_SHARES, drawn
from bench.attribution.run import Case, listed
from bench.attribution.score import FAILED
from bench.real import plant
from bench.real.cases import CASES, DESIGNS, Truth, draw, drive_case, seeds
from bench.real.changes import KINDS, LACKS, MAGNITUDES
from bench.real.driver import RUN_IN
from bench.real.run import TRACE, trace_case, trace_command
from bench.real.score import Answer, answer_of, gathered, score, tables
from bench.real.sensors import DELAY, SPEED_STEP, Fault, draw_logger, record
from bench.real.vehicle import STEP
from harness.common.files import parse_toml
from harness.models.assembly.placement import split
from harness.models.roles import EFFECTS

FOLDER = Path(bench.real.__file__).parent
OF_PLANT = ("vehicle", "specimens", "driver", "sensors", "changes", "cases", "plant", "multi_body")


def test_the_plants_import_nothing_of_the_project():
    allowed = {"numpy", "numba", "vehiclemodels", *sys.stdlib_module_names}
    own = {"bench.real", *(f"bench.real.{name}" for name in OF_PLANT)}
    for file in [FOLDER / f"{name}.py" for name in OF_PLANT] + [FOLDER / "__init__.py", FOLDER.parent / "__init__.py"]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module]
            for name in names:
                assert name in own or name.split(".")[0] in allowed, f"{file.name} imports {name}"
            assert not (isinstance(node, ast.Name) and node.id == "__import__")


# --- sensors


def recorded(fault, seed=0, **different):
    """Return what is recorded of signals that grow by 1 per s, by a logger without noise."""
    logger = draw_logger("car", np.random.default_rng(1))
    quiet = dict.fromkeys(logger.noise, 0.0)
    logger = replace(logger, noise=quiet, gains=dict.fromkeys(quiet, 1.0), radius=0.0, own_clock=False, **different)
    t = np.arange(round((RUN_IN + 10.0) / STEP) + 1) * STEP - RUN_IN
    columns = record(dict.fromkeys(quiet, t), logger, fault, np.random.default_rng(seed))
    return logger, columns


def test_channels_are_late_and_stand_in_their_steps():
    logger, columns = recorded(Fault())
    t = columns["time"]
    assert t.size == 1001
    assert all(DELAY[0] <= late <= DELAY[1] for late in logger.delays.values())
    late = np.nanmean(t - columns["speed"])
    assert late == pytest.approx(logger.delays["speed"], abs=1e-4)
    wheel = np.degrees(columns["steering_wheel_angle"]) / 0.1
    assert wheel[np.isfinite(wheel)] == pytest.approx(np.round(wheel[np.isfinite(wheel)]), abs=1e-6)
    assert np.nanmax(np.abs(columns["speed"] / SPEED_STEP % 1.0 - 0.5)) > 0.499


def test_a_fault_of_a_sensor_comes_on_top():
    _, right = recorded(Fault())
    fault = Fault({"yaw_rate": 0.1}, {"lateral_acceleration": 1.0}, {"steering_wheel_angle": 0.2}, 0.02)
    _, wrong = recorded(fault)
    there = slice(50, None)
    assert np.nanmean(wrong["lateral_acceleration"] - right["lateral_acceleration"]) == pytest.approx(1.0, abs=1e-3)
    assert np.nanmean(right["steering_wheel_angle"] - wrong["steering_wheel_angle"]) == pytest.approx(0.2, abs=1e-3)
    assert np.nanmedian(wrong["yaw_rate"][there] / right["yaw_rate"][there]) == pytest.approx(1.1, rel=1e-2)
    assert np.nanmedian(wrong["speed"][there] / right["speed"][there]) == pytest.approx(1.02, rel=1e-3)


# --- cases


def test_every_kind_of_change_names_effects_and_parameters_of_the_library():
    later = {"body_roll", "brake_pull", "axle_compliance_steer", "steering_compliance_lag", "tyre_curvature"}
    assert len(KINDS) == 15
    for case in CASES.values():
        truth = draw(case, np.random.default_rng(seeds(case, 0)[0]))
        change = truth.change
        assert (change is None) == case.name.endswith("-none")
        if change is None:
            continue
        assert change.names
        for name in change.names:
            if name.startswith("parameter:"):
                assert name.removeprefix("parameter:") in truth.sheet
            else:
                assert name in EFFECTS.names() or name in later
        assert set(change.values) <= set(truth.values) | {
            f"{k}_{a}" for k in ("pull", "askew") for a in ("front", "rear")
        }


def test_a_plant_lacks_only_what_its_equations_cannot_have():
    for vehicle in ("car", "semitrailer", "multi_body"):
        names = [n for n in CASES if n.startswith(f"{vehicle}-")]
        assert len(names) == 2 * (1 + len(MAGNITUDES) * (15 - len(LACKS.get(vehicle, ()))))


def test_the_change_comes_after_the_days_before_it():
    case = CASES["car-baseline-mass-large"]
    first, monday, _, today, _ = seeds(case, 0)
    truth = draw(case, np.random.default_rng(first))
    sound = Truth(truth.sheet, truth.values, truth.column, truth.logger, None)
    before, _ = drive_case(case, truth, "monday", monday)
    same, _ = drive_case(case, sound, "monday", monday)
    assert all(np.array_equal(before[c], same[c], equal_nan=True) for c in before)
    after, story = drive_case(case, truth, "today", today)
    otherwise, _ = drive_case(case, sound, "today", today)
    moved = after["yaw_rate"] - otherwise["yaw_rate"]
    assert np.nanstd(moved) > 0.005
    assert 2.5 < story["lateral_acceleration"] < 7.5
    assert 0.015 < story["roll"] < 0.08


def test_the_command_writes_what_the_tracer_gets_and_then_the_seal(tmp_path, capsys, monkeypatch):
    columns = {"time": np.arange(3) * 0.01, "speed": np.array([20.0, math.nan, 20.1])}
    monkeypatch.setattr(plant, "drive_case", lambda *_: (columns, {"lateral_acceleration": 3.0}))
    assert plant.main(["--case", "semitrailer-baseline-load_shift-medium", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "monday.csv").read_text() == "time,speed\n0,20\n0.01,\n0.02,20.1\n"
    sealed = json.loads((tmp_path / "sealed.json").read_text())
    assert (sealed["kind"], sealed["design"], sealed["magnitude"]) == ("baseline-changed", "baseline", "medium")
    shift = sealed["change"]["parameters"]["trailer_cog_from_rear"]
    assert shift == pytest.approx(sealed["change"]["size"])
    table = parse_toml((tmp_path / "nominal.toml").read_text(), "nominal.toml")
    assert table["vehicle"] == "semitrailer"
    assert "sealed" not in capsys.readouterr().out
    assert plant.main(["--list"]) == 0
    with pytest.raises(SystemExit):
        plant.main(["--case", "car-none", "--out", str(tmp_path)])
    assert "closest" in capsys.readouterr().err


# --- the gate


def test_a_gate_has_its_shares_in_a_block_and_two_vehicles():
    cases = [case for case in listed("real") if not case.name.startswith("multi_body")]
    block = sum(REAL_SHARES.values())
    kinds = {case.name: case.kind for case in cases}
    draws = drawn(cases, 0, block, REAL_SHARES)
    counts = {kind: sum(kinds[name] == kind for name, _ in draws) for kind in REAL_SHARES}
    assert counts == REAL_SHARES == {"baseline-none": 40, "baseline-changed": 60, "alone-changed": 60}
    assert draws[7] == drawn(cases, 7, 1, REAL_SHARES)[0]
    assert {name.split("-")[0] for name, _ in draws} == {"car", "semitrailer"}


# --- the trace and its scoring


def folder_of(tmp_path, name="car-baseline-mass-medium", **traced):
    """Write a seal, and beside it what a trace leaves behind."""
    case, folder = CASES[name], tmp_path / f"{name}-0"
    truth = draw(case, np.random.default_rng(seeds(case, 0)[0]))
    (folder / TRACE).parent.mkdir(parents=True)
    (folder / "sealed.json").write_text(json.dumps(plant.seal(case, 0, truth, {})))
    (folder / "belief.json").write_text(json.dumps({"vehicle": "car"}))
    if case.design == "baseline":
        (folder / "monday.csv").write_text("")
    if traced:
        changes = traced.pop("changes", [])
        error = {"yaw_rate": {"before": 4.0, "after": 0.5}}
        whole = {"verdict": "amended", "error": error, "added": [], "parameters": []} | traced
        whole |= {"baseline": {"changes": changes} if case.design == "baseline" else None}
        (folder / TRACE).write_text(json.dumps(whole))
    return folder


def changed(name, change, std, kind="parameter"):
    """Return a change as ``trace.json`` has it."""
    return {"hypothesis": name, "kind": kind, "parameter": name, "change": change, "std": std}


def sets(*names):
    return {"models": [{"added": [[{"name": n, "kind": k}]], "share": 0.5} for n, k in names]}


def test_a_named_change_is_right_with_its_interval(tmp_path):
    true = json.loads((folder_of(tmp_path / "seal") / "sealed.json").read_text())["change"]["parameters"]["mass"]
    likely = sets(("mass", "parameter"), ("friction", "parameter"))
    scored = score(folder_of(tmp_path, changes=[changed("mass", true + 5.0, 4.0)], confusable=likely))
    assert (scored.first, scored.covered, scored.in_set, scored.holds) == (True, True, 2, True)
    off = score(folder_of(tmp_path / "off", changes=[changed("mass", true + 9.0, 4.0)]))
    assert (off.first, off.holds) == (True, False)
    other = score(folder_of(tmp_path / "other", changes=[changed("yaw_inertia", 1.0, 1.0)]))
    assert (other.first, other.holds, other.covered) == (False, None, False)


def test_a_change_without_a_name_is_an_alarm_too(tmp_path):
    assert not score(folder_of(tmp_path, "car-baseline-none", verdict="adequate")).alarm
    assert score(folder_of(tmp_path / "unnamed", "car-baseline-none", verdict="unresolved")).alarm


def test_what_every_plant_has_is_no_invention_unless_it_was_to_be_a_change(tmp_path):
    claim = {"hypotheses": [{"name": n, "kind": "effect", "probability": 0.95} for n in ("sensor_delay@yaw_rate",)]}
    alone = score(folder_of(tmp_path, "car-alone-mass-medium", posterior=claim))
    assert math.isnan(alone.wrong)
    assert score(folder_of(tmp_path, posterior=claim)).wrong == 0.95
    slosh = {"hypotheses": [{"name": "liquid_slosh", "kind": "effect", "probability": 0.97}]}
    assert score(folder_of(tmp_path / "slosh", "car-alone-mass-medium", posterior=slosh)).wrong == 0.97


@pytest.mark.parametrize(
    ("after", "worse"),
    [((1.0, 1.0), False), ((0.5, 1.2), False), ((0.99, 1.05), True), ((None, 0.5), True), ((None, None), True)],
)
def test_an_error_that_grew_over_all_outputs_is_worse(tmp_path, after, worse):
    error = {
        name: {"before": 1.0, "after": a} for name, a in zip(("yaw_rate", "lateral_acceleration"), after, strict=True)
    }
    assert score(folder_of(tmp_path, error=error)).worse is worse


def test_a_trace_that_ended_in_an_error_is_wrong_and_stands_in_the_table(tmp_path):
    folder = folder_of(tmp_path)
    (folder / FAILED).write_text("no")
    scored = score(folder)
    assert (scored.verdict, scored.first, scored.covered) == ("failed", False, False)
    assert gathered(tmp_path) == [scored] or scored.seconds != scored.seconds
    assert "| ended without a report | 0 | 1 of 1" in tables(gathered(tmp_path))
    assert answer_of({"verdict": "adequate", "added": [], "parameters": []}) == Answer("adequate", (), (), {})


def test_a_case_is_traced_by_the_command_once(tmp_path, monkeypatch):
    folder = folder_of(tmp_path)
    command = trace_command(folder, 1)
    assert command[command.index("--baseline") + 1].endswith("monday.csv")
    assert [command[k + 1].rsplit("/", 1)[-1] for k, c in enumerate(command) if c in ("--train", "--test")] == [
        "today.csv",
        "today2.csv",
    ]
    alone = trace_command(folder_of(tmp_path, "car-alone-none"))
    assert (alone.count("--train"), "--baseline" in alone) == (2, False)
    monkeypatch.setattr(
        "bench.real.run.trace_command", lambda *_: [sys.executable, "-c", "raise SystemExit('nothing')"]
    )
    assert trace_case(folder) == "nothing"
    assert (folder / FAILED).read_text() == "nothing\n"
    (folder / TRACE).write_text("{}")
    assert trace_case(folder) == ""


def test_the_command_of_the_proof_scores_what_was_traced(tmp_path, capsys):
    folder_of(tmp_path, "car-baseline-none", changes=[changed("liquid_slosh", 1.0, 0.1, "effect")])
    folder = tmp_path / "car-baseline-none-0"
    assert Case("car-baseline-none", 0, folder, "real").folder.exists()
    main(["--quality", "real", "--traced", "--cases", "car-baseline-none", "--out", str(tmp_path)])
    assert "baseline, nothing changed: a change claimed | 5 % | 1 of 1" in capsys.readouterr().out
    assert "liquid_slosh" in (tmp_path / "attribution.md").read_text()


def test_names_of_what_every_plant_has_are_effects_of_the_library():
    later = {"body_roll", "brake_pull", "axle_compliance_steer", "steering_compliance_lag", "tyre_curvature"}
    assert {split(name)[0] for name in plant.THERE} - set(EFFECTS.names()) <= later
    assert set(DESIGNS) == {"baseline", "alone"}
