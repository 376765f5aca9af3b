"""Compile the kernels of a study before its first unit, in further processes where several are missing.

Numba compiles under one lock, so threads do not help. What a further process compiles comes through the cache
(``harness.common.cache``) and has the bits of what this one compiles. A further process that fails
leaves its kernels to this one, which says what is wrong with them.
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
from harness.config import Study
from harness.engine.compile import is_on_disk
from harness.study.devices import on_card
from harness.study.evaluate import StudyEvaluator

_WORTH = 3
"""Missing kernels for each further process: its start takes as long as the compilation of one.

On a card a kernel takes several times as long, so each is worth a process.
"""

_START = (
    "import sys; sys.path[:] = sys.argv[1:]; from harness.common.process import collect_rarely; "
    "collect_rarely(); from harness.study.compiling import serve; serve()"
)


class Compiles(Protocol):
    """What kernels are compiled of: ``StudyEvaluator``, or ``CardEvaluator`` for a card."""

    @property
    def study(self) -> Study:
        """The study."""

    @property
    def kernels(self) -> int:
        """Number of kernels."""

    @property
    def loops(self) -> list[Any]:
        """The compiled functions."""

    def warm_up(self, index: int) -> str:
        """Compile one of them and return its name."""


def compile_kernels(evaluator: Compiles, processes: int, say: Callable[[str], None]) -> None:
    """Compile the kernels of a study, or load them from the cache.

    Args:
        evaluator: The study.
        processes: That may work at a time, this one included.
        say: Told in words what is done.
    """
    missing = deque(missing_kernels(evaluator))
    left = set(range(evaluator.kernels))
    worth = len(missing) // _WORTH if evaluator.study.device == "cpu" else max(0, len(missing) - 1)
    further = min(processes - 1, worth)

    def load(index: int) -> None:
        left.discard(index)
        say(f"compiled {evaluator.warm_up(index)}; {len(left)} to go")

    with _compiling_too(evaluator.study, missing, further):
        while (index := _taken(missing.popleft)) is not None:
            load(index)
    for index in sorted(left):
        load(index)


def missing_kernels(evaluator: Compiles) -> list[int]:
    """Return which kernels are in no cache, in their order; of those that are the same, the first."""
    loops = evaluator.loops
    return [loops.index(loop) for loop in dict.fromkeys(loops) if not is_on_disk(loop)]


def _taken(end: Callable[[], int]) -> int | None:
    """Return what is at one end; ``None`` if the last has been taken from the other in the meantime."""
    try:
        return end()
    except IndexError:
        return None


@contextmanager
def _compiling_too(study: Study, missing: deque[int], processes: int) -> Iterator[None]:
    """Let further processes take kernels from the far end while the block runs, and wait until theirs are done."""
    if not processes or not sys.executable:
        yield
        return
    command = [sys.executable, "-c", _START, *sys.path]
    started: list[subprocess.Popen[bytes]] = []
    try:
        for _ in range(processes):
            started.append(subprocess.Popen(command, stdin=-1, stdout=-1, stderr=subprocess.DEVNULL))
        what = pickle.dumps((components.carried(), study))
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
    found, study = pickle.loads(source.read(int.from_bytes(source.read(8), "little")))
    components.take_over(found)
    evaluator: Compiles = StudyEvaluator(study)
    if study.device != "cpu":
        evaluator = on_card().CardEvaluator(evaluator)
    while True:
        answers.write(b"ready\n")
        answers.flush()
        if not (line := source.readline()):
            return
        evaluator.warm_up(int(line))
