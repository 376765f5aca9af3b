"""What a trace is doing, for how long, and about how long it will take yet."""

from __future__ import annotations

import math
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
    shorter, so that is what is left of them at least. What follows the rounds, where every addition is questioned,
    takes about as long as they did: with many additions longer, with few or none far shorter.

    Args:
        clock: Returns s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._begun = clock, clock()
        self._rounds: list[float] = []  # how long each took, but for the one that is running
        self._round, self._since, self._ended = 0, 0.0, math.inf

    def said(self, what: str) -> str:
        """Return a stage in a line: what, since when, and about how long it takes yet where that can be said."""
        now = self._clock()
        found = _ROUND.match(what)
        if found and int(found[1]) > self._round:
            if self._round:
                self._rounds.append(min(now, self._ended) - self._since)
            self._round, self._since, self._ended = int(found[1]), now, math.inf
        elif not found and self._round:
            self._ended = min(self._ended, now)
        return f"{_minutes(now - self._begun)}  {what}{self._left(now)}"

    def _left(self, now: float) -> str:
        """Return how long is left, once a whole round is known."""
        if not self._rounds:
            return ""
        last = self._rounds[-1]
        if now < self._ended:
            left = max(0.0, self._since + last - now) + sum(self._rounds) + last
            return f"; about {_minutes(left)} left if it is the last round"
        left = sum(self._rounds) + self._ended - self._since - (now - self._ended)
        return f"; about {_minutes(left)} left" if left > 0 else ""


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
