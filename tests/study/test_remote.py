"""Results behind URLs: the bits of a local store, resumed, mended, checked, reported; one writer at a time."""

import io
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.common import places
from harness.common.errors import UserError, WorkError
from harness.common.lock import FILE
from harness.config import load_study
from harness.study import checksums, sealed_root
from harness.study.plan import progress
from harness.study.results import read
from harness.study.run import run_study
from harness.study.store import STORE
from harness.study.verify import verify
from support import object_store, probe_study

CHUNK = "level/rmse/c.1.0.0.0.0.0"

FILES = [CHUNK, "level/status/c.0.0.1.0.0", "band/zarr.json", "zarr.json"]

pytestmark = pytest.mark.proof


@pytest.fixture(scope="module", autouse=True)
def same_checkout():
    """A checkout that holds still while somebody works in it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.study.layout.commit", lambda: "this one")
        patch.setattr("harness.study.provenance.engine_hash", lambda study: "this one")
        yield


@pytest.fixture(scope="module")
def bucket():
    with object_store.s3() as url:
        yield url


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "probe.toml"
    path.write_text(probe_study.STUDY)
    return load_study(path)


@pytest.fixture(scope="module")
def alone(study, tmp_path_factory):
    return run_study(study, tmp_path_factory.mktemp("alone"), jobs=1)


@pytest.fixture(scope="module")
def local_bits(alone):
    return {path.as_posix(): content for path, content in probe_study.bits(alone).items()}


@pytest.fixture(scope="module")
def far(study, bucket):
    """A finished result in the object store."""
    return run_study(study, places.place(f"{bucket}/far"), jobs=2)


@pytest.fixture
def console():
    return Console(file=io.StringIO(), width=400)


def stop_after(monkeypatch, units):
    """Let a run fail after some units."""
    from harness.study.store import Store

    write, done = Store.write, []

    def limited(self, unit, result):
        if len(done) >= units:
            raise KeyboardInterrupt
        done.append(unit)
        write(self, unit, result)

    monkeypatch.setattr(Store, "write", limited)


def test_a_store_behind_a_url_has_the_bits_of_one_in_a_folder(far, local_bits):
    assert object_store.bits(str(far)) == local_bits
    assert places.contents(far, ["run.json", FILE])[0] is not None
    assert places.contents(far, [FILE]) == [None]  # the lock was given back


def test_memory_and_file_urls(study, local_bits, tmp_path):
    out = run_study(study, places.place("memory://results/probe"), jobs=2)
    assert object_store.bits(str(out)) == local_bits
    assert places.place(f"file://{tmp_path}/a") == tmp_path / "a"


def test_an_interrupted_run_goes_on_to_the_same_bits(study, bucket, local_bits, monkeypatch, console):
    out = places.place(f"{bucket}/cut")
    with monkeypatch.context() as patch:
        stop_after(patch, 3)
        with pytest.raises(KeyboardInterrupt):
            run_study(study, out, jobs=1)
    found = progress(out)
    assert 0 < found.done < found.planned
    run_study(study, out, jobs=2, console=console)
    assert f"of 28 runs are in {bucket}/cut/{STORE} already" in console.file.getvalue()
    assert object_store.bits(str(out)) == local_bits
    assert progress(out).done == 28


def test_a_store_that_was_not_written_to_its_end_counts_as_none(study, bucket, local_bits, monkeypatch):
    out = places.place(f"{bucket}/half")
    write = places.write

    def refused(file, content):
        if file.name == "zarr.json" and file.parent.name == checksums.GROUP:
            raise OSError("gone")
        write(file, content)

    with monkeypatch.context() as patch:
        patch.setattr(places, "write", refused)
        with pytest.raises(WorkError, match="the same command continues"):
            run_study(study, out, jobs=1)
    assert places.names(out / STORE)
    assert not sealed_root.is_there(out / STORE)
    assert object_store.bits(str(run_study(study, out, jobs=1))) == local_bits


def test_what_is_lost_is_named_and_computed_again(study, far, local_bits, console):
    out = places.place(str(far).replace("/far", "/damaged"))
    whole = object_store.bits(str(far))
    for name, content in whole.items():
        places.write(out / STORE / name, content)
    for content in (None, b"x"):
        for file in FILES:
            places.write(out / STORE / file, content)
            with pytest.raises(UserError, match=rf"{file} is {'damaged' if content else 'missing'}.*'harness run'"):
                read(out)
            places.write(out / STORE / file, whole[file])
    for file in FILES:
        places.write(out / STORE / file, None if "c/" in file else b"x")
    lost = verify(out, lambda: study, sample=0).lost
    assert [fault.file for fault in lost] == ["zarr.json"]
    run_study(study, out, jobs=1, console=console)
    assert object_store.bits(str(out)) == local_bits
    assert "what is lost is computed again" in console.file.getvalue()


def test_the_commands_take_a_url(far, study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = {}
    for name, further in {"status": [], "verify": ["--sample", "1"], "report": []}.items():
        result = CliRunner().invoke(app, [name, str(far), *further])
        assert result.exit_code == 0, result.output
        said[name] = " ".join(result.output.split())
    assert "28 of 28 runs done, 0 missing" in said["status"]
    assert "all as they were written" in said["verify"]
    assert "computed again: the same bits" in said["verify"]
    assert f"{far}/report.pdf" in said["report"]
    assert places.contents(far, ["report.html"])[0].startswith(b"<!DOCTYPE html>")
    results = h.open_results(str(far))
    assert str(results.folder) == str(far)
    assert results["level/rmse"].shape == (2, 1, 2, 5, 1, 2)
    assert results.replay("level").is_same
    assert not list(tmp_path.iterdir())  # nothing lands here


def test_restart_throws_a_far_result_away(study, bucket, console):
    out = places.place(f"{bucket}/again")
    run_study(study, out, jobs=1)
    places.write(out / STORE / CHUNK, None)
    run_study(study, out, jobs=1, console=console, restart=True)
    assert "thrown away: the result of study 'probe'" in console.file.getvalue()
    assert not verify(out, lambda: study, sample=0).lost


def test_another_study_is_left_alone(far, tmp_path):
    file = tmp_path / "other.toml"
    file.write_text(probe_study.STUDY.replace("seed = 0", "seed = 1"))
    with pytest.raises(UserError, match="seed"):
        run_study(load_study(file), far, jobs=1)


def test_a_place_that_does_not_answer_is_one_line(study, monkeypatch, request):
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    from s3fs import S3FileSystem

    S3FileSystem.clear_instance_cache()  # which remembers where it was connected to
    request.addfinalizer(S3FileSystem.clear_instance_cache)
    monkeypatch.setattr(S3FileSystem, "retries", 1)
    for attempt in (lambda out: run_study(study, out, jobs=1), read, progress):
        with pytest.raises(WorkError, match=r"s3://nowhere/a: \w+: .*continues from there"):
            attempt(places.place("s3://nowhere/a"))


def test_workers_of_a_cluster_write_their_own_chunks(study, bucket, local_bits, monkeypatch, tmp_path):
    import dask
    import distributed  # noqa: F401  (its settings must be there before one of them is set for a while)

    from harness.study import cluster

    still = Path(tmp_path) / "still.py"
    still.write_text("from harness.study import provenance\n\nprovenance.engine_hash = lambda study: 'this one'\n")
    out = places.place(f"{bucket}/cluster")
    with dask.config.set({"distributed.worker.preload": [str(still)]}), cluster.connected(None, workers=2) as client:
        client.wait_for_workers(2, timeout=300)
        monkeypatch.setattr(
            "harness.study.store.Store.write", lambda *_: pytest.fail("written here")
        )  # workers are processes of their own
        run_study(study, out, client=client)
    assert object_store.bits(str(out)) == local_bits
