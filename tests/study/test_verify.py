"""What ``harness verify`` and ``harness status`` say of whole, damaged, growing and unlike stores."""

import json
import shutil

import numpy as np
import pytest
import zarr

from harness.common import places
from harness.common.errors import UserError
from harness.common.lock import locked
from harness.study import checksums, sealed_root
from harness.study.checksums import faults
from harness.study.evaluate import StudyEvaluator
from harness.study.plan import progress
from harness.study.results import read
from harness.study.run import run_study
from harness.study.store import STORE
from harness.study.stored import study_of
from harness.study.verify import verify
from support.probe_study import bits

pytestmark = pytest.mark.usefixtures("same_checkout")

RMSE = "level/rmse/c.1.0.0.0.0.0"


def test_a_whole_store_holds_and_computes_to_the_same_bits(study, finished):
    found = verify(finished, lambda: study, sample=100)
    assert found.holds
    assert (found.finished, len(found.recomputed), found.runs) == (6, 6, 28)
    assert found.files == len(bits(finished))
    assert not found.other_code
    assert len(verify(finished, lambda: study, sample=2).recomputed) == 2


def test_a_score_that_was_changed_with_its_checksum_is_found_by_computing_it_again(study, copy):
    level = zarr.open_group(copy / STORE, path="level", mode="r+")
    level["rmse"][1, 0, 0, 3, 0, 1] = np.nextafter(level["rmse"][1, 0, 0, 3, 0, 1], 1.0)
    assert verify(copy, lambda: study).lost
    sums = zarr.open_group(copy / STORE, path="checksums", mode="r+")["level"]
    files = checksums.chunk_files(sums.attrs, ("level", 1, 0, 0))
    sums[1, 0, 0] = [checksums.digest(content) for content in places.contents(copy / STORE, list(files.values()))]
    found = verify(copy, lambda: study, sample=100)
    assert not found.lost
    assert found.differing == ["level, 24 t, weave, samples 0 to 0: 'rmse' computed again is not what is stored"]


def test_every_lost_file_is_named(study, copy):
    (copy / STORE / RMSE).unlink()
    (copy / STORE / "band" / "nis" / "c.0.0.1.0.0").write_bytes(b"")
    found = verify(copy, lambda: pytest.fail("nothing to compute"))
    assert [str(f) for f in found.lost] == [f"{RMSE} is missing", "band/nis/c.0.0.1.0.0 is damaged"]
    assert not found.holds


def test_a_study_of_another_text_cannot_be_computed_again(study, finished, load):
    other = load()
    with pytest.raises(UserError, match="every file is as it was written, but nothing can be computed again") as caught:
        verify(finished, lambda: other)
    assert "give the study of this result with --study" in str(caught.value)
    assert verify(finished, lambda: other, sample=0).holds


def test_a_folder_without_a_store(tmp_path, study):
    for look in (progress, lambda folder: verify(folder, lambda: study)):
        with pytest.raises(UserError, match="there is no result of a study here"):
            look(tmp_path)
    (tmp_path / STORE).mkdir()
    for look in (progress, read, study_of, lambda folder: verify(folder, lambda: study)):
        with pytest.raises(UserError, match=r"scores\.zarr: not a store that a study wrote; run"):
            look(tmp_path)


def _flip(file, old, new):
    content = file.read_text(encoding="utf-8")
    assert old in content
    file.write_text(content.replace(old, new, 1), encoding="utf-8")


ROOTS = {
    "a limit or a word": lambda store: _flip(store / "zarr.json", "keep its promises", "keep its premises"),
    "no JSON": lambda store: (store / "zarr.json").write_text("{"),
    "gone": lambda store: (store / "zarr.json").unlink(),
    "a copied array": lambda store: _flip(store / "zarr.json", "root mean square error", "root mean square terror"),
    "the copy": lambda store: _flip(store / "checksums" / "zarr.json", "keep its promises", "keep its premises"),
    "no copy": lambda store: (store / "checksums" / "zarr.json").unlink(),
}


