"""A result folder that somebody has prepared: links out of it, pipes, stores of another format, forged metadata."""

import contextlib
import gc
import json
import os
import pickle
import re
import shutil
import signal
from functools import partial

import pytest
import zarr

from harness.common import stores
from harness.common.errors import UserError
from harness.config import build_study
from harness.study import checksums, sealed_root
from harness.study.plan import progress
from harness.study.results import read
from harness.study.run import run_study
from harness.study.store import STORE, discard
from harness.study.stored import attributes_of
from harness.study.verify import verify
from support import synthetic
from support.probe_study import bits

pytestmark = pytest.mark.usefixtures("same_checkout", "answered")

READING = {"report": read, "status": progress, "verify": lambda folder: verify(folder, lambda: pytest.fail("no"), 0)}
REFUSED = {"link": "is a link", "pipe": "is no file but a pipe or a device"}


@pytest.fixture
def answered():
    """Fail a test that waits, as for a pipe, in place of waiting with it."""

    def waits(*_):
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, waits)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def elsewhere(tmp_path):
    """A folder that nothing may be written to."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "file").write_text("precious")
    yield folder
    assert {p.name: p.read_text() for p in folder.iterdir()} == {"file": "precious"}


PLACES = (
    "", "zarr.json", "level", "level/zarr.json", "level/rmse", "level/rmse/zarr.json", "level/rmse/c.0.0.0.0.0.0",
    "level/target", "level/target/c/0", "checksums", "checksums/zarr.json", "checksums/level", "checksums/level/c/0/0",
    "checksums/level/c/0/0/0/0", "history", "history/zarr.json", "history/0", "history/0/time/c/0",
)  # fmt: skip
"""Files and folders of a store of each kind."""


@contextlib.contextmanager
def replaced(kind, path, elsewhere):
    """Have a link or a pipe in the place of a file or folder."""
    aside = path.with_name("aside")
    path.rename(aside)
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(elsewhere if aside.is_dir() else elsewhere / "file")
    yield
    path.unlink()
    aside.rename(path)


@pytest.mark.parametrize("kind", REFUSED)
def test_links_and_pipes_in_a_store_are_refused_by_whoever_reads_it(copy, elsewhere, kind):
    for place in PLACES:
        with replaced(kind, copy / STORE / place, elsewhere):
            for look in READING.values():
                with pytest.raises(UserError, match=REFUSED[kind]) as refused:
                    look(copy)
                assert str(copy / STORE / place) in str(refused.value)
                assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize(
    "place", [STORE, f"{STORE}/level/rmse", f"{STORE}/history", f"{STORE}/level/rmse/c.0.0.0.0.0.0", "run.lock"]
)
def test_a_run_writes_through_no_link(study, copy, elsewhere, kind, place, console):
    (copy / "run.lock").touch()
    with replaced(kind, copy / place, elsewhere), pytest.raises(UserError, match=REFUSED[kind]):
        run_study(study, copy, 1, console)


@pytest.mark.parametrize("name", ["new", "file"])
@pytest.mark.parametrize("place", [STORE, f"{STORE}.new", "run.lock", "run.json", "run.json.part"])
def test_a_new_result_is_written_through_no_link(study, tmp_path, elsewhere, console, place, name):
    out = tmp_path / "out"
    out.mkdir()
    (out / place).symlink_to(elsewhere / name)
    if place in (STORE, "run.lock"):
        with pytest.raises(UserError, match="is a link"):
            run_study(study, out, 1, console)
    else:
        run_study(study, out, 1, console)
        assert not any(p.is_symlink() for p in out.rglob("*"))


def test_a_result_with_links_is_thrown_away_without_what_they_lead_to(copy, elsewhere):
    (copy / STORE / "link").symlink_to(elsewhere)
    assert "thrown away" in discard(copy)
    assert not (copy / STORE).exists()


class _Runs:
    """Runs a command when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


