"""Parts of a result that could not be made: each costs a sentence, and not the rest of the result.

What took minutes to compute must not be lost because a figure cannot be drawn afterwards. Whoever puts a result
together tries each part by ``Failures.attempt``; a failure is never silent: there is a warning on the console, the
traceback is written to a file, and the result says what is missing.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.text import Text

from harness.common import places
from harness.common.errors import ModelError, UserError

T = TypeVar("T")
U = TypeVar("U")

FILE = "errors.txt"
"""Takes the tracebacks, in the folder of the results."""

_LONGEST = 300
"""Characters of a reason; the traceback has all of it."""


class Failures:
    """Parts of one result that could not be made.

    Args:
        folder: Of the result, made if absent; the tracebacks of an earlier one are removed from it. Without a folder
            whatever fails is raised.
        console: Takes the warnings; stderr by default.

    Attributes:
        sentences: What could not be made and why, in the order in which it was tried.

    Raises:
        UserError: If the folder cannot be written to.
    """

    def __init__(self, folder: Path | None = None, console: Console | None = None) -> None:
        self._file = None if folder is None else folder / FILE
        self._console = console
        self.sentences: list[str] = []
        self._trails: list[str] = []
        if self._file is not None:
            try:
                self._file.parent.mkdir(parents=True, exist_ok=True)
                self._file.unlink(missing_ok=True)
            except OSError as error:
                raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None

    def attempt(self, part: str, make: Callable[[], T], instead: Callable[[str], U]) -> T | U:
        """Return a part of a result, or its substitute if it cannot be made.

        Args:
            part: What is made, such as ``the figure “Innovations”``.
            make: Makes it.
            instead: Returns the substitute; takes the reason with the path of the file that holds the traceback.

        Raises:
            MemoryError: If the memory does not suffice; then the rest cannot be made either.
            UserError: If the traceback cannot be written.
        """
        if self._file is None:
            return make()
        try:
            return make()
        except MemoryError:
            raise
        except Exception as error:  # whatever it is, the other parts stand
            why = f"{reason(error)}; the traceback is in {self._file}"
            self._note(f"{part} could not be made: {why}.", traceback.format_exc())
        return instead(why)

    def _note(self, sentence: str, trail: str) -> None:
        assert self._file is not None
        if sentence in self.sentences:  # the record is written more than once
            return
        self.sentences.append(sentence)
        self._trails.append(f"{sentence}\n\n{trail}\n")
        try:
            places.write(self._file, "".join(self._trails).encode(errors="backslashreplace"))
        except OSError as problem:
            raise UserError(f"{self._file}: cannot be written: {problem.strerror or problem}") from None
        console = self._console or Console(stderr=True)
        console.print(Text(f"warning: {sentence}", style="yellow"), soft_wrap=True)


RAISED = Failures()
"""Raises whatever fails."""


def reason(error: Exception) -> str:
    """Return an error on one line; one that is not meant for users with its type."""
    said = " ".join(str(error).split())
    if not isinstance(error, UserError | ModelError):
        said = f"{type(error).__name__}: {said}" if said else type(error).__name__
    return said.rstrip(".") if len(said) <= _LONGEST else f"{said[:_LONGEST]} …"
