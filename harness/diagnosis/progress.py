"""What a trace is doing, for how long, and about how long it will take yet."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

_ROUND = re.compile(r"round (\d+):")


class Stages:
    """The stages of a trace by the time at which they began.

    How many rounds there will be is not known. The last one adds nothing and is as long as the one before it or
    shorter, so that is what is left at least; what follows the rounds takes about half of one.

    Args:
        clock: Returns s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._begun = clock, clock()
        self._rounds: dict[int, float] = {}

    def said(self, what: str) -> str:
        """Return a stage in a line: what, since when, and about how long it takes yet where that can be said."""
        now = self._clock()
        found = _ROUND.match(what)
        if found:
            self._rounds.setdefault(int(found[1]), now)
        left = self._left(now) if found else ""
        return f"{_minutes(now - self._begun)}  {what}{left}"

    def _left(self, now: float) -> str:
        last = max(self._rounds)
        if last - 1 not in self._rounds:
            return ""
        whole = 1.5 * (self._rounds[last] - self._rounds[last - 1])
        return f"; about {_minutes(max(0.0, whole - (now - self._rounds[last])))} left if it is the last round"


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


@contextmanager
def progress(console: Console) -> Iterator[Callable[[str], None]]:
    """Show what is being done: a moving bar on a terminal, elsewhere a line per stage."""
    stages = Stages()
    if not console.is_terminal:

        def line(what: str) -> None:
            console.print(Text(stages.said(what)), soft_wrap=True)

        line("compiling the library of effects")
        yield line
        return
    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("compiling the library of effects", total=None)
        yield lambda what: bar.update(task, description=stages.said(what))