def older_format(path, mark):
    """Write a store of Zarr 2, an array of which is unpickled when it is read."""
    group = zarr.open_group(path, mode="w", zarr_format=2)
    group.create_group("level")
    status = path / "level" / "status"
    status.mkdir()
    metadata = {"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "compressor": None, "fill_value": "",
                "order": "C", "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]}  # fmt: skip
    (status / ".zarray").write_text(json.dumps(metadata))
    (status / ".zattrs").write_text(json.dumps({"_ARRAY_DIMENSIONS": ["band"]}))
    (status / "0").write_bytes(pickle.dumps(_Runs(mark)))
    group.attrs.update({"designs": ["level"], "study_name": "x"})  # and no checksums, as of an early version


@pytest.mark.parametrize("command", [*READING, "run", "restart"])
def test_a_store_of_another_format_is_refused_and_nothing_in_it_is_run(study, tmp_path, monkeypatch, command, console):
    monkeypatch.setattr("numcodecs.pickles.ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)  # as earlier ones do
    older_format(tmp_path / "result" / STORE, tmp_path / "mark")
    run = partial(run_study, study, jobs=1, console=console, restart=command == "restart")
    with pytest.raises(UserError, match=r"not a store that a study wrote|is not a result of this harness"):
        READING.get(command, run)(tmp_path / "result")
    assert not (tmp_path / "mark").exists()


def test_what_else_is_wrong_with_a_group_makes_no_traceback(tmp_path, caplog):
    """Zarr reads the arrays of a group side by side, and asyncio tells of every error after the first."""
    folder = synthetic.write(tmp_path / "early", {"level": synthetic.design(repeats=1)})  # without checksums
    for name in ("nees", "rmse", "status"):
        (folder / STORE / "level" / name / "zarr.json").write_text("{}")
    with pytest.raises(UserError, match="not a store that a study wrote"):
        read(folder)
    gc.collect()
    assert caplog.records == []


@pytest.mark.parametrize("within", ["level/rmse", ""], ids=["array", "copy in the root"])
def test_an_array_of_objects_is_refused(copy, within):
    file = copy / STORE / within / "zarr.json"
    content = json.loads(file.read_text())
    array = content if within else content["consolidated_metadata"]["metadata"]["level/rmse"]
    array["data_type"] = {"name": "variable_length_bytes", "configuration": {}}
    file.write_text(json.dumps(content))
    with pytest.raises(UserError, match="an array of type 'variable_length_bytes', which no result holds"):
        stores.node(copy / STORE, within)


DAMAGES = {
    "zeros": lambda content: bytes(len(content)),
    "empty": lambda _: b"",
    "a list": lambda _: b"[]",
    "null": lambda _: b"null",
    "version 2": lambda _: b'{"zarr_format": 2}',
    "a group": lambda _: b'{"attributes": {}, "zarr_format": 3, "node_type": "group"}',
    "no attributes": lambda _: b'{"attributes": 3, "zarr_format": 3, "node_type": "group"}',
}
DAMAGED = ("zarr.json", "level/zarr.json", "level/status/zarr.json", "level/estimator/c/0", "checksums/zarr.json",
           "checksums/level/zarr.json", "history/zarr.json", "history/0/zarr.json")  # fmt: skip


WITHOUT_HISTORIES = {
    "name": "plain",
    "targets": ["example_state"],
    "drive": [{"name": "straight", "kind": "sine", "amplitude": "0 deg", "duration": "5 s"}],
    "plant": {"vehicle": "scalar_example", "parameters": "kit_2015a", "sensors": "example"},
    "estimator": [{"name": "KF", "kind": "ekf"}],
    "design": [{"name": "level", "repeats": 8}],
}


@pytest.mark.parametrize(
    ("histories", "damage"), [*((True, name) for name in DAMAGES), (False, "zeros"), (False, "null")]
)
def test_whatever_is_damaged_is_named_and_a_run_mends_it(study, finished, tmp_path, damage, histories, console):
    if histories:
        copy = shutil.copytree(finished, tmp_path / "copy")
    else:
        study = build_study(WITHOUT_HISTORIES, "plain")
        copy = run_study(study, tmp_path / "copy", 1, console)
    whole = bits(copy)
    for name in DAMAGED[: None if histories else -1]:
        file = copy / STORE / name
        file.write_bytes(DAMAGES[damage](file.read_bytes()))
        refused_or_done(progress, copy)
        with pytest.raises(UserError, match="'harness run'"):
            read(copy)
        run_study(study, copy, 1, console)
        assert bits(copy) == whole, name


@pytest.mark.parametrize("name", ["run.json", "bound.json", "rare_event.json"])
def test_a_damaged_file_beside_the_store_is_named_with_the_remedy_and_by_every_command(copy, name):
    (copy / name).write_text("[1]")
    said = f"{name}: is damaged or no JSON text: .*; delete it"
    assert re.search(said, " ".join(progress(copy).beside))
    for look in (read, READING["verify"]):
        with pytest.raises(UserError, match=said):
            look(copy)
    (copy / name).unlink()
    assert read(copy)
    assert READING["verify"](copy).holds


def refused_or_done(look, folder):
    """Look at a folder, of which no other error may come than one in words."""
    with contextlib.suppress(UserError):
        look(folder)


@pytest.mark.parametrize(
    "forged",
    [
        {"arrays": {"../../../elsewhere/x": ["band"], "status": ["band", "sample", "drive", "repeat", "estimator"]}},
        {"arrays": 3},
        {"files": {"../../elsewhere/file": "0"}},
        {"files": ["a"]},
    ],
)
def test_forged_metadata_lead_nowhere(study, copy, elsewhere, forged, console):
    """Whoever forges a store can forge its checksums, too."""
    stores.group(copy / STORE, checksums.GROUP, "r+")["level"].attrs.update(forged)
    for look in (*READING.values(), lambda folder: run_study(study, folder, 1, console)):
        refused_or_done(look, copy)


@pytest.mark.parametrize("attributes", [{"designs": 3}, {"designs": {"a": 1}}, {"checksums": 1}])
def test_foreign_attributes_are_refused_in_words(copy, attributes):
    stores.group(copy / STORE, mode="r+").attrs.update(attributes)
    sealed_root.seal(copy / STORE)
    stores.consolidate(copy / STORE)
    assert attributes.items() <= attributes_of(copy).items()
    for look in READING.values():
        refused_or_done(look, copy)
