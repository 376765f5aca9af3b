"""How functions of lanes compile: only kernels can call them.

Two things that numba does while it compiles take half of its time and are left out. Where a function is compiled into
its caller (``inline="always"``), numba copies it block by block, and every block names the scope of the function: all
its variables are copied as often as it has blocks. And a compilation makes millions of objects that stay for a while,
among which Python looks for garbage again and again. Machine code is the same without both
(``tests/engine/test_light_compilation.py``).
"""

from __future__ import annotations

import functools
import gc
from typing import Any

from numba import njit
from numba.core import event, ir

_OBJECTS = 50_000
"""New ones at which Python looks for garbage; usually it does at 700."""


@functools.cache
def compile_lightly() -> None:
    """Leave out needless work whenever this process compiles."""
    ir.Scope.__deepcopy__ = _itself
    event.register("numba:compile", RARE_COLLECTION)


def _itself(scope: ir.Scope, memo: dict[int, Any]) -> ir.Scope:
    """Copy a block without its scope: the blocks of a function have one, and its copy is of the same function."""
    return scope


class RareCollection(event.Listener):
    """Lets the collector of garbage come rarely while numba compiles, which it does in one thread at a time."""

    def __init__(self) -> None:
        self._depth, self._usual = 0, gc.get_threshold()

    def on_start(self, event: event.Event) -> None:
        """Let it come rarely from where the outermost function begins."""
        if self._depth == 0:
            self._usual = gc.get_threshold()
            if 0 < self._usual[0] < _OBJECTS:  # 0: never
                gc.set_threshold(_OBJECTS, *self._usual[1:])
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Let it come as before where it ends."""
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._usual)


RARE_COLLECTION = RareCollection()


compile_lightly()

inner = njit(error_model="numpy", cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Without wrappers for callers outside, which take as long to compile as a function of lanes; Python has no lanes."""
