"""The proof's scoring: hand-made traces against hand-made seals, the tables of them, and what the oracle fits."""

import dataclasses
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.attribution import renew
from bench.attribution.__main__ import gathered, main, wanted
from bench.attribution.gate import BLOCK, SHARES, drawn
from bench.attribution.oracle import free_parameters, true_hypotheses, write_oracle
from bench.attribution.renew import MARKS
from bench.attribution.run import NOMINAL, PLANT, Case, Listed, Tracer, listed, task_of, written
from bench.attribution.score import FAILED, SECONDS, load, score, text
from bench.attribution.tables import (
    alarms,
    confusion,
    effects,
    kinds,
    matrix,
    numbers,
    ratio,
    share,
    smallest,
    tables,
    wilson,
)
from harness.diagnosis.criteria import EXCESS
from harness.diagnosis.model.augmented_model import HeldParameters
from harness.diagnosis.run import augmented_model_of
from harness.identification.measured_file import finely
from harness.models.assembly.assemble import assemble
from harness.models.assembly.candidates import placements
from harness.models.assembly.placement import load_effect, split

CANDIDATE = {"round": 1, "kind": "effect", "name": "kingpin_friction", "detectable": {"kingpin_friction": 1000.0}}


def effect(name="kingpin_friction", value=8000.0, equivalent=(), place="", form="same", library=None):
    return {
        "name": name,
        "in_library": True,
        "equivalent": list(equivalent),
        "place": place,
        "parameters": {name: {"value": value, "unit": "N*m"}},
        "oracle": {"form": form, "parameters": {name: value} if library is None else library, "per_drive": {}},
    }


def added(name, **values):
    return {"effect": name, "parameters": {n: {"value": v} for n, v in values.items()}}


def case(
    folder, kind="effect", true=(), excess=(4.0, 0.0), oracle=None, magnitude="medium", repeat=0, recording=(), **traced
):
    """Write what a traced case leaves behind, score it, and return that."""
    name = f"semitrailer-{'+'.join(e['name'] for e in true) or kind}" + (f"-{magnitude}" if magnitude else "")
    verdict = {"none": "adequate", "parameters": "adequate", "unlisted": "unresolved"}.get(kind, "amended")
    sealed = {"case": name, "repeat": repeat, "vehicle": "semitrailer", "kind": kind, "expected_verdict": verdict}
    sealed |= {"effects": list(true), "parameters": {}, "noise": {"yaw_rate_tractor": 0.003}}
    sealed |= {"recording": list(recording)}
    trace = {"verdict": "amended", "added": [], "parameters": [], "confusable": None, "candidates": []}
    trace |= {"excess": {"before": excess[0], "after": excess[1]}} | traced
    own = folder / f"{name}-{repeat}"
    (own / "trace").mkdir(parents=True)
    (own / "sealed.json").write_text(json.dumps(sealed))
    (own / "trace" / "trace.json").write_text(json.dumps(trace))
    if oracle is not None:
        (own / "oracle.json").write_text(json.dumps({"excess": oracle}))
    return score(own)


def test_an_effect_that_was_added_is_found_with_the_error_of_its_parameter(tmp_path):
    found = case(
        tmp_path, true=[effect()], added=[added("kingpin_friction", kingpin_friction=7600.0)], candidates=[CANDIDATE]
    )
    assert (found.right, found.named, found.found, found.first) == (True, 1, 1, "kingpin_friction")
    assert found.errors == {"kingpin_friction": pytest.approx(0.05)}
    assert found.reach == pytest.approx(8.0)
    assert found.size == "8.00 kN·m"


def confusable(*hypotheses):
    """Return a confusable set of models with one hypothesis each, by name and kind."""
    return {"models": [{"added": [[{"name": n, "kind": k}]], "share": 0.5} for n, k in hypotheses]}


def test_values_of_an_equation_of_another_form_are_not_judged(tmp_path):
    own = added("kingpin_friction", kingpin_friction=7600.0)
    assert case(tmp_path, true=[effect(form="similar")], added=[own]).errors == {}


