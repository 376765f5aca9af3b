"""What libraries warn of while a command runs, in words; nothing of it reaches the user raw."""

from __future__ import annotations

import logging
import re
import sys
import warnings
from collections import Counter
from typing import Any

from harness.common.components import outside_packages

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
        sys.unraisablehook = lambda _: None  # what fails while a library cleans up after a damaged file
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


def _one_line(message: object) -> str:
    return " ".join(str(message).split())[:300]


def _own(filename: str) -> str:
    """Return the file if it is code of the user's own that the harness runs."""
    for name in sorted(outside_packages()):
        for module in [m for n, m in list(sys.modules.items()) if n.partition(".")[0] == name]:
            if getattr(module, "__file__", None) == filename:
                return filename
    return ""
