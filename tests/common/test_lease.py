"""Places behind URLs, and the lock there: one writer at a time, taken over from one that is gone."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from harness.common import lease, places
from harness.common.errors import UserError, WorkError
from harness.common.lock import FILE, holder, locked
from support import object_store

HOLD = """
import sys, time
from harness.common import places
from harness.common.lock import locked
with locked(places.place(sys.argv[1]), "a test"):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(lease, "RENEWED", 0.2)
    monkeypatch.setattr(lease, "WATCHED", 1.5)


@pytest.fixture(scope="module")
def bucket():
    with object_store.s3() as url:
        yield url


@pytest.mark.parametrize("given", ["", "  "])
def test_an_empty_path_is_not_the_working_directory(given):
    with pytest.raises(UserError, match="the path is empty"):
        places.place(given)


def test_a_file_url_is_a_plain_path(tmp_path):
    assert places.place(f"file://{tmp_path}/a%20b") == tmp_path / "a b"
    assert places.place("C:/a") == Path("C:/a")
    for url in ("file://", "file://here", "local://x/y"):
        with pytest.raises(UserError, match="three strokes"):
            places.place(url)


@pytest.mark.parametrize("url", ["nonsense://a/b", "hdfs://a/b"])
def test_a_url_that_nothing_knows_is_refused(url):
    with pytest.raises(UserError, match=f"{url}: cannot be opened"):
        places.place(url)


def test_without_the_extra_the_message_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "upath", None)
    with pytest.raises(UserError, match=r"need the extra 'remote'"):
        places.place("s3://a/b")


@pytest.mark.parametrize("where", ["bucket", "memory://locks"])
def test_one_writer_at_a_time(where, bucket):
    out = places.place(f"{bucket}/one" if where == "bucket" else where)
    with locked(out, "the first") as held:
        assert held.is_kept
        assert holder(out).startswith("the first, process")
        said = []
        with (
            pytest.raises(UserError, match="written by another process: the first, process"),
            locked(out, "the second", said.append),
        ):
            pass
        assert len(said) == 1
        assert "watching" in said[0]
        held.check()
    assert holder(out) is None
    with locked(out, "the second"):
        pass


def test_the_lock_of_a_killed_process_is_taken_over(bucket):
    out = places.place(f"{bucket}/killed")
    with subprocess.Popen([sys.executable, "-c", HOLD, str(out)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        process.kill()
    assert "a test, process" in holder(out)
    said = []
    with locked(out, "the heir", said.append):
        assert holder(out).startswith("the heir")
    assert said[-1] == "it is not: the folder is taken over"


def test_a_holder_that_comes_back_stops(bucket):
    out = places.place(f"{bucket}/back")
    with locked(out, "the sleeper") as held:
        places.write(out / FILE, b'{"token": "another", "words": "another"}')
        time.sleep(1.5)
        with pytest.raises(WorkError, match=r"taken over by another process.*another"):
            held.check()
    assert places.contents(out, [FILE]) == [b'{"token": "another", "words": "another"}']  # not ours to give back


def test_of_many_that_begin_at_once_one_holds_the_lock(bucket):
    out, held, refused = places.place(f"{bucket}/many"), [], []
    ready = threading.Barrier(4)

    def begin(name):
        ready.wait()
        try:
            with locked(out, name):
                held.append(name)
                time.sleep(3)
        except UserError:
            refused.append(name)

    threads = [threading.Thread(target=begin, args=(f"{i}",)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(held), len(refused)) == (1, 3)
