"""Stages of a command: a spinner on a terminal, lines without one."""

import io
import time

import pytest
from rich.console import Console
from rich.progress import MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from harness.common.stages import bar, showing

FIRST = "the first, which is longer than a line"


def test_without_a_terminal_what_takes_longer_than_a_pause_is_a_line_once() -> None:
    written, end = io.StringIO(), time.monotonic() + 60.0
    with showing(Console(file=written, width=20), FIRST, pause=0.02) as show:
        while FIRST not in written.getvalue() and time.monotonic() < end:
            time.sleep(0.1)
        show("second")
        while "second" not in written.getvalue() and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(0.1)
    assert written.getvalue().splitlines() == [FIRST, "second"]


def test_what_takes_less_leaves_no_line() -> None:
    written = io.StringIO()
    with showing(Console(file=written), FIRST, pause=60.0) as show:
        for step in range(100):
            show(f"step {step}")
    assert not written.getvalue()


def test_on_a_terminal_no_line_is_left() -> None:
    written = io.StringIO()
    with showing(Console(file=written, force_terminal=True, width=40), "reading") as show:
        show("writing")
    assert written.getvalue().endswith("\x1b[2K")  # the line is erased


@pytest.mark.parametrize(
    ("columns", "widest"),
    [
        ((MofNCompleteColumn(), TextColumn("12345 runs/s"), TextColumn("left"), TimeRemainingColumn()), 20),
        ((TimeElapsedColumn(),), 54),
    ],
)
def test_a_progress_line_fits_80_columns(columns, widest) -> None:
    written = io.StringIO()
    progress = bar(Console(file=written, width=200, force_terminal=True, color_system=None), *columns, widest=widest)
    progress.add_task("what takes long, of a study with a name of many words" * 3, total=10**6, completed=123_456)
    progress.console.print(progress.get_renderable())
    (line,) = written.getvalue().splitlines()
    assert len(line.rstrip()) <= 80
    assert "what takes long" in line
