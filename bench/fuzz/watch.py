"""Watch over the reading of one input: time, memory, files, code run from data, and errors.

An outcome is a result, or a ``UserError`` or ``ModelError``, which a command answers with one line and status 2
(``harness.cli.guard``). Everything else is a finding.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.common.errors import ModelError, UserError

SECONDS = 10.0
"""Of processor time, after which an input counts as a hang; on a busy machine the clock runs faster."""
WAITING = 60.0
"""By the clock: whoever waits for a pipe takes no processor time."""
MEMORY = 2 * 2**30
"""Bytes that the process may hold at most."""
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_FORBIDDEN = ("pickle.find_class", "os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "socket.connect")
_PATHS = ("os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.truncate", "shutil.rmtree")


class Hang(BaseException):
    """Raised in an input that takes too long; no handler of errors takes it."""


@dataclass
class Watch:
    """Judges inputs one by one.

    Args:
        folder: The only one in which files may be written, beside that of temporary files.

    Attributes:
        inputs: Number of inputs so far.
        results: Number of those that were read.
        refused: Number of those that were refused in words.
        findings: What was found, by kind and place, with the first input that showed it.
    """

    folder: Path
    inputs: int = 0
    results: int = 0
    refused: int = 0
    findings: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._active, self._most = False, _peak()  # what was held before, by a parent process as well, is no input's
        self._seen: list[str] = []
        self._allowed = tuple(
            f"{folder}/" for folder in (self.folder.resolve(), tempfile.gettempdir(), "/dev", "/proc")
        )
        sys.addaudithook(self._audit)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._active:
            return
        if event in _FORBIDDEN:
            self._seen.append(f"{event} {arguments!r}"[:200])
        elif event == "open":
            path, mode, flags = arguments
            writes = bool(flags & _WRITES) if isinstance(flags, int) else False
            if (writes or (isinstance(mode, str) and set(mode) & set("wax+"))) and not self._inside(path):
                self._seen.append(f"writes {path!r}")
        elif event in _PATHS and arguments and not self._inside(arguments[0], follows=False):
            self._seen.append(f"{event} {arguments[0]!r}")

    def _inside(self, path: Any, follows: bool = True) -> bool:
        if isinstance(path, int) or path is None:
            return True
        folder, name = os.path.split(os.fsdecode(path))
        whole = os.path.realpath(os.fsdecode(path) if follows else folder) + ("" if follows else f"/{name}")
        return f"{whole}/".startswith(self._allowed) or whole.endswith(".pyc")

    def judge(self, kind: str, read: Callable[[], object], content: bytes) -> None:
        """Read one input.

        Args:
            kind: Of the input.
            read: Reads it.
            content: Kept if it shows something.
        """
        self.inputs += 1
        self._seen.clear()
        before = signal.signal(signal.SIGPROF, _hang)
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        waiting = signal.signal(signal.SIGALRM, _hang)
        signal.setitimer(signal.ITIMER_REAL, WAITING)
        finding = ""
        self._active = True
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read()
            self.results += 1
        except (UserError, ModelError) as error:
            self.refused += 1
            if not str(error).strip():
                finding = "an error without words"
        except Hang as error:
            finding = f"hangs: {_place(error)}"
        except MemoryError as error:
            finding = f"MemoryError: {_place(error)}"
        except Exception as error:
            finding = f"{type(error).__name__}: {_place(error)}: {error}"[:400]
        finally:
            self._active = False
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, waiting)
        for sentence in [*([finding] if finding else []), *self._seen]:
            self._note(kind, sentence, content)
        most = _peak()
        if most > max(MEMORY, self._most):
            self._note(kind, "memory above 2 GiB", content)
        self._most = max(most, self._most)

    def _note(self, kind: str, sentence: str, content: bytes) -> None:
        key = f"{kind}: {sentence}".split(": ")
        short = ": ".join(key[:3])
        if short not in self.findings:
            self.findings[short] = sentence
            number = len(self.findings)
            (self.folder / f"finding-{number:03d}.txt").write_text(f"{kind}: {sentence}\n", encoding="utf-8")
            (self.folder / f"finding-{number:03d}.input").write_bytes(content)


def _peak() -> int:
    """Return the most bytes that the process has held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _hang(*_: object) -> None:
    raise Hang


def _place(error: BaseException) -> str:
    """Return the innermost lines of the harness and of all code."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/harness/" in f.filename or "/models/" in f.filename]
    shown = [*ours[-1:], *frames[-1:]]
    return " < ".join(dict.fromkeys(f"{Path(f.filename).name}:{f.lineno}" for f in reversed(shown)))