def test_another_effect_is_wrong_unless_the_true_one_stands_in_its_confusable_set(tmp_path):
    claim = {"added": [added("kingpin_damping")]}
    wrong = case(tmp_path, true=[effect()], **claim)
    assert (wrong.right, wrong.found, wrong.first, wrong.extra) == (False, 0, "kingpin_damping", ("kingpin_damping",))
    found = confusable(("kingpin_damping", "effect"), ("kingpin_friction", "effect"))
    alike = case(tmp_path, true=[effect()], repeat=1, confusable=found, **claim)
    assert (alike.right, alike.found, alike.named) == (True, 1, 0)
    assert (alike.covered, alike.in_set, wrong.covered, wrong.in_set) == (True, 2, False, 0)


def test_the_set_covers_a_pair_only_with_one_model_that_has_both(tmp_path):
    pair = [effect(), effect("steering_lag")]
    apart = confusable(("kingpin_friction", "effect"), ("steering_lag", "effect"))
    assert not case(tmp_path, "pair", pair, confusable=apart).covered
    both = {"models": [{"added": [m["added"][0] for m in apart["models"]], "share": 1.0}]}
    assert case(tmp_path, "pair", pair, repeat=1, confusable=both).covered


def test_the_places_of_a_wrong_effect_count_together_and_parameters_do_not(tmp_path):
    names = (("roll_steer@front", "effect", 0.5), ("roll_steer@rear", "effect", 0.45), ("mass", "parameter", 0.97))
    found = [{"name": n, "kind": k, "probability": v} for n, k, v in (*names, ("kingpin_friction", "effect", 0.96))]
    scored = case(tmp_path, "unlisted", [effect()], posterior={"none_of_these": 0.02, "hypotheses": found})
    assert scored.wrong == pytest.approx(0.95)
    less = case(tmp_path, "unlisted", [effect()], repeat=2, posterior={"none_of_these": 0.4, "hypotheses": found})
    assert less.wrong == pytest.approx(0.6)  # one model may have it at both places
    assert math.isnan(case(tmp_path, "unlisted", [effect()], repeat=1).wrong)
    (row,) = (r for r in numbers([scored]).splitlines() if "no wrong name" in r)
    assert "0 of 1" in row


def test_a_fault_that_the_recording_has_is_neither_a_claim_nor_a_wrong_name(tmp_path):
    recording = [{"name": "sensor_delay", "place": "yaw_rate_tractor"}, {"name": "speed_delay", "place": "speed"}]
    named = [{**added("sensor_delay"), "place": "yaw_rate_tractor"}, {**added("speed_delay"), "place": None}]
    found = [{"name": h["effect"], "kind": "effect", "probability": 1.0} for h in named]
    posterior = {"none_of_these": 0.0, "hypotheses": found}
    scored = case(tmp_path, "none", recording=recording, added=named, posterior=posterior)
    assert (scored.right, scored.claimed, scored.recording) == (True, (), ("sensor_delay", "speed_delay"))
    assert (scored.verdict, scored.wrong) == ("adequate", 0.0)
    other = [{**added("sensor_delay"), "place": "yaw_rate_trailer"}]
    assert not case(tmp_path, "none", recording=recording, added=other, repeat=1).right


def test_a_parameter_counts_for_an_effect_only_where_the_seal_says_so(tmp_path):
    wrong_ratio = {"parameters": [added("steering_ratio")], "verdict": "adequate"}
    same = [effect("steering_ratio", equivalent=["parameter:steering_ratio"])]
    named = case(tmp_path, true=same, **wrong_ratio)
    assert (named.right, named.first, named.expected) == (True, "steering_ratio", "adequate")
    other = case(tmp_path, true=[effect()], **wrong_ratio)
    assert (other.right, other.first, other.expected) == (False, "a parameter", "amended")


def test_a_parameter_in_a_confusable_set_is_not_taken_for_the_effect_of_the_same_name(tmp_path):
    found = confusable(("steering_lag", "effect"), ("steering_ratio", "parameter"))
    claim = {"added": [added("steering_lag")], "confusable": found}
    assert not case(tmp_path, true=[effect("steering_ratio")], **claim).right


