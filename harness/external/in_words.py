"""Errors of foreign code in one line."""

from __future__ import annotations

import os
import traceback


def in_words(error: BaseException) -> str:
    """Return an error of foreign code in one line, with the line of its code that raised it."""
    if isinstance(error, KeyboardInterrupt):
        return "it raised KeyboardInterrupt"
    if isinstance(error, SystemExit):
        return f"it called sys.exit({error.code!r})"
    text = " ".join(str(error).split())[:500]
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f"{os.sep}harness{os.sep}" not in f.filename]
    where = f" ({os.path.basename(frames[-1].filename)}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {text}{where}" if text else f"{type(error).__name__}{where}"
