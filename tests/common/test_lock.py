"""A lock on a folder: one holder at a time, gone with its process, and gone with the folder that was made for it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from harness.common import lock
from harness.common.errors import UserError
from harness.common.lock import FILE, holder, locked

HOLD = """
import sys, time
from pathlib import Path
from harness.common.lock import locked
with locked(Path(sys.argv[1]), "a test"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_has_one_holder_at_a_time(tmp_path):
    with locked(tmp_path, "the first") as held:
        assert held.is_kept
        assert holder(tmp_path).startswith(f"the first, process {os.getpid()} on ")
        with pytest.raises(UserError, match="written by another process: the first, process"), locked(tmp_path, "b"):
            pass
    assert holder(tmp_path) is None
    assert list(tmp_path.iterdir()) == []
    with locked(tmp_path, "the second"):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
def test_a_killed_holder_leaves_no_lock_behind(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(UserError, match=f"a test, process {process.pid} on "), locked(tmp_path, "b"):
            pass
        process.send_signal(signal.SIGSTOP)  # one that is only suspended still holds it
        assert f"process {process.pid}" in holder(tmp_path)
        process.kill()
    assert (tmp_path / FILE).exists()
    assert holder(tmp_path) is None
    with locked(tmp_path, "b"):
        pass
    assert not (tmp_path / FILE).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="a file that is open is not removed there")
def test_a_lock_whose_file_is_removed_between_opening_and_locking_is_taken_again(tmp_path, monkeypatch):
    flock, removed = lock.fcntl.flock, []

    def after_the_last_holder(*arguments):
        if not removed:
            removed.append((tmp_path / FILE).unlink())
        flock(*arguments)

    monkeypatch.setattr(lock.fcntl, "flock", after_the_last_holder)
    with locked(tmp_path, "the first"):
        assert removed
        with pytest.raises(UserError, match="written by another process: the first"), locked(tmp_path, "b"):
            pass


@pytest.mark.skipif(sys.platform == "win32", reason="a file that is open is not removed there")
def test_the_file_of_a_lock_is_removed_while_it_is_held(tmp_path, monkeypatch):
    unlink, held = Path.unlink, []

    def looked_at(path, *arguments, **options):
        held.append(holder(tmp_path))
        unlink(path, *arguments, **options)

    with locked(tmp_path, "the first"):
        monkeypatch.setattr(Path, "unlink", looked_at)
    assert "the first" in held[0]


def test_a_folder_that_was_made_and_stayed_empty_goes_again(tmp_path):
    with locked(tmp_path / "new" / "deeper", "a"):
        pass
    assert not (tmp_path / "new" / "deeper").exists()
    with locked(tmp_path / "new", "a"):
        (tmp_path / "new" / "file").touch()
    assert (tmp_path / "new" / "file").exists()


def test_a_file_system_without_locks_keeps_nobody_out(tmp_path, monkeypatch):
    def without(file):
        raise OSError(lock.errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock, "_acquire", without)
    with locked(tmp_path, "a") as held:
        assert not held.is_kept


def test_a_folder_in_place_of_the_lock_is_named(tmp_path):
    (tmp_path / FILE).mkdir()
    with pytest.raises(UserError, match=f"{tmp_path / FILE}: is a folder, .* remove it$"), locked(tmp_path, "a"):
        pass
    assert holder(tmp_path) is None
    (tmp_path / FILE).rmdir()  # as the message says
    with locked(tmp_path, "a"):
        pass


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot create the result folder"), locked(tmp_path / "file" / "deeper", "a"):
        pass
