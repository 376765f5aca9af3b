"""Progress of a command in stages: a spinner on a terminal, lines elsewhere."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, TextColumn
from rich.table import Column
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
        """Show the next stage."""
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


def bar(console: Console, *further: ProgressColumn, widest: int = 20, transient: bool = True) -> Progress:
    """Return a progress bar of one line: what is done, a bar, and further columns.

    Args:
        console: Where it is shown.
        further: Columns behind the bar; 56 characters less ``widest`` are left to them on a line of 80.
        widest: Characters of what is done, which is cut behind them.
        transient: Whether it goes away at the end.
    """
    what = TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis", max_width=widest))
    return Progress(SpinnerColumn(), what, BarColumn(bar_width=12), *further, console=console, transient=transient)