@pytest.mark.parametrize("damage", ROOTS)
def test_a_damaged_root_is_refused_and_mended(study, finished, copy, damage):
    ROOTS[damage](copy / STORE)
    file = "checksums/zarr.json" if "copy" in damage and damage != "a copied array" else "zarr.json"
    with pytest.raises(UserError, match=rf"{file} is (damaged|missing); 'harness run' with the study 'probe'"):
        read(copy)
    assert verify(copy, lambda: study).lost
    run_study(study, copy, jobs=1)
    content = bits(copy)
    assert content.keys() == bits(finished).keys()
    for name, wanted in bits(finished).items():
        if content[name] != wanted:  # the same words in another order
            assert json.loads(content[name]) == json.loads(wanted)
            assert str(name) in ("zarr.json", "checksums/zarr.json")
    assert sealed_root.faults(copy / STORE) == []


def test_new_words_are_sealed(study, copy, tmp_path):
    import dataclasses

    run_study(dataclasses.replace(study, title="Another question"), copy, jobs=1)
    assert sealed_root.faults(copy / STORE) == []
    assert read(copy).attributes["title"] == "Another question"


def test_status_of_a_finished_store(finished):
    found = progress(finished)
    assert (found.name, found.planned, found.done, found.lost, found.writer) == ("probe", 28, 28, [], None)
    assert [(c.design, c.estimator, c.planned, c.done) for c in found.counts] == [
        ("level", "EKF", 20, 20),
        ("band", "EKF", 8, 8),
    ]


def test_status_of_one_that_has_lost_and_lacks_something(study, finished, tmp_path, monkeypatch):
    real, seen = StudyEvaluator.evaluate, []

    def interrupted(self, unit):
        if len(seen) == 3:
            raise KeyboardInterrupt
        seen.append(unit)
        return real(self, unit)

    monkeypatch.setattr(StudyEvaluator, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "cut", jobs=1)
    found = progress(tmp_path / "cut")
    assert (found.planned, found.done, found.rate, found.left) == (28, 15, None, None)
    with locked(tmp_path / "cut", "a test"):
        at_work = progress(tmp_path / "cut")
    assert at_work.writer.startswith("a test, process")
    assert at_work.left == pytest.approx(13 / at_work.rate)
    (tmp_path / "cut" / STORE / "level" / "rmse" / "c.0.0.0.0.0.0").write_bytes(b"x")
    (tmp_path / "cut" / STORE / "level" / "status" / "c.0.0.1.0.0").write_bytes(b"x")
    damaged = progress(tmp_path / "cut")
    assert (damaged.done, len(damaged.lost)) == (5, 2)


def test_status_without_the_metadata_of_a_design(copy):
    shutil.rmtree(copy / STORE / "band")
    found = progress(copy)
    assert found.lost
    assert [c.design for c in found.counts] == ["level"]
    (copy / STORE / "zarr.json").unlink()
    with pytest.raises(UserError, match=r"zarr\.json is missing; 'harness run' with the study 'probe'"):
        progress(copy)


def test_chunks_of_a_killed_writer_go(study, finished, copy):
    (copy / STORE / "level" / "rmse" / "c.0.abc.partial").write_bytes(b"half")
    run_study(study, copy, jobs=1)
    assert bits(copy) == bits(finished)
    assert faults(copy / STORE) == []


def test_chunks_of_earlier_stores_lie_in_folders():
    about = {"arrays": {"rmse": ["band", "sample", "drive", "repeat"]}}
    assert checksums.chunk_files(about, ("level", 1, 2, 0)) == {"rmse": "level/rmse/c/1/2/0/0"}
    here = checksums.chunk_files({**about, "repeat_chunks": 2, "separator": "."}, ("level", 1, 5, 3))
    assert here == {"rmse": "level/rmse/c.1.2.3.1"}
