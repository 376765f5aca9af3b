"""``harness remedy``: what is tried, how it is judged, and that what is written can be used."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from harness.common.errors import UserError
from harness.config import build_study
from harness.engine.simd.lanes import LANES
from harness.remedy import choices
from harness.remedy.answer import _poor_drives, answer
from harness.remedy.choices import AS_IT_IS, Equipment, Remedy
from harness.remedy.judge import Promise, RemedyOutcome, best, harm, helps, judged, promises
from harness.remedy.report import belief_text, believed, write_remedy
from harness.remedy.run import _more_estimated, try_remedies
from harness.study.bound import smallest_rmse
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.results import read
from harness.study.run_noise import Case
from harness.study.score_names import ESTIMATOR_DIVERGED, OK, PLANT_DIVERGED
from harness.study.tolerance import Tolerance
from support import synthetic

CONTENT = {
    "name": "small",
    "targets": ["articulation_angle"],
    "drive": [{"name": "sine", "kind": "sine", "speed": "15 m/s", "amplitude": "50 deg", "duration": "20 s"}],
    "plant": {
        "vehicle": "semitrailer",
        "parameters": "ziaukas_2023",
        "tyre": "magic_formula",
        "sensors": "series",
    },
    "belief": {"unknown_inputs": ["steering_wheel_angle"], "values": {"trailer_mass": "24 t"}},
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
    "design": [{"name": "level", "factor": [{"parameter": "trailer_mass", "levels": ["8 t", "24 t"]}]}],
}


def study(**changes):
    return build_study({**CONTENT, **changes}, "small")


def test_the_prior_is_the_root_mean_square_of_what_the_study_varies():
    (factor,) = choices.parameters(study())
    assert choices.prior(factor) == pytest.approx(16e3 / np.sqrt(2))
    wide = {"name": "box", "samples": 2, "factor": [{"parameter": "trailer_mass", "range": ["18 t", "30 t"]}]}
    (factor,) = choices.parameters(study(design=[wide]))
    assert choices.prior(factor) == pytest.approx(12e3 / np.sqrt(12))


def test_larger_equipment_measures_all_that_the_study_has_and_more():
    found = choices.equipments(study())
    assert {e.sensors for e in found} >= {"series", "stability_control"}
    assert {e.added for e in found if e.sensors == "series"} == {("steering_wheel_angle",)}
    assert all(e.added for e in found)
    assert "car_series" not in {e.sensors for e in found}


def test_a_remedy_changes_the_belief_and_leaves_drives_noise_and_points():
    before = study()
    equipment = next(e for e in choices.equipments(before) if e.sensors == "stability_control" and e.inputs)
    after = choices.applied(before, Remedy(estimated=("trailer_mass",), equipment=equipment), "UKF")
    assert after.belief.estimated_parameters == ("trailer_mass",)
    assert (after.plant.sensors, after.belief.unknown_inputs) == ("stability_control", ())
    assert (after.seed, after.designs) == (before.seed, before.designs)
    assert [(d.name, d.kind, d.options) for d in after.drives] == [(d.name, d.kind, d.options) for d in before.drives]
    assert [e.name for e in after.estimators] == ["UKF"]
    assert choices.applied(before, Remedy(ideal_parameters=("trailer_mass",)), "EKF").designs[0].factors[0].of == "both"


def test_a_bank_is_spread_over_what_the_study_varies():
    before = study()
    after = choices.applied(before, Remedy(banked=("trailer_mass",)), "EKF")
    (bank,) = after.estimators
    assert (bank.name, bank.kind) == ("EKF", "imm")
    values = bank.settings["hypotheses"]["trailer_mass"]
    np.testing.assert_allclose(values, [8e3 * 3**0.25, 8e3 * 3**0.75])  # each stands for a half of the range
    assert after.belief.estimated_parameters == ("trailer_mass",)
    assert Remedy(banked=("trailer_mass",)).words == "run a bank of filters over the trailer mass"


def test_over_more_than_three_parameters_no_bank_is_tried():
    drivers = list("abcd")
    assert not [r for r in choices.singles(drivers, True, True) if r.banked]
    assert [r for r in choices.singles(drivers[:3], True, True) if r.banked]
    assert not [r for r in choices.singles(drivers[:3], False, True) if r.banked]


def test_one_more_driver_is_estimated_or_banked_in_its_place():
    one = Remedy(estimated=("b",))
    found = choices.enlarged(one, tuple("abc"), True)
    assert [(r.estimated, r.banked) for r in found] == [
        (("a", "b"), ()),
        (("b", "c"), ()),
        (("b",), ("a",)),
        (("b",), ("c",)),
    ]
    assert [r.banked for r in choices.enlarged(one, tuple("abc"), False)] == [(), ()]
    further = choices.enlarged(Remedy(estimated=("b",), banked=("a",)), tuple("abcd"), True)
    assert [(r.estimated, r.banked) for r in further] == [(("b", "c"), ("a",)), (("b", "d"), ("a",))]


def test_a_bank_estimates_what_is_estimated_beside_it():
    levels = [{"parameter": p, "range": r} for p, r in (("trailer_mass", ["12 t", "36 t"]), ("friction", [0.6, 1.0]))]
    before = study(design=[{"name": "box", "samples": 2, "factor": levels}])
    after = choices.applied(before, Remedy(estimated=("trailer_mass",), banked=("friction",)), "EKF")
    (bank,) = after.estimators
    assert set(after.belief.estimated_parameters) == {"trailer_mass", "friction"}
    assert bank.settings["hypotheses"]["trailer_mass"] == [24e3]
    assert len(bank.settings["hypotheses"]["friction"]) == choices.VALUES


def test_of_what_promises_most_nothing_with_as_many_signals_tells_more():
    one, two, other, three = (Equipment(n, (), tuple("abc"[:k]), ()) for n, k in zip("pqrs", (1, 2, 2, 3), strict=True))
    promise = {one: 0.5, two: 0.4, other: 0.2, three: 0.19}
    assert choices.promising(promise, 9) == [one, other]
    assert choices.promising(promise, 1) == [one]


def test_the_written_belief_has_the_noise_that_the_estimator_is_tuned_to(tmp_path):
    """A study that takes it scores as the one whose estimator is tuned by the file."""
    factors = "process = 0.3\nunknown_inputs = 40.0\nmeasurement = 2.5"
    (tmp_path / "noise.toml").write_text(f'rule = "r"\ndrives = []\nbudget = 1\n[estimator.EKF]\n{factors}\n')
    remedy = Remedy(tuned=True)
    assert (remedy.words, remedy.slug) == ("tune for the worst case", "tune-for-the-worst-case")
    tuned = choices.applied(study(), remedy, "EKF", tmp_path / "noise.toml")
    best = SimpleNamespace(study=tuned, remedy=remedy)
    (tmp_path / "belief.toml").write_text(belief_text(SimpleNamespace(best=best, study=study())))
    taken = build_study({**CONTENT, "belief": {"parameters": "belief.toml"}}, tmp_path / "s")
    found = []
    for some in (tuned, taken):
        evaluator, unit, cases = StudyEvaluator(some), Unit(0, 0, 0, 0, 1), [Case(0, 0)]
        batch, held = evaluator.simulate(unit, cases, 500), evaluator.held(unit, cases, "belief")
        found.append(evaluator.estimate(0, unit, cases, batch, held).log_likelihood)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    assert tuned.estimators[0].noise
    assert not taken.estimators[0].noise
    assert str(tmp_path) not in tuned.text  # equal runs give equal files, wherever they are written to
    named = build_study(
        {**CONTENT, "estimator": [{"name": "EKF", "kind": "ekf"}], "tuning": str(tmp_path / "noise.toml")}
    )
    assert tuned.estimators[0].noise == named.estimators[0].noise
    assert tuned.tuning == named.tuning


def outcome(remedy, medians, nominal=1.0, boxes=None):
    values = np.array([medians], dtype=float)
    scores = {"medians": values, "home": 0, "nominal": np.array([nominal]), "worst": values.max(axis=1), "lost": 0.0}
    rest = {"nees": 1.0, "consistent": 1.0, "boxes": boxes or {}, "states": 3, "step_time": 1.0}
    return RemedyOutcome(remedy, None, [], ["a", "b"], **scores, **rest)


def test_of_remedies_that_are_about_as_good_the_one_that_needs_less_is_taken():
    sensor = Remedy(equipment=Equipment("s", (), ("a",), ()))
    first, bare = outcome(AS_IT_IS, [1.0, 4.0]), outcome(Remedy(estimated=("p",)), [1.0, 1.05])
    measured, lost = outcome(sensor, [1.0, 1.0]), outcome(Remedy(considered=("p",)), [1.0, np.inf])
    assert best([first, bare, measured, lost], first) is bare
    assert harm(lost, first) == np.inf
    assert helps(bare, first)
    assert not helps(outcome(sensor, [1.0, 3.5]), first)
    assert best([first, outcome(Remedy(estimated=("p",)), [1, 2]), measured], first) is measured


def box(size):
    none = np.zeros(0)
    return {0: Tolerance(nominal=0.5, box=size, typical=size, holds=0.9, lower=none, upper=none, rays=8)}


def test_a_box_that_grows_from_nothing_helps_and_the_larger_one_is_taken():
    first = outcome(AS_IT_IS, [1.0], boxes=box(0.0))
    some = outcome(Remedy(tuned=True), [1.0], boxes=box(0.2))
    more = outcome(Remedy(estimated=("p",)), [3.0], boxes=box(0.5))
    none = outcome(Remedy(considered=("p",)), [0.1], boxes=box(0.0))
    assert best([first, some, more, none], first) is more
    assert (harm(first, first), harm(none, first)) == (1.0, 1.0)
    assert helps(some, first)
    assert not helps(none, first)


def test_runs_of_a_vehicle_out_of_control_are_not_the_estimators(tmp_path):
    fates = np.array([OK, OK, PLANT_DIVERGED, ESTIMATOR_DIVERGED])

    def judged_with(statuses, name):
        data = synthetic.design(
            estimators=("EKF",), levels=(8.0,), drives=("sine",), targets={"articulation_angle": ("rad", 0.01)},
            repeats=4, status=lambda all_runs: np.copyto(all_runs[0, 0, 0, :, 0], statuses),
        )  # fmt: skip
        data["rmse"][0, 0, 0, :, 0, 0] = np.deg2rad([1.0, 3.0, 9.0, 9.0])
        return judged(AS_IT_IS, study(), read(synthetic.write(tmp_path / name, {"level": data})), 1.0)

    some = judged_with(fates, "some")
    assert (some.medians[0, 0], some.worst[0]) == (pytest.approx(3.0), np.inf)  # of 1, 3 and the diverged one
    assert some.lost == pytest.approx(1 / 3)
    none = judged_with(np.full(4, PLANT_DIVERGED), "none")
    assert (none.medians[0, 0], none.worst[0], none.lost) == (np.inf, np.inf, 1.0)


def test_all_that_drives_the_error_is_told_in_short():
    sensor = Equipment("series", (), ("steering_wheel_angle",), ("steering_wheel_angle",))
    remedy = Remedy(estimated=("trailer_mass", "friction"), equipment=sensor)
    assert remedy.phrase_with_sensors(("friction", "trailer_mass")) == "estimate both, with steering wheel angle"
    assert remedy.words == "estimate the trailer mass and friction, with steering wheel angle"
    assert Remedy(considered=("a", "b", "c")).phrase(("a", "b", "c")) == "consider all three"
    assert Remedy(considered=("a",)).phrase(("a",)) == "consider the a"


def test_one_more_parameter_is_estimated_as_long_as_that_gains():
    """Alone ``b`` is best, ``a`` beside it gains, ``c`` besides does not; of all four nothing is asked again."""
    harms = {"": 1.0, "a": 0.9, "b": 0.5, "c": 0.6, "d": 2.0, "ab": 0.3, "bc": 0.4, "bd": 0.9, "abc": 0.35, "abd": 0.5}
    asked = []

    def attempt(remedy):
        asked.append("".join(remedy.estimated))
        return outcome(remedy, [harms[asked[-1]]])

    first = outcome(AS_IT_IS, [1.0])
    alone = [outcome(Remedy(estimated=(n,)), [harms[n]]) for n in "abcd"]
    plan = SimpleNamespace(drivers=tuple("abcd"), impossible={}, banks=False)
    found = _more_estimated(attempt, [first, *alone], plan, Console(quiet=True))
    assert asked == ["ab", "bc", "bd", "abc", "abd"]
    assert best([first, *alone, *found], first).remedy.estimated == ("a", "b")
    asked.clear()
    _more_estimated(attempt, [first, *(outcome(o.remedy, [1.0]) for o in alone)], plan, Console(quiet=True))
    assert not asked  # none alone gains anything


def test_a_bank_over_one_more_is_tried_where_estimating_gains():
    asked = []

    def attempt(remedy):
        asked.append("".join(remedy.estimated) + "".join(f" over {n}" for n in remedy.banked))
        return outcome(remedy, [{"a over b": 0.2}.get(asked[-1], 0.9)])

    first, alone = outcome(AS_IT_IS, [1.0]), outcome(Remedy(estimated=("a",)), [0.5])
    plan = SimpleNamespace(drivers=("a", "b"), impossible={}, banks=True)
    (found,) = _more_estimated(attempt, [first, alone], plan, Console(quiet=True))
    assert asked == ["a over b"]  # both estimated stand elsewhere
    assert found.remedy == Remedy(estimated=("a",), banked=("b",))


def test_what_is_promised_of_a_target_is_the_bound_with_the_parameter_known_where_it_is_hardly_unknown():
    def smallest(levels, equipments=()):
        factor = {"parameter": "trailer_mass", "levels": levels}
        found, lost = promises(
            study(design=[{"name": "level", "factor": [factor]}]), "EKF", ["trailer_mass"], equipments
        )
        assert not lost
        return found

    known = study(design=[{"name": "nominal", "repeats": LANES}])
    bound = smallest_rmse(StudyEvaluator(known), Unit(0, 0, 0, 0, 1))
    sure = smallest(["23.999 t", "24.001 t"])[None].smallest
    np.testing.assert_allclose(sure, np.rad2deg(bound[None]), rtol=1e-3)
    (equipment,) = (e for e in choices.equipments(study()) if e.sensors == "series")
    unsure = smallest(["8 t", "24 t"], [equipment])
    assert unsure[None].smallest[0, 0] > 1.1 * sure[0, 0]
    assert unsure[equipment].smallest[0, 0] < unsure[None].smallest[0, 0]
    assert unsure[equipment].share < unsure[None].share <= 1.0


def test_drives_that_do_not_excite_are_those_for_what_the_remedy_estimates():
    sensor = Equipment("series", (), ("steering_wheel_angle",), ("steering_wheel_angle",))
    promise = {sensor: Promise(np.array([[0.1, 0.9], [0.8, 0.2]]), np.ones((2, 1)))}
    of = SimpleNamespace(drives=[SimpleNamespace(name="turn"), SimpleNamespace(name="highway")])
    tried = SimpleNamespace(drivers=("a", "b"), promise=promise, study=of)
    assert _poor_drives(tried, sensor, ("a",)) == ["highway"]
    assert _poor_drives(tried, sensor, ("a", "b")) == ["turn", "highway"]


def test_a_study_that_varies_no_parameter_of_the_plant_is_refused():
    noise = {"name": "noise", "factor": [{"parameter": "process_noise_scale", "levels": [1, 2]}]}
    with pytest.raises(UserError, match="varies no parameter of the plant"):
        choices.main_design(study(design=[noise]))


def test_an_estimator_that_the_study_lacks_is_refused(tmp_path):
    with pytest.raises(UserError, match="no such estimator; there are EKF, UKF"):
        try_remedies(study(), tmp_path, "PF")


@pytest.fixture(scope="module")
def tried(tmp_path_factory):
    folder = tmp_path_factory.mktemp("remedy")
    return try_remedies(study(), folder, most=1, jobs=1), folder


@pytest.mark.proof  # eight models are compiled
def test_finding_the_mass_with_the_steering_measured_is_found_to_help(tried):
    found, _ = tried
    remedy = found.best.remedy
    assert ("trailer_mass",) in (remedy.estimated, remedy.banked)
    assert "steering_wheel_angle" in remedy.added
    assert remedy.words in answer(found)
    assert found.ideal.medians.max() <= found.best.medians.max() < found.outcomes[0].medians.max()


@pytest.mark.proof  # eight models are compiled
def test_what_is_finished_is_not_run_again(tried):
    found, folder = tried
    stores = sorted(folder.glob("*/run.json"))  # written where anything was run
    before = [s.stat().st_mtime_ns for s in stores]
    again = try_remedies(study(), folder, most=1, jobs=1)
    assert [s.stat().st_mtime_ns for s in stores] == before
    assert len(again.outcomes) == len(found.outcomes) == len(stores) - 1
    assert all(np.array_equal(a.medians, b.medians) for a, b in zip(again.outcomes, found.outcomes, strict=True))


@pytest.mark.proof  # eight models are compiled
def test_the_same_in_another_folder_gives_the_same_files(tried, tmp_path):
    """All but reports and records of runs, which tell durations."""
    found, folder = tried
    other = tmp_path / "a folder of another name"
    again = try_remedies(study(), other, most=1, jobs=1)
    for one, out in ((found, folder), (again, other)):
        write_remedy(one, out, "harness remedy small")
    files = [
        {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()} for out in (folder, other)
    ]
    differing = {name for name in files[0].keys() | files[1].keys() if files[0].get(name) != files[1].get(name)}
    assert {Path(name).name for name in differing} <= {"report.html", "report.pdf", "run.json"}


@pytest.mark.proof  # eight models are compiled
def test_the_belief_that_is_written_is_that_of_the_remedy(tried):
    found, folder = tried
    assert [o for o in found.outcomes if o.remedy.banked]
    names = [p.name for p in write_remedy(found, folder, "harness remedy small")]
    assert names == ["report.html", "report.pdf", "belief.toml", "study.toml"]
    assert not (folder / "errors.txt").exists()
    plant = CONTENT["plant"] | {"sensors": found.best.study.plant.sensors}
    taken = build_study(CONTENT | {"plant": plant, "belief": {"parameters": "belief.toml"}}, folder / "s").belief
    wanted = believed(found.best.study)
    assert dataclasses.replace(taken, parameters="") == dataclasses.replace(wanted, parameters="")
