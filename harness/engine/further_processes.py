"""Compile kernels in further processes where several are missing.

Numba compiles under one lock, so threads do not help. What a further process compiles comes through the cache
(``harness.common.cache``) and has the bits of what this one compiles. A further process that fails leaves its kernels
to this one, which says what is wrong with them.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from harness.common import components
from harness.engine.compile import is_on_disk

_START = (
    "import sys; sys.path[:] = sys.argv[1:]; from harness.common.process import collect_rarely; "
    "collect_rarely(); from harness.engine.further_processes import serve; serve()"
)


class Compiles(Protocol):
    """What kernels are compiled of."""

    @property
    def kernels(self) -> int:
        """Number of kernels."""

    @property
    def loops(self) -> list[Any]:
        """The compiled functions."""

    def warm_up(self, index: int) -> str:
        """Compile one of them and return its name."""


def compile_all(
    kernels: Compiles, again: Callable[[], Compiles], further: Callable[[int], int], say: Callable[[str], None]
) -> None:
    """Compile kernels, or load them from the cache.

    Args:
        kernels: What is compiled.
        again: Makes it in a further process, which gets this function pickled.
        further: Returns how many further processes may work in addition to this one if so many kernels are missing.
        say: Receives what is being done, in words.
    """
    missing = deque(missing_kernels(kernels))
    to_compile = set(range(kernels.kernels))

    def load(index: int) -> None:
        to_compile.discard(index)
        say(f"compiled {kernels.warm_up(index)}; {len(to_compile)} to go")

    with _compiling_too(again, missing, further(len(missing))):
        while (index := _taken(missing.popleft)) is not None:
            load(index)
    for index in sorted(to_compile):
        load(index)


def missing_kernels(kernels: Compiles) -> list[int]:
    """Return which kernels are in no cache, in their order; of those that are the same, the first."""
    loops = kernels.loops
    return [loops.index(loop) for loop in dict.fromkeys(loops) if not is_on_disk(loop)]


def _taken(end: Callable[[], int]) -> int | None:
    """Return what is at one end; ``None`` if the last has been taken from the other in the meantime."""
    try:
        return end()
    except IndexError:
        return None


@contextmanager
def _compiling_too(again: Callable[[], Compiles], missing: deque[int], processes: int) -> Iterator[None]:
    """Let further processes take kernels from the far end while the block runs, and wait until theirs are done."""
    if processes < 1 or not sys.executable:
        yield
        return
    command = [sys.executable, "-c", _START, *sys.path]
    started: list[subprocess.Popen[bytes]] = []
    try:
        for _ in range(processes):
            started.append(subprocess.Popen(command, stdin=-1, stdout=-1, stderr=subprocess.DEVNULL))
        what = pickle.dumps((components.carried(), again))
        threads = [threading.Thread(target=_give, args=(each, what, missing), daemon=True) for each in started]
        for thread in threads:
            thread.start()
        yield
        for thread in threads:
            thread.join()
    finally:
        for process in started:
            process.kill()
            process.communicate()


def _give(process: subprocess.Popen[bytes], what: bytes, missing: deque[int]) -> None:
    """Hand kernels to a further process, one when it has done the last."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(OSError):  # it ended
        process.stdin.write(len(what).to_bytes(8, "little") + what)
        process.stdin.flush()
        while process.stdout.readline() == b"ready\n" and (index := _taken(missing.pop)) is not None:
            process.stdin.write(b"%d\n" % index)
            process.stdin.flush()


def serve() -> None:
    """Compile the kernels that standard input names; what a further process runs."""
    source, answers = sys.stdin.buffer, sys.stdout.buffer
    what = source.read(int.from_bytes(source.read(8), "little"))
    registered, again = pickle.loads(what)
    components.take_over(registered)
    kernels = again()
    while True:
        answers.write(b"ready\n")
        answers.flush()
        if not (line := source.readline()):
            return
        kernels.warm_up(int(line))
