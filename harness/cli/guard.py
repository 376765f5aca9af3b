"""Answers of every command to what it raises: one message and an exit status, and no traceback.

Whatever is raised that is neither a ``UserError`` nor a failure of the machine is a fault of the harness, or of code of
the user's own that it runs. Its traceback goes to a file next to the output; the message says where, and whom it
concerns.
"""

from __future__ import annotations

import _thread
import errno
import logging
import os
import platform
import re
import shlex
import signal
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from rich.console import Console
from rich.text import Text

from harness.common import places
from harness.common.components import outside_packages
from harness.common.errors import ModelError, UserError, WorkError

DONE, FAILED, WRONG, BUG, INTERRUPTED = 0, 1, 2, 70, 130
"""Exit statuses; 70 is EX_SOFTWARE of sysexits.h: an internal software error."""

_MACHINE = {
    getattr(errno, name)
    for name in (
        "ENOSPC",
        "EDQUOT",
        "EROFS",
        "EACCES",
        "EPERM",
        "EIO",
        "EMFILE",
        "ENFILE",
        "ENOMEM",
        "ENAMETOOLONG",
        "EFBIG",
        "ELOOP",
    )
    if hasattr(errno, name)
}
"""Errors of the operating system that say what to mend by themselves."""

_debug = [False]


def show_tracebacks(wanted: bool) -> None:
    """Print the traceback before the message, as ``--debug`` asks."""
    _debug[0] = wanted


def guarded(run: Callable[[], None], output: Path | None = None) -> int:
    """Run a command and return its exit status; whatever it raises becomes one message on stderr.

    Args:
        run: The command.
        output: File or folder that it writes; the traceback of a fault is kept next to it, or in the working
            directory if absent.

    Raises:
        BaseException: What ends a process by itself, such as ``SystemExit``, and a pipe that nobody reads any more.
    """
    with _said_in_words(), _interrupts() as interrupted:
        try:
            run()
        except BrokenPipeError:
            raise
        except (Exception, KeyboardInterrupt) as error:
            return answered(error, output, bool(interrupted))
    return DONE


def answered(error: Exception | KeyboardInterrupt, output: Path | None = None, interrupted: bool = False) -> int:
    """Say in one message on stderr what was raised, and return the exit status.

    Args:
        error: What was raised.
        output: As of ``guarded``.
        interrupted: Whether Ctrl-C came before.
    """
    if interrupted or isinstance(error, KeyboardInterrupt):
        said = "a study, a trace or a plan goes on from what is finished, other commands begin again"
        return _say("interrupted", said, INTERRUPTED, False)
    if isinstance(error, UserError | ModelError):
        return _say("error", str(error), WRONG)
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop from "):  # so says Python to 3.12
        return _say(
            "error", f"{str(error).removeprefix('Symlink loop from ')} is a link that leads back to itself", WRONG
        )
    if isinstance(error, FileNotFoundError) and not _has_working_directory():
        return _say("error", "the working directory is gone; change to a folder that there is", WRONG)
    return _fault(error, output)


def _has_working_directory() -> bool:
    """Return whether the folder in which the command was started is there still."""
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Note each Ctrl-C: a library that is interrupted may raise an error of its own in its place."""
    noted: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield noted
        return

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _said_in_words() -> Iterator[None]:
    """Collect what libraries warn of while a command runs, and say in words at its end what concerns the user."""
    collected = Warned()
    try:
        with collected:
            yield
    finally:
        for sentence in collected.sentences():
            Console(stderr=True).print(Text(f"note: {sentence}", style="yellow"), soft_wrap=True)


def _fault(error: Exception, output: Path | None) -> int:
    """Say what else went wrong: of the machine, in the user's own code, or in ours."""
    import click
    import typer

    if isinstance(error, typer.Exit | typer.Abort | click.exceptions.ClickException):
        raise error
    if isinstance(error, WorkError):
        return _say("failed", str(error), FAILED)
    if isinstance(error, MemoryError):
        return _say("failed", "the memory does not suffice; give less at once, or fewer --jobs", FAILED)
    if isinstance(error, OSError) and error.errno in _MACHINE:
        about = f"{error.filename}: " if error.filename else ""
        return _say("failed", f"{about}{error.strerror}", FAILED)
    own = own_code(error.__traceback__)
    why = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
    if not own and (library := _imported_library(error.__traceback__)):
        remedy = "set the environment variable right that it reads as it is imported, or install it again"
        return _say("failed", f"{library} cannot be imported: {why}; {remedy}", FAILED)
    kept = write_crash(error, output)
    kept_in = f"the traceback is in {kept}" if kept else "the traceback could not be written (--debug shows it)"
    if own:
        return _say("error", f"your own code, {own}, raised {why}; {kept_in}", WRONG)
    return _say("fault", f"{why}; this is a fault of the harness: please report it; {kept_in}", BUG)


def _say(title: str, message: str, status: int, with_traceback: bool = True) -> int:
    """Print a message in red on stderr, the traceback first if asked for, and return the status."""
    if _debug[0] and with_traceback:
        traceback.print_exc()
    Console(stderr=True).print(Text(f"{title}: {message}", style="red"), soft_wrap=True)
    return status


def own_code(trail: TracebackType | None) -> str:
    """Return file and line of the innermost code of the user's own in a traceback; empty if there is none."""
    ours = outside_packages()
    place = ""
    for frame, line in traceback.walk_tb(trail):
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] in ours:
            place = f"{frame.f_code.co_filename} line {line}"
    return place


