"""What is said before a run begins, what a folder holds that is another's, and who may write there."""

import dataclasses
import json
import re
import tracemalloc

import pytest

from harness.common.errors import UserError
from harness.common.lock import locked
from harness.config import load_study
from harness.study import design, plan, provenance
from harness.study.evaluate import StudyEvaluator
from harness.study.run import run_study
from harness.study.store import STORE
from support.probe_study import STUDY, bits

pytestmark = pytest.mark.usefixtures("same_checkout")


def test_another_study_in_the_folder_is_left_alone(study_file, finished, tmp_path):
    before = bits(finished)
    other = tmp_path / "other.toml"
    for change, message in (
        (('name = "probe"', 'name = "another"'), "holds the result of study 'probe', not of 'another'"),
        (("seed = 0", "seed = 1"), "another study called 'probe': seed 0 there, 1 here; choose another folder"),
        (("repeats = 5", "repeats = 6"), "design[0].repeats 5 there, 6 here"),
        (("samples = 4", "samples = 4\nrepeats = 3"), "design[1].repeats absent there, 3 here"),
    ):
        other.write_text(STUDY.replace(*change))
        with pytest.raises(UserError, match=re.escape(message)):
            run_study(load_study(other), finished, jobs=1)
    assert bits(finished) == before
    assert not (finished / "run.lock").exists()


def test_a_changed_file_that_the_study_names_is_told(study, finished):
    with pytest.raises(UserError, match="the texts agree, so that a file differs that it names"):
        run_study(dataclasses.replace(study, hash="another"), finished, jobs=1)


def test_a_result_of_other_code_is_refused_with_the_difference(study, finished, monkeypatch):
    monkeypatch.setattr("harness.study.provenance.engine_hash", lambda study: "other")
    monkeypatch.setattr("harness.study.layout.commit", lambda: "that one")
    with pytest.raises(UserError, match=re.escape("other code of this project")) as caught:
        run_study(study, finished, jobs=1)
    assert "(commit this one there, that one here)" in str(caught.value)
    real = json.loads(provenance.code_state(study)["versions"])
    versions = json.dumps({**real, "numba": "0.1"})
    monkeypatch.setattr("harness.study.layout.code_state", lambda _: {"engine": "this one", "versions": versions})
    with pytest.raises(UserError, match=re.escape(f"(numba {real['numba']} there, 0.1 here)")):
        run_study(study, finished, jobs=1)


def test_restart_says_what_it_throws_away(study, finished, copy, console):
    (copy / "mine.txt").write_text("kept")
    (copy / STORE / "level" / "rmse" / "c.0.0.0.0.0.0").unlink()
    run_study(study, copy, jobs=1, console=console, restart=True)
    said = console.file.getvalue()
    assert f"thrown away: the result of study 'probe' in {copy}, 6 finished units, computed by commit this one" in said
    assert "28 runs to do" in said
    assert bits(copy) == bits(finished)
    assert (copy / "mine.txt").exists()


def test_restart_keeps_the_result_where_the_study_cannot_run(study, finished, copy, monkeypatch):
    def broken(evaluator, index):
        raise UserError("the plant does not start")

    monkeypatch.setattr("harness.study.evaluate.StudyEvaluator.warm_up", broken)
    with pytest.raises(UserError, match="does not start"):
        run_study(study, copy, jobs=1, restart=True)
    assert bits(copy) == bits(finished)


def test_restart_leaves_alone_what_is_no_result(study, tmp_path):
    (tmp_path / STORE).mkdir()
    (tmp_path / STORE / "data").write_text("mine")
    with pytest.raises(UserError, match="not a result of this harness, so that --restart leaves it alone"):
        run_study(study, tmp_path, jobs=1, restart=True)
    assert (tmp_path / STORE / "data").read_text() == "mine"


def test_what_a_run_takes_is_said_before_it_begins(study, tmp_path, console, monkeypatch):
    asked, real = [], StudyEvaluator.evaluate
    monkeypatch.setattr(StudyEvaluator, "evaluate", lambda *_: pytest.fail("begun"))
    monkeypatch.setattr(plan, "LONG", 0.0)

    def refuse(cost):
        asked.append(cost)
        raise UserError("no")

    with pytest.raises(UserError, match="no"):
        run_study(study, tmp_path / "out", jobs=2, console=console, agree=refuse)
    assert re.fullmatch(r"28 runs to do: about \d+ s with 2 workers, at most 1 MB on disk", asked[0])
    assert asked[0] in console.file.getvalue()
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(StudyEvaluator, "evaluate", real)
    run_study(study, tmp_path / "out", jobs=2, console=console)
    run_study(study, tmp_path / "out", jobs=2, agree=refuse)  # nothing is left to be agreed to


def test_a_hundred_million_runs_are_asked_about_within_little_memory(study, tmp_path, console):
    level = dataclasses.replace(study.designs[0], repeats=100_000_000)
    large = dataclasses.replace(study, designs=(level,), history=())

    def refuse(cost):
        raise UserError(cost)

    tracemalloc.start()
    # How long it takes depends on the machine (hours or days), so any duration is right here.
    cost = r"400,000,000 runs to do: about [\d,.]+ (h|days) with 2 workers, at most \d+ GB"
    with pytest.raises(UserError, match=cost):
        run_study(large, tmp_path / "out", jobs=2, console=console, agree=refuse)
    assert tracemalloc.get_traced_memory()[1] < 500e6
    tracemalloc.stop()


def test_points_that_take_long_to_lay_out_are_asked_about_before(study, tmp_path, console, monkeypatch):
    monkeypatch.setattr(design, "unit_box", lambda *_: pytest.fail("laid out"))
    factor = dataclasses.replace(study.designs[0].factors[0], levels=(2e4,), lower=(1e4,), upper=(3e4,), labels=("a",))
    box = dataclasses.replace(study.designs[0], factors=(factor,), base_samples=2**24, repeats=1)

    def refuse(cost):
        raise UserError(cost)

    with pytest.raises(UserError, match=r"33,554,432 runs to do: a time that is not estimated before you agree"):
        run_study(dataclasses.replace(study, designs=(box,), history=()), tmp_path / "out", 2, console, agree=refuse)


def test_more_jobs_than_units_are_no_more_threads(study, tmp_path, console):
    run_study(study, tmp_path / "out", 10**9, console)
    assert (tmp_path / "out" / "run.json").exists()


def test_a_second_runner_on_one_folder_is_refused(study, finished):
    with locked(finished, "a test"), pytest.raises(UserError, match=r"being written by another process: a test, proc"):
        run_study(study, finished, jobs=1)
    run_study(study, finished, jobs=1)
