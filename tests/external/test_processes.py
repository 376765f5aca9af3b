"""Worker processes: what foreign code may do to itself, and what is left of a study then."""

import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.external.processes import Lost, Workers

BODY = """
import os, sys, time
class Body:
    def double(self, x): return 2 * x
    def crash(self): os.kill(os.getpid(), 11)
    def leave(self): os._exit(3)
    def exit(self): sys.exit("bye")
    def hang(self): time.sleep(60)
    def shout(self):
        for _ in range(200): os.write(1, b"x" * 100_000)
        return 1
    def whisper(self):
        print("licence expired", flush=True); os._exit(4)
    def fail(self): raise RuntimeError("no licence\\nfor you")
    def pid(self): return os.getpid()
    def litter(self):
        import tempfile
        return tempfile.mkdtemp()
    def turned(self, a): return a.T, a[:0], a[::2] * 2
def load(loader):
    if loader.get("refuse"): raise ValueError("not on this machine")
    if loader.get("crash"): os.abort()
    return Body()
"""


@pytest.fixture
def loader(tmp_path, monkeypatch):
    (tmp_path / "somebody_elses_body.py").write_text(BODY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return {"kind": "somebody_elses_body"}


@pytest.fixture
def workers(loader, request):
    pool = Workers(loader, timeout=getattr(request, "param", 20.0))
    yield pool
    pool.close()


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("crash", "ended by SIGSEGV"),
        ("leave", "ended with status 3"),
        ("exit", "sys.exit('bye')"),
        ("whisper", "it last said: licence expired"),
        ("fail", "RuntimeError: no licence for you (somebody_elses_body.py, line 14)"),
    ],
)
def test_what_goes_wrong_loses_one_call_and_is_said_in_one_line(workers, method, words):
    got = [workers.call("double", 1), workers.call(method), workers.call("double", 3)]
    assert got[0] == 2
    assert isinstance(got[1], Lost)
    assert words in got[1].reason
    assert "\n" not in got[1].reason
    assert got[2] == 6


@pytest.mark.parametrize("workers", [1.0], indirect=True)
def test_what_hangs_is_ended_and_replaced(workers):
    first = workers.call("pid")
    begin = time.monotonic()
    (lost, double) = [workers.call("hang"), workers.call("double", 5)]
    assert "within 1 s" in lost.reason
    assert double == 10
    assert time.monotonic() - begin < 15.0
    assert not os.path.exists(f"/proc/{first}") or workers.call("pid") != first


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_worker_ends_with_its_parent_also_while_it_is_loaded(tmp_path, how):
    """A library whose constructor does not return holds the interpreter, so that no thread of it gets its turn."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    (tmp_path / "slow.c").write_text("__attribute__((constructor)) static void hang(void) { for (;;); }")
    subprocess.run([compiler, "-shared", "-fPIC", "-O0", "slow.c", "-o", "slow.so"], cwd=tmp_path, check=True)
    (tmp_path / "slow_body.py").write_text(
        "import ctypes, os, pathlib\ndef load(loader):\n"
        "    pathlib.Path('pid').write_text(str(os.getpid()))\n    ctypes.CDLL('./slow.so')\n"
    )
    code = "from harness.external.processes import Workers; Workers({'kind': 'slow_body'}).call('double', 1)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # which a shell's background job ignores
    )
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        time.sleep(0.1)
    time.sleep(0.5)
    pid = int((tmp_path / "pid").read_text())
    assert os.path.exists(f"/proc/{pid}")
    parent.send_signal(how)
    parent.wait(10.0)
    deadline = time.monotonic() + 5.0
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not os.path.exists(f"/proc/{pid}")


def test_megabytes_of_output_stop_nothing(workers):
    assert workers.call("shout") == 1


def test_a_process_is_reused(workers):
    assert len({workers.call("pid") for _ in range(3)}) == 1


@pytest.mark.parametrize(("how", "words"), [("refuse", "not on this machine"), ("crash", "SIGABRT")])
def test_a_body_that_cannot_be_made_is_an_error_of_the_user(loader, how, words):
    with pytest.raises(UserError, match=words):
        Workers({**loader, how: True}).call("double", 1)


def test_temporary_files_go_with_their_process(loader):
    workers = Workers(loader)
    folder = workers.call("litter")
    assert os.path.isdir(folder)
    workers.close()
    assert not os.path.exists(os.path.dirname(folder))


def test_arrays_of_any_layout_come_back_whole(loader):
    workers = Workers(loader)
    given = np.arange(600_000.0).reshape(2000, 300)
    turned, empty, doubled = workers.call("turned", given)
    workers.close()
    np.testing.assert_array_equal(turned, given.T)
    assert empty.shape == (0, 300)
    doubled += given[::2]
    np.testing.assert_array_equal(doubled, 3 * given[::2])