def test_an_effect_at_another_sensor_is_said_to_be_misplaced(tmp_path):
    true = [effect("sensor_bias", library={"sensor_bias_yaw_rate_tractor": 0.01}, place="yaw_rate_tractor")]
    assert case(tmp_path, true=true, added=[added("sensor_bias", sensor_bias_articulation_angle=0.1)]).misplaced
    here = added("sensor_bias", sensor_bias_yaw_rate_tractor=0.01)
    assert not case(tmp_path, true=true, repeat=1, added=[here]).misplaced


def test_a_pair_needs_both(tmp_path):
    true = [effect(), effect("steering_lag")]
    one = case(tmp_path, "pair", true, added=[added("steering_lag")])
    both = case(tmp_path, "pair", true, repeat=1, added=[added("steering_lag"), added("kingpin_friction")])
    assert [(s.found, s.right) for s in (one, both)] == [(1, False), (2, True)]


@pytest.mark.parametrize("kind", ["none", "parameters"])
def test_where_nothing_is_missing_any_claim_is_a_false_alarm(tmp_path, kind):
    def of(repeat, **traced):
        return case(tmp_path, kind, magnitude="", repeat=repeat, **traced)

    quiet, named = of(0, verdict="adequate"), of(1, verdict="adequate", parameters=[added("trailer_mass")])
    claimed, curve = of(2, added=[added("steering_lag")]), of(3, verdict="amended")
    assert [s.right for s in (quiet, named, claimed, curve)] == [True, True, False, False]
    assert [s.first for s in (quiet, named, claimed, curve)] == ["nothing", "a parameter", "steering_lag", "a curve"]


def test_an_unlisted_effect_is_right_only_if_unresolved(tmp_path):
    true = [effect("kingpin_spring")]
    assert case(tmp_path, "unlisted", true, verdict="unresolved", added=[added("crosswind")]).right
    assert not case(tmp_path, "unlisted", true, repeat=1, verdict="amended", added=[added("crosswind")]).right


@pytest.mark.parametrize(
    ("excess", "oracle", "closed"),
    [
        ((4.0, 0.0), None, 1.0),  # without an oracle the sensors' noise is the floor
        ((4.0, 1.0), 0.25, (2 - 1) / (2 - 0.5)),
        ((4.0, 1.0), 9.0, 0.5),  # an oracle worse than the nominal model is none
        ((None, 1.0), 0.0, 1.0),
        ((4.0, None), 0.0, 0.0),
        ((0.30, 0.28), 0.27, math.nan),  # nothing was to be gained
    ],
)
def test_the_gap_is_that_of_the_root_of_the_excess_between_nominal_and_oracle(tmp_path, excess, oracle, closed):
    assert case(tmp_path, true=[effect()], excess=excess, oracle=oracle).closed == pytest.approx(closed, nan_ok=True)


def test_a_case_that_could_not_be_traced_is_wrong_and_says_why(tmp_path):
    folder = tmp_path / "semitrailer-none-0"
    case(tmp_path, "none", magnitude="", excess=(0.0, 0.0))
    for file in (folder / "trace").iterdir():
        file.unlink()
    (folder / "train_a.csv").write_text("no recording")
    problem = Tracer().run(Case("semitrailer-none", 0, folder))
    assert "train_a.csv" in problem
    assert (folder / FAILED).read_text() == problem
    [found] = gathered(tmp_path)
    assert (found.verdict, found.first, found.right) == ("failed", "failed", False)


@pytest.fixture
def several(tmp_path):
    """Nine of ten medium cases right, one small of two, and two sound cases with one false alarm."""
    good = {"added": [added("kingpin_friction", kingpin_friction=7600.0)], "candidates": [CANDIDATE]}
    bad = {"added": [added("steering_lag")], "candidates": [CANDIDATE], "excess": (4.0, 1.0)}
    found = [case(tmp_path, true=[effect()], repeat=r, **(good if r else bad)) for r in range(10)]
    small = {"true": [effect(value=500.0)], "magnitude": "small"}
    found += [case(tmp_path, repeat=r, **small, **(good if r else bad)) for r in range(2)]
    found.append(case(tmp_path, "none", magnitude="", verdict="adequate", excess=(0.0, 0.0)))
    found.append(case(tmp_path, "parameters", magnitude="", added=[added("steering_lag")]))
    return found


