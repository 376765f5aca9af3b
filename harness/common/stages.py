"""Progress of a command in stages: a spinner on a terminal, lines elsewhere."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

PAUSE = 5.0
"""s; without a terminal what takes less leaves no line, and there is one in this time at most."""


@contextmanager
def showing(console: Console, what: str, pause: float = PAUSE) -> Iterator[Callable[[str], None]]:
    """Show a stage, and give what shows the next one.

    Args:
        console: Where it is shown.
        what: The first stage.
        pause: See ``PAUSE``.
    """
    if console.is_terminal:
        with console.status(what) as status:
            yield lambda text: status.update(text)
        return
    lines = _Lines(console, what, pause)
    try:
        yield lines.show
    finally:
        lines.end()


class _Lines:
    """Prints in the background what is being done whenever a pause has passed and it is something else than before."""

    def __init__(self, console: Console, what: str, pause: float) -> None:
        self._console, self._now, self._pause = console, what, pause
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def show(self, what: str) -> None:
        """Say what is being done now."""
        self._now = what

    def end(self) -> None:
        """Print no more."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        said = ""
        while not self._over.wait(self._pause):
            if self._now != said:
                said = self._now
                self._console.print(Text(said), soft_wrap=True)
