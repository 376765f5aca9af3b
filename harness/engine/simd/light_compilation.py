"""Two things that numba does while it compiles and that take half of its time, left out.

Where a function is compiled into its caller (``inline="always"``), numba copies it block by block, and every block
names the scope of the function: all its variables are copied as often as it has blocks. And a compilation makes
millions of objects that stay, among which Python looks for garbage again and again. Machine code is the same without
both (``tests/engine/test_light_compilation.py``).
"""

from __future__ import annotations

import functools
import gc
from typing import Any

from numba.core import event, ir


@functools.cache
def compile_lightly() -> None:
    """Leave out needless work whenever this process compiles."""
    ir.Scope.__deepcopy__ = _itself
    event.register("numba:compile", NO_COLLECTION)


def _itself(scope: ir.Scope, memo: dict[int, Any]) -> ir.Scope:
    """Copy a block without its scope: the blocks of a function have one, and its copy is of the same function."""
    return scope


class NoCollection(event.Listener):
    """Lets the collector of garbage rest while numba compiles, which it does in one thread at a time."""

    def __init__(self) -> None:
        self._depth, self._rests = 0, False

    def on_start(self, event: event.Event) -> None:
        """Stop collecting where the outermost function begins."""
        if self._depth == 0:
            self._rests = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Go on collecting where it ends."""
        self._depth -= 1
        if self._depth == 0 and self._rests:
            gc.enable()


NO_COLLECTION = NoCollection()