def test_the_command_scores_what_was_traced_and_writes_tables_and_figures(several, tmp_path, capsys):
    for folder in tmp_path.glob("*-*"):
        (folder / "oracle.json").write_text(json.dumps({"excess": 0.0}))
    main(["--traced", "--out", str(tmp_path)])
    assert "semitrailer-kingpin_friction-medium, 0: amended, steering_lag, wrong" in capsys.readouterr().out
    files = {f.name for f in tmp_path.iterdir() if f.is_file()}
    drawn = {f"{name}-semitrailer.svg" for name in ("confusion", "shares", "limits", "gap")}
    assert files == {"attribution.json", "attribution.md", *drawn}
    assert sorted(s.closed for s in load(tmp_path / "attribution.json") if s.magnitude == "small") == [0.5, 1.0]
    assert "| semitrailer-kingpin_friction-small, 1 |" in (tmp_path / "attribution.md").read_text()


def test_draws_of_one_kind_are_those_of_the_gate(tmp_path, monkeypatch):
    """Which cases a gate draws does not depend on the kind that is asked for."""
    asked = []
    monkeypatch.setattr("bench.attribution.__main__.run_all", lambda cases, jobs: asked.append(cases) or [])
    gate = ["--gate", "40", "--first", "4181", "--magnitude", "medium", "--out", str(tmp_path)]
    main(gate)
    main([*gate, "--kind", "pair"])
    kinds = {case.name: case.kind for case in listed()}
    assert asked[1] == [case for case in asked[0] if kinds[case.name] == "pair"]
    assert 0 < len(asked[1]) < 40


def cells(table, first):
    [row] = [r for r in table.splitlines() if r.startswith(f"| {first} |")]
    return [c.strip() for c in row.strip("|").split("|")][1:]


