"""Worker processes for foreign code: what crashes, hangs or floods its output loses one run and nothing else.

A process serves one calling thread at a time, goes back to the pool, and is replaced when it dies or exceeds its time.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import weakref
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from harness.common.errors import UserError
from harness.external.transport import receive, send

TIMEOUT = 60.0
"""Seconds by the clock that a run of foreign code may take unless a study states others."""

START_TIMEOUT = 60.0
"""Seconds that it may take to be loaded."""

_LAST_WORDS = 4096
"""Characters of its standard streams that an error quotes from."""


@dataclass(frozen=True)
class Lost:
    """A call that gave no answer.

    Attributes:
        reason: Why, in one line.
    """

    reason: str


class Worker:
    """A process with a body in it.

    Args:
        loader: What the body is made from.
        start_timeout: Seconds until it must be there.

    Raises:
        UserError: If the body cannot be made: what it said, or how its process ended; or on Windows.
    """

    def __init__(self, loader: Mapping[str, Any], start_timeout: float = START_TIMEOUT) -> None:
        if os.name != "posix":
            raise UserError("plants and estimators of other people run on Linux and macOS alone")
        ours, theirs = socket.socketpair()
        self._held: int | None
        watched, self._held = os.pipe()  # closed with this process, however it ends
        self._folder = tempfile.TemporaryDirectory(prefix="harness-", ignore_cleanup_errors=True)
        environment = {
            **os.environ,
            "TMPDIR": self._folder.name,
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONFAULTHANDLER": "",
        }
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "harness.external.worker", str(theirs.fileno()), str(watched)],
            pass_fds=(theirs.fileno(), watched),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,  # so that what it starts itself is ended with it
        )
        theirs.close()
        os.close(watched)
        self._connection = Connection(ours.detach())
        self._said: deque[bytes] = deque(maxlen=4)
        threading.Thread(target=_drain, args=(self._process.stdout, self._said), daemon=True).start()
        try:
            answer = self.call("load", (dict(loader),), start_timeout)
        except BaseException:  # Ctrl-C while it is loaded
            self.close()
            raise
        if isinstance(answer, Lost):
            self.close()
            raise UserError(answer.reason)

    def call(self, method: str, arguments: tuple[Any, ...], timeout: float) -> Any:
        """Return what a method of the body returns, or ``Lost``; after a crash or time-out ``alive`` is false."""
        try:
            send(self._connection, (method, arguments))
            if not self._connection.poll(timeout):
                self.close()
                return Lost(f"it gave no answer within {timeout:g} s and was ended")
            status, value = receive(self._connection)
        except (EOFError, OSError):
            return Lost(self._end())
        return value if status == "done" else Lost(value)

    @property
    def alive(self) -> bool:
        """Whether it can be called."""
        return self._process.poll() is None

    def _end(self) -> str:
        """Return how the process ended, in words."""
        try:
            status = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            status = None
        self.close()
        if status is None:
            how = "its process closed its connection"
        elif status < 0:
            how = f"its process was ended by {signal.Signals(-status).name}"
        else:
            how = f"its process ended with status {status}"
        last = b"".join(self._said)[-_LAST_WORDS:].decode(errors="replace").strip().splitlines()
        return f"{how}; it last said: {last[-1][:200]}" if last else how

    def close(self) -> None:
        """End the process and all that it started; what it kept in temporary files goes with it."""
        with contextlib.suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._connection.close()
        if self._held is not None:
            os.close(self._held)
            self._held = None
        self._folder.cleanup()


def _drain(stream: Any, said: deque[bytes]) -> None:
    """Read what a process prints, so that it never waits, and keep the end of it."""
    with contextlib.suppress(OSError, ValueError):
        while chunk := stream.read1(2**16):
            said.append(chunk[-_LAST_WORDS:])


class Workers:
    """A pool of workers with the same body, one for each thread that calls.

    Args:
        loader: What their bodies are made from.
        timeout: Seconds by the clock that a call may take.
    """

    def __init__(self, loader: Mapping[str, Any], timeout: float = TIMEOUT) -> None:
        self._loader, self._timeout = loader, timeout
        self._idle: list[Worker] = []
        self._lock = threading.Lock()
        self._finalizer = weakref.finalize(self, _close_all, self._idle)

    def calls(self, method: str, jobs: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """Call a method for one job after the other; yield its value, or ``Lost``.

        Raises:
            UserError: If a body cannot be made.
        """
        worker: Worker | None = None
        try:
            for job in jobs:
                worker = worker if worker is not None and worker.alive else self._take()
                yield worker.call(method, job, self._timeout)
        finally:
            if worker is not None and worker.alive:
                with self._lock:
                    self._idle.append(worker)

    def call(self, method: str, *arguments: Any) -> Any:
        """Return what one call gives; ``Lost`` where it gave nothing."""
        (value,) = self.calls(method, [arguments])
        return value

    def close(self) -> None:
        """End all processes that are idle."""
        _close_all(self._idle)

    def _take(self) -> Worker:
        with self._lock:
            while self._idle:
                worker = self._idle.pop()
                if worker.alive:
                    return worker
        return Worker(self._loader)


def _close_all(workers: list[Worker]) -> None:
    while workers:
        workers.pop().close()
