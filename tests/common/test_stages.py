"""Stages of a command: a spinner on a terminal, lines without one."""

import io
import time

from rich.console import Console

from harness.common.stages import showing

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