def test_the_interval_is_wilsons():
    """Newcombe (1998), table I: 81 of 263, and 0 of 20."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert share([]) == "–"


def test_numbers_are_those_of_medium_magnitudes(several):
    table = numbers(several)
    assert cells(table, "true effect named first")[0] == "95 %"
    assert cells(table, "true effect named first")[1].startswith("9 of 10, 90 %")
    assert cells(table, "no effect claimed where none is")[1].startswith("1 of 2, 50 %")
    assert cells(table, "parameter error, median")[1] == "5.0 %"
    assert cells(table, "at least 90 % of the gap closed")[1].startswith("9 of 10")
    assert cells(table, "both of two effects found")[1] == "–"


def test_numbers_of_field_recordings_have_their_own_aim_and_are_pooled_over_vehicles(several):
    field = [dataclasses.replace(s, quality="field") for s in several]
    assert cells(numbers(field), "true effect named first")[0] == "85 %"
    assert len(cells(numbers(field), "true effect named first")) == 2
    two = [*field, *(dataclasses.replace(s, vehicle="car") for s in field)]
    assert cells(numbers(two), "true effect named first")[3].startswith("18 of 20")


def test_times_are_of_the_traces_that_had_all_cores(several, tmp_path):
    timed = [replace(s, seconds=seconds) for s, seconds in zip(several, (20.0, 80.4, 31.0), strict=False)]
    row = "| time of a trace on all cores, median and longest | 30 s, 90 s |"
    assert f"{row} 31 s, 80 s (3) |" in numbers([replace(s, vehicle="car") for s in timed])
    assert f"{row} – |" in numbers([replace(s, vehicle="car") for s in several])
    assert math.isnan(several[0].seconds)
    folder = tmp_path / f"{several[0].case}-{several[0].repeat}"
    (folder / SECONDS).write_text("12.5\n")
    assert score(folder).seconds == 12.5


@pytest.mark.parametrize(("threads", "begun", "noted"), [(None, False, True), (1, False, False), (None, True, False)])
def test_the_time_of_a_trace_is_noted_where_it_is_of_the_whole_trace(tmp_path, monkeypatch, threads, begun, noted):
    def trace(task, folder, *_):
        folder.mkdir(exist_ok=True)
        (folder / "trace.json").write_text("{}")

    monkeypatch.setattr("bench.attribution.run.run_trace", trace)
    monkeypatch.setattr(Tracer, "model", lambda *_: (None, None))
    for name in ("sealed.json", "oracle.json"):
        (tmp_path / name).write_text("{}")
    if begun:
        (tmp_path / "trace").mkdir()
    assert Tracer(threads).run(Case("car-none", 0, tmp_path)) == ""
    assert (tmp_path / SECONDS).exists() == noted


def test_shares_are_by_kind_and_magnitude(several):
    assert cells(kinds(several), "effect medium")[0].startswith("9 of 10, 90 % (60 to 98)")
    assert cells(kinds(several), "effect small")[2:] == ["1", "75 %"]
    assert cells(alarms(several), "parameters") == [
        "1 of 1, 100 % (21 to 100)",
        "0 of 1, 0 % (0 to 79)",
        "steering lag 1",
    ]
    assert cells(alarms(several), "both")[0].startswith("1 of 2")


def test_the_smallest_magnitude_found_has_half_of_its_cases_right_and_none_below_that_fails(several):
    row = cells(effects(several), "kingpin friction")
    assert row[:3] == ["1 of 2", "9 of 10", "–"]
    assert row[-2:] == ["0.500 kN·m", "0.5 ×"]
    wrong = [s for s in several if s.magnitude != "small" or not s.right]
    assert {s.magnitude for s in smallest([s for s in wrong if s.kind == "effect"])} == {"medium"}


def test_the_confusion_counts_first_claims(several):
    assert matrix(several)["kingpin_friction"] == {"kingpin_friction": 10, "steering_lag": 2}
    assert matrix(several)["none"] == {"nothing": 1}
    assert cells(confusion(several), "kingpin friction") == ["12", "kingpin friction 10, steering lag 2"]


def test_what_is_saved_is_what_is_read(several, tmp_path):
    (tmp_path / "attribution.json").write_text(text(several))
    assert "NaN" not in text(several)
    assert text(load(tmp_path / "attribution.json")) == text(several)
    assert load(tmp_path / "attribution.json")[0].claimed == several[0].claimed


def test_a_ratio_is_written_with_two_digits_and_no_exponent():
    assert [ratio([v]) for v in (0.714, 9.62, 113.0)] == ["0.71 ×", "9.6 ×", "110 ×"]
    assert ratio([np.nan]) == "–"


def test_the_page_of_the_proof_is_renewed_with_its_figures(several, tmp_path, monkeypatch, capsys):
    results, page = tmp_path / "attribution.json", tmp_path / "attribution.md"
    results.write_text(text(several))
    page.write_text("\n".join(["Why.", *MARKS["clean"], *MARKS["field"], ""]))
    monkeypatch.setattr(renew, "PAGE", page)
    assert not renew.main([str(results)])
    found = page.read_text()
    assert found.startswith("Why.")
    assert "| effect small | 1 of 2, 50 %" in found
    assert "(attribution/shares-semitrailer.svg)" in found
    assert (tmp_path / "attribution" / "shares-semitrailer.svg").exists()
    assert renew.main([str(tmp_path / "nowhere.json")]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_tables_without_cases_are_left_out(several):
    found = tables([s for s in several if s.magnitude in ("small", "large")])
    assert "Against what is asked" not in found
    assert "False alarms" not in found


def test_cases_are_chosen_by_vehicle_and_magnitude():
    names = [case.name for case in listed() if wanted(case.name, "car", "medium")]
    assert {"car-none", "car-crosswind-medium", "car-parameters-mass"} <= set(names)
    assert not any(n.endswith(("-small", "-large")) or n.startswith("semitrailer") for n in names)


PROCESSES = ("road_bank_varying",)


def library(vehicle):
    """Return what the oracle asks of a compiled model, without compiling one."""
    spec = finely({"vehicle": vehicle, **NOMINAL[vehicle]}, 0.01, "test")
    there = placements(spec.vehicle, spec.tyre, spec.sensors)
    placed = tuple(n for n in there if not getattr(load_effect(n), "NOISE", None))
    files = tuple(dict.fromkeys([*(split(n)[0] for n in placed), *PROCESSES]))
    names = assemble(spec.vehicle, spec.tyre, files, spec.sensors, optional=True).parameter_names
    own = {"placements": placed, "processes": PROCESSES, "names": names, "held": HeldParameters()}
    return SimpleNamespace(nominal=spec.model(), stated_std=lambda name: math.inf, **own)


@pytest.mark.parametrize("vehicle", sorted(NOMINAL))
def test_the_library_has_a_form_of_every_effect_but_the_random_road(vehicle, monkeypatch):
    monkeypatch.syspath_prepend(str(PLANT.parent))
    from plant import seal
    from plant_cases import cases, draw
    from plant_environment import Changes

    augmented, without = library(vehicle), set()
    driven = {"test": SimpleNamespace(changes=Changes(10.0, 20.0, 30.0, 40.0), drive=SimpleNamespace(manoeuvres=()))}
    for c in cases().values():
        if c.vehicle != vehicle or c.kind != "effect" or c.magnitude != "medium":
            continue
        sealed = seal(c, 0, draw(c, np.random.default_rng(1)), driven)
        [effect] = sealed["effects"]
        true = true_hypotheses(augmented, effect)
        without |= set() if true else set(c.effects)
        held = {n for h in true for n in (*h.shared, *h.change_times)}
        assert not true or {*effect["oracle"]["parameters"], *effect["oracle"]["per_drive"]["test"]} <= held
        assert not set(free_parameters(sealed, (), augmented)) & {*held, *effect["parameters"]}
        if effect["name"] == "self_steering_axle":  # the seal does not say which: one of them
            assert len(true) > 1
            assert all([n.rpartition("_")[0] for n in h.shared] == ["self_steering", "self_steering_lag"] for h in true)
    assert without == {"road_bank_varying"}


def test_the_oracle_finds_the_truth_up_to_the_noise(tmp_path):
    """A lag of the steering in a plant that shares no code with the fit."""
    case_ = Case("car-steering_lag-medium", 0, tmp_path)
    assert written(case_) == ""
    task, vehicle = task_of(tmp_path)
    others = {split(name)[0] for name in placements(task.spec.vehicle, task.spec.tyre, task.spec.sensors)}
    task = replace(task, train=[shortened(r) for r in task.train], test=[shortened(r) for r in task.test])
    write_oracle(tmp_path, task, augmented_model_of(replace(task, excluded=frozenset(others - {"steering_lag"}))))
    found, sealed = (json.loads((tmp_path / f"{n}.json").read_text()) for n in ("oracle", "sealed"))
    assert vehicle == "car"
    assert found["added"] == ["steering_lag"]
    assert found["parameters"]["steering_lag"] == pytest.approx(0.06, rel=0.05)
    front = sealed["parameters"]["stiffness_peak_front"]
    assert found["parameters"]["stiffness_peak_front"] == pytest.approx(front["true"], rel=0.01)
    assert abs(front["published"] / front["true"] - 1) > 0.01
    assert found["excess"] < EXCESS


def shortened(recording):
    return recording.isel(time=recording["time"] < 30.0)


def test_draws_at_random_hold_the_shares_and_depend_on_their_number_alone():
    kinds = {"none": 1, "parameters": 2, "effect": 5, "pair": 2, "unlisted": 2}
    cases = [Listed(f"{v}-{k}-{i}", k) for v in ("car", "semitrailer") for k, n in kinds.items() for i in range(n)]
    found = drawn(cases, 0, 20 * BLOCK)
    for block in (found[:BLOCK], found[BLOCK : 2 * BLOCK]):
        assert {k: sum(f"-{k}-" in name for name, _ in block) for k in SHARES} == SHARES
    assert drawn(cases, 100, 80) == found[100:180]
    assert {name for name, _ in found} == {case.name for case in cases}
    cars = sum(name.startswith("car-") for name, _ in found)
    assert abs(cars / len(found) - 0.5) < 4 * 0.5 / np.sqrt(len(found))
    assert [n for _, n in found] == list(range(20 * BLOCK))


def test_a_case_that_is_new_leaves_earlier_draws_what_they_were():
    cases = [Listed(f"car-effect-{i}", kind) for i in range(3) for kind in SHARES]
    later = drawn([*cases, Listed("car-effect-new", "effect", BLOCK)], 0, 6 * BLOCK)
    assert later[:BLOCK] == drawn(cases, 0, BLOCK)
    assert "car-effect-new" in {name for name, _ in later[BLOCK:]}
