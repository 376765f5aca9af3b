"""The exceptions for bad input, whose messages say what is wrong, where, and how to mend it; the closest name."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterator


class UserError(ValueError):
    """A request that cannot be carried out as stated; the command line shows the message and exits with 2."""


class MissingFileError(UserError, FileNotFoundError):
    """A file or folder that is named and not there."""


class WorkError(RuntimeError):
    """Work that could not be finished for a reason outside of what was asked, such as lost workers; exit status 1."""


class ModelError(ValueError):
    """A model, parameter or drive that cannot be built; the message says what, where and how to mend it."""


@contextlib.contextmanager
def placed(file: object, key: str) -> Iterator[None]:
    """Put file and key in front of what is said of a request that cannot be carried out, where it lacks the file."""
    try:
        yield
    except UserError as error:
        if str(error).startswith(f"{file}: "):
            raise
        raise UserError(f"{file}: {key}: {error}") from error


def closest(word: str, choices: list[str] | tuple[str, ...]) -> str:
    """Return ``"; closest: a, b"`` for the choices that resemble the word, or the whole list if none does."""
    near = difflib.get_close_matches(word, choices, n=3, cutoff=0.5)
    if near:
        return f"; closest: {', '.join(near)}"
    return f"; there are: {', '.join(choices)}" if choices else "; there are none"
