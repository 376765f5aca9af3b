"""Results of the long reproductions: what is saved is read, and is old once the code that decides it changes."""

import dataclasses

import numpy as np
import pytest

from harness.common import sources
from harness.common.errors import UserError
from reproductions import sun_em, sun_em_report
from reproductions.published.results import Missing, Stored
from reproductions.stored import LONG, STAMP, WRITING, load, save

NAME = "identify-em"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / NAME).mkdir()
    save(tmp_path / NAME, NAME, "python -m it --repeats 3", {"truth": np.arange(3.0)})
    return tmp_path


def test_what_is_saved_is_read_with_its_origin(folder):
    arrays, stamp = load(folder / NAME, NAME)
    assert list(arrays) == ["truth"]
    assert arrays["truth"].tolist() == [0.0, 1.0, 2.0]
    assert stamp["code"] == LONG[NAME].code()
    origin = Stored(folder, folder).origin(NAME)
    assert (origin.state, origin.command) == ("current", "python -m it --repeats 3")
    assert origin.made == stamp["made"][:10]


@pytest.mark.parametrize("out", ["--out /home/me/em", "--out='/home/me/my em'", "--out results/em"])
def test_the_command_is_that_of_a_reader(folder, out):
    save(folder / NAME, NAME, f"python -m it {out} --repeats 3", {"truth": np.arange(3.0)})
    between = "=" if "=" in out else " "
    assert Stored(folder, folder).origin(NAME).command == f"python -m it --out{between}results/{NAME} --repeats 3"


def test_another_code_makes_it_old(folder, monkeypatch):
    fewer = dataclasses.replace(LONG[NAME], methods=LONG[NAME].methods[:1])
    assert fewer.code() != LONG[NAME].code()
    monkeypatch.setitem(LONG, NAME, fewer)
    assert Stored(folder, folder).origin(NAME).state == "older than the code that decides it"


def test_a_result_without_a_stamp_is_not_current(folder):
    np.savez(folder / NAME / LONG[NAME].file, truth=np.ones(2))
    origin = Stored(folder, folder).origin(NAME)
    assert origin.state == "its code was not kept"
    assert not origin.current
    assert Stored(folder, folder).arrays(NAME)["truth"].tolist() == [1.0, 1.0]


def test_what_is_missing_or_damaged_is_named_with_its_command(folder, tmp_path):
    with pytest.raises(Missing, match="make study-identify-swarm"):
        Stored(folder, folder).arrays("identify-swarm")
    assert Stored(folder, folder).origin("identify-swarm").state == "missing"
    (folder / NAME / LONG[NAME].file).write_bytes(b"PK nothing")
    with pytest.raises(UserError, match=r"identify\.npz: is damaged.*make study-identify-em"):
        load(folder / NAME, NAME)


def test_reports_do_not_decide_a_result():
    with_report = sources.modules([sun_em])
    assert sun_em_report.__name__ in with_report
    without = sources.modules([sun_em], WRITING)
    assert not [m for m in without if m.endswith("_report") or m.startswith(("harness.reporting", "harness.cli"))]
    assert "harness.identification.methods.em" in without
    assert sources.digest([sun_em], WRITING) != sources.digest([sun_em])


def test_the_drives_of_a_reproduction_decide_it(tmp_path):
    swarm = LONG["identify-swarm"]
    changed = tmp_path / "drives.toml"
    with open(swarm.drives, encoding="utf-8") as drives:
        changed.write_text(drives.read().replace('speed = "22 m/s"', 'speed = "21 m/s"'))
    assert dataclasses.replace(swarm, drives=str(changed)).code() != swarm.code()


def test_the_stamp_is_not_one_of_the_arrays(folder):
    assert STAMP not in load(folder / NAME, NAME)[0]
