"""The numbers of the criteria, halved and doubled: replaced wherever they are used, traced once, and compared."""

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from bench.attribution import sensitivity
from bench.attribution.changed_criteria import STATED, Change, changes, make
from bench.attribution.run import Case
from bench.attribution.score import Scored
from bench.attribution.sensitivity import Traced, changed, differences, drawn, read, run, shown, tables
from harness.common.errors import UserError
from harness.diagnosis import criteria

ROOT = Path(__file__).parents[2]

USED = """
import inspect, json, pkgutil, sys
from bench.attribution.changed_criteria import changes, make
for change in changes():
    if change.way == "doubled":
        make(change)
import harness.diagnosis
from harness.diagnosis import criteria
for module in pkgutil.walk_packages(harness.diagnosis.__path__, "harness.diagnosis."):
    __import__(module.name)
found = {}
for name, module in list(sys.modules.items()):
    if name.startswith("harness.diagnosis.") and module is not criteria:
        for number in vars(criteria):
            if number.isupper() and number in vars(module):
                found.setdefault(number, []).append(vars(module)[number] is vars(criteria)[number])
from harness.diagnosis.residuals.unmodelled import _NEEDED
from harness.diagnosis.selection.posterior import Posterior
mass = inspect.signature(Posterior.confusable).parameters["mass"].default
stated = {n: v for n, v in vars(criteria).items() if n.isupper() and n not in ("PRIORS", "HORIZONS")}
print(json.dumps({"found": found, "half": _NEEDED, "mass": mass, "stated": stated}))
"""

DECIDED = """
from types import SimpleNamespace
from bench.attribution.changed_criteria import changes, make
[make(c) for c in changes() if c.label == "{label}"]
from harness.diagnosis.selection.validation import leaves_nothing
print(leaves_nothing(SimpleNamespace(unexplained=0.07), SimpleNamespace(normalised_excess_mse=1.0)))
"""


def in_process(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout.strip()


def numbers():
    """Every number of the criteria, the fields of the table of priors each by itself."""
    plain = [n for n in vars(criteria) if n.isupper() and n != "PRIORS"]
    return [*plain, *(f"PRIORS.{f.name}" for f in dataclasses.fields(criteria.PRIORS))]


def test_every_number_is_halved_and_doubled_and_stays_what_it_is():
    found = {c.label: c.value for c in changes()}
    assert sorted(found) == sorted(f"{n}:{way}" for n in numbers() for way in ("halved", "doubled"))
    assert (found["BIC_NEEDED:halved"], found["BIC_NEEDED:doubled"]) == (25.0, 100.0)
    assert (found["MOST:halved"], found["MOST:doubled"]) == pytest.approx((1 / 3, 2 / 3))
    assert (found["MASS:halved"], found["MASS:doubled"]) == pytest.approx((0.95, 0.8))
    assert (found["TRIED:halved"], found["TRIED:doubled"]) == (2, 6)
    assert (found["WHITE:halved"], found["WHITE:doubled"]) == pytest.approx((1e-9, 1e-7))
    assert found["HORIZONS:doubled"] == (0.0, 0.2, 2.0, 20.0, math.inf)
    assert found["PRIORS.odds:halved"]["many"] == pytest.approx(0.015)
    assert (found["PRIORS.misfit:halved"], found["PRIORS.misfit:doubled"]) == pytest.approx((1.25, 2.0))


def test_a_number_is_replaced_wherever_it_is_used():
    """As it is, as a part of another constant, and as a default."""
    told = json.loads(in_process(USED))
    assert set(told["found"]) == {n for n in vars(criteria) if n.isupper()}
    assert all(all(same) for same in told["found"].values())
    assert told["stated"]["BIC_NEEDED"] == 100.0
    assert told["half"] == 50.0
    assert told["mass"] == pytest.approx(0.8)


@pytest.mark.parametrize(("label", "left"), [("EXCESS:halved", "False"), ("EXCESS:doubled", "True")])
def test_what_is_decided_follows_the_number(label, left):
    """An excess of 0.07 is something with the limit at 0.025, and nothing with 0.1."""
    assert in_process(DECIDED.format(label=label)) == left


def test_a_number_that_was_taken_already_is_not_replaced():
    with pytest.raises(RuntimeError, match="was imported before MOST was replaced"):
        make(Change("MOST", "doubled", 0.5, 0.6))
    assert criteria.MOST == 0.5


def scored(folder="car-none-500", **values):
    fields = {f.name: () for f in dataclasses.fields(Scored)}
    fields |= {"case": folder, "kind": "effect", "verdict": "amended", "expected": "amended", "true": ("crosswind",)}
    fields |= {"claimed": ("crosswind",), "first": "crosswind", "closed": 1.0, "covered": True, "in_set": 1}
    return Scored(**(fields | values))


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({}, []),
        ({"closed": 0.995}, []),
        ({"closed": 0.9}, ["gap closed"]),
        ({"closed": math.nan}, ["gap closed"]),
        ({"claimed": ("crosswind", "road_bank"), "extra": ("road_bank",)}, ["names", "false claims"]),
        ({"verdict": "adequate", "claimed": (), "first": "nothing"}, ["verdict", "names", "true effect first"]),
        ({"covered": False}, ["in the set"]),
        ({"recording": ("sensor_delay",)}, ["faults of the recording"]),
    ],
)
def test_what_changes_is_told(other, told):
    assert differences(scored(), scored(**other)) == told