def _imported_library(trail: TracebackType | None) -> str:
    """Return the library whose import was under way in a traceback; empty if the import was of ours, or none was."""
    modules = [frame.f_globals for frame, _ in traceback.walk_tb(trail) if frame.f_code.co_name == "<module>"]
    name = str(modules[-1].get("__name__", "")).partition(".")[0] if modules else ""
    return "" if name in ("harness", "__main__") else name


def stage_of(trail: TracebackType | None) -> str:
    """Return the innermost package of the harness in a traceback, such as ``recordings``."""
    names = [str(frame.f_globals.get("__name__", "")).split(".") for frame, _ in traceback.walk_tb(trail)]
    stages = [name[1] for name in names if name[0] == "harness" and len(name) > 1]
    return stages[-1] if stages else "command line"


def write_crash(error: Exception, output: Path | None) -> Path | None:
    """Write what a report of a fault needs: version, command, stage, traceback.

    Args:
        error: What was raised.
        output: File or folder that the command writes; the working directory if absent.

    Returns:
        The file, in the folder itself, else in the working directory or that of temporary files; ``None`` if it can be
        written to none of them.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        release = version("robustness-harness")
    except PackageNotFoundError:
        release = "unknown"
    packages = [f"{name} {sys.modules[name].__version__}" for name in _LIBRARIES if name in sys.modules]
    lines = [
        f"harness {release}, Python {platform.python_version()}, {platform.platform()}",
        ", ".join(packages),
        f"command: {shlex.join(sys.argv)}",
        f"stage: {stage_of(error.__traceback__)}",
        "",
        "".join(traceback.format_exception(error)),
    ]
    name = f"crash-{time.strftime('%Y%m%dT%H%M%S', time.gmtime())}-{time.time_ns() % 10**6:06d}.txt"
    out = None if output is None else output.parent if output.suffix and not output.is_dir() else output
    for folder in (out, Path(), Path(tempfile.gettempdir())):
        if folder is not None:
            try:
                places.write(folder / name, "\n".join(lines).encode(errors="backslashreplace"))
            except (OSError, ValueError):
                continue
            return folder / name
    return None


_LIBRARIES = ("numpy", "scipy", "numba", "sympy", "xarray", "zarr", "pandas", "matplotlib", "typst", "pydantic")


def place_of_output(arguments: Mapping[str, Any] | Sequence[str]) -> Path | None:
    """Return what a command writes, from its arguments: by name, or the words of a command line."""
    if not isinstance(arguments, Mapping):
        words = list(arguments)
        given = words[words.index("--out") + 1 :][:1] if "--out" in words else []
        return Path(given[0]) if given else None
    output = arguments.get("out") or arguments.get("folder")
    return output if isinstance(output, Path) else None


_FLOATING = re.compile(
    r"overflow|underflow|invalid value|divide by zero|division by zero|empty slice|All-NaN|Degrees of freedom|"
    r"singular|ill-conditioned|invalid cast|SVD"
)
_GLYPH = re.compile(r"Glyph .* missing|does not have a glyph|findfont")
_FOR_DEVELOPERS = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ResourceWarning, ImportWarning)

NUMBERS = (
    "some intermediate numbers were too large or not defined for floating point; results that depend on them are shown "
    "as missing, lost or diverged"
)
GLYPHS = "some characters of names or labels are not in the fonts of the figures and are left out there"


class Warned(logging.Handler):
    """Collects warnings and log messages of libraries within a block; each kind is said once, in words.

    What is for developers (deprecations, resources) is dropped: no user can mend it. Warnings are collected for the
    whole process, threads included.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._said: Counter[str] = Counter()

    def __enter__(self) -> Warned:
        self._catching = warnings.catch_warnings()
        self._catching.__enter__()
        warnings.simplefilter("default")
        warnings.showwarning = self._take  # type: ignore[assignment]
        logging.getLogger().addHandler(self)
        self._unraisable = sys.unraisablehook
        sys.unraisablehook = _unraisable
        return self

    def __exit__(self, *_: object) -> None:
        sys.unraisablehook = self._unraisable
        logging.getLogger().removeHandler(self)
        self._catching.__exit__(None, None, None)

    def _take(self, message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
        if issubclass(category, _FOR_DEVELOPERS):
            return
        if own := _own(filename):
            self._said[f"your own code, {own} line {lineno}, warns: {_one_line(message)}"] += 1
        elif _GLYPH.search(str(message)):
            self._said[GLYPHS] += 1
        elif issubclass(category, RuntimeWarning) or _FLOATING.search(str(message)):
            self._said[NUMBERS] += 1
        else:
            self._said[f"a library says: {_one_line(message)}"] += 1

    def emit(self, record: logging.LogRecord) -> None:
        """Take a log message."""
        said = record.getMessage()
        self._said[GLYPHS if _GLYPH.search(said) else f"a library says: {_one_line(said)}"] += 1

    def sentences(self) -> list[str]:
        """Return what was collected, in the order of first appearance."""
        return list(self._said)


def _unraisable(ignored: Any) -> None:
    """Drop what fails while a library cleans up after a damaged file; Ctrl-C at such a moment comes once more."""
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        again = threading.Timer(0.05, _thread.interrupt_main)  # at once it would be dropped again
        again.daemon = True
        again.start()


def _one_line(message: object) -> str:
    return " ".join(str(message).split())[:300]


def _own(filename: str) -> str:
    """Return the file if it is code of the user's own that the harness runs."""
    for name in sorted(outside_packages()):
        for module in [m for n, m in list(sys.modules.items()) if n.partition(".")[0] == name]:
            if getattr(module, "__file__", None) == filename:
                return filename
    return ""