def test_a_gap_that_is_not_there_does_not_change():
    assert differences(scored(closed=math.nan), scored(closed=math.nan)) == []


def test_traces_that_are_the_same_to_the_bit_are_told_from_those_that_end_alike():
    stated = [Traced(scored(), "a"), Traced(scored(), "b")]
    assert changed(stated, stated) == "nothing, to the bit"
    assert changed(stated, [stated[0], Traced(scored(), "c")]) == "nothing"
    assert changed(stated, [stated[0], Traced(scored(in_set=2), "c")]) == "size of the set of 1"
    assert (
        changed(stated, [Traced(scored(covered=False), "d"), Traced(scored(covered=False), "c")]) == "in the set of 2"
    )


def test_a_name_that_is_given_twice_is_drawn_twice(tmp_path):
    found = drawn(["car-none", "car-crosswind-small", "car-none"], 500, "clean", tmp_path)
    assert [(c.name, c.repeat) for c in found] == [("car-none", 500), ("car-crosswind-small", 500), ("car-none", 501)]
    assert len({c.folder for c in found}) == 3


def traces(monkeypatch, tmp_path, stop=None):
    """Take what is traced from here; return what was asked for."""
    asked = []

    def traced(label, folders):
        for folder in folders:
            if len(asked) == stop:
                raise KeyboardInterrupt
            asked.append((label, folder.name))
            yield folder, ""

    def of_folder(folder):
        label, case = asked[-1]
        named = ("crosswind",) if label != "MOST:doubled" or case == "one" else ("road_bank",)
        return Traced(scored(case, claimed=named, first=named[0]), label)

    monkeypatch.setattr(sensitivity, "prepare", lambda cases: None)
    monkeypatch.setattr(sensitivity, "traced", traced)
    monkeypatch.setattr(sensitivity, "of_folder", of_folder)
    return asked


def test_an_interrupted_run_goes_on_where_it_stopped_and_the_tables_say_what_changed(tmp_path, monkeypatch, capsys):
    cases = [Case(name, 0, tmp_path / name) for name in ("one", "two")]
    chosen, file = [c for c in changes() if c.number == "MOST"], tmp_path / "results.jsonl"
    first = traces(monkeypatch, tmp_path, stop=3)
    with pytest.raises(KeyboardInterrupt):
        run(cases, chosen, file)
    rest = traces(monkeypatch, tmp_path)
    found = run(cases, chosen, file)
    asked = [(label, name) for label in (STATED, "MOST:halved", "MOST:doubled") for name in ("one", "two")]
    assert (first, rest) == (asked[:3], asked[3:])
    assert "6 of 6: MOST:doubled, two: amended, road_bank" in capsys.readouterr().err
    assert len(file.read_text().splitlines()) == 6
    table = tables(chosen, cases, found)
    assert "| `MOST` | 0.5 | 0.3333: nothing | 0.6667: names of 1, true effect first of 1 |" in table
    assert "| `MOST` doubled | two | amended; crosswind; " in table
    assert read(file, "other code") == {}


def test_a_process_that_ends_early_is_an_error(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(UserError, match="the traces with NONE:doubled ended with exit status 1"):
        list(sensitivity.traced("NONE:doubled", [tmp_path]))


def test_numbers_are_written_as_they_are():
    assert [shown(v) for v in (1e-8, 0.9995, 3, (0.0, math.inf), {"effect": 0.15})] == [
        "1e-8", "0.9995", "3", "0, ∞", "effect 0.15"
    ]  # fmt: skip


def test_the_command_writes_the_tables_of_what_was_traced(tmp_path, monkeypatch, capsys):
    """``make sensitivity`` where everything is there already: no number is taken again."""
    code = sensitivity.sources.digest([sensitivity.changed_criteria])
    for label in (STATED, "MOST:halved", "MOST:doubled"):
        named = ("crosswind",) if label != "MOST:doubled" else ("road_bank",)
        new = Traced(scored(claimed=named, first=named[0]), label)
        sensitivity.append(tmp_path / "sensitivity.jsonl", code, label, "car-crosswind-small-500", new)
    arguments = ["--cases", "car-crosswind-small", "--numbers", "MOST", "--out", str(tmp_path)]
    assert sensitivity.main(arguments) == 0
    page = (tmp_path / "sensitivity.md").read_text(encoding="utf-8")
    assert "| `MOST` | 0.5 | 0.3333: nothing | 0.6667: names of 1, true effect first of 1 |" in page
    assert page in capsys.readouterr().out


def test_a_case_that_is_none_is_told(tmp_path):
    """The process of a change, as it is begun for each."""
    done = in_process(f"from bench.attribution.changed_criteria import main\nmain(['stated', {str(tmp_path)!r}])")
    told = json.loads(done)
    assert told["folder"] == str(tmp_path)
    assert "belief.json" in told["problem"] or "train_a.csv" in told["problem"]
