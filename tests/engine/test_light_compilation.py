"""What is left out of compilation changes no machine code, and nothing stays switched off behind it."""

import gc
import re

import numpy as np
import pytest
from numba import literal_unroll, njit
from numba.core import event, ir, types
from numba.core.errors import TypingError

from harness.engine.simd.inner import compile_lightly
from harness.engine.simd.lanes import get, put

VECTORS = types.Array(types.float64, 2, "C")

compile_lightly()


def add_twice(x, y):
    """Call a function that is compiled in, which calls another one in a loop, twice."""
    _rows(x, y)
    _rows(y, x)


@njit(error_model="numpy", inline="always")
def _row(x, y, i):
    if i % 2 == 0:
        put(get(x, i) + get(y, i), y, i)
    else:
        put(get(x, i) * get(y, i), y, i)


@njit(error_model="numpy", inline="always")
def _rows(x, y):
    for i in range(x.shape[0]):
        _row(x, y, i)


def instructions(function):
    """Return the machine code of a function for two arrays, without the number that numba gives each function.

    Sizes of texts that hold the number grow with its digits.
    """
    compiled = njit(error_model="numpy")(function)
    compiled.compile((VECTORS, VECTORS))
    (code,) = compiled.inspect_asm().values()
    return re.sub(r"_ZN\w+|v\d+B\w+|\.L\w+|\.size\s.*", "", code)


def test_machine_code_is_that_of_numba_as_it_is(monkeypatch):
    light = instructions(add_twice)
    assert "mul" in light
    monkeypatch.delattr(ir.Scope, "__deepcopy__")
    assert instructions(add_twice) == light


def test_no_variable_is_copied_with_a_block(monkeypatch):
    copied, copy = [], ir.Var.__deepcopy__
    monkeypatch.setattr(ir.Var, "__deepcopy__", lambda var, memo: copied.append(var.name) or copy(var, memo))
    instructions(add_twice)
    light, copied[:] = len(copied), []
    monkeypatch.delattr(ir.Scope, "__deepcopy__")
    instructions(add_twice)
    assert len(copied) > 3 * light > 0


def test_a_loop_that_numba_copies_for_each_type_is_as_before():
    @njit
    def total(parts):
        found = 0.0
        for part in literal_unroll(parts):
            found += 2.0 * part
        return found

    assert total((1, 2.5, np.float32(0.5))) == 8.0


class Seen(event.Listener):
    """Notes at the start of each compilation how many new objects make Python look for garbage."""

    def __init__(self):
        self.at = []

    def on_start(self, event):
        self.at.append(gc.get_threshold()[0])

    def on_end(self, event):
        pass


@pytest.mark.parametrize(("usual", "meanwhile"), [(700, 50_000), (0, 0), (900_000, 900_000)])
def test_garbage_is_looked_for_rarely_while_numba_compiles_and_as_before_behind_it(usual, meanwhile):
    @njit
    def half(x):
        return x / 2

    @njit
    def halves(x):
        return half(x) + half(x)

    @njit
    def wrong(x):
        return half(x) + undefined  # noqa: F821

    before, seen = gc.get_threshold(), Seen()
    gc.set_threshold(usual, *before[1:])
    try:
        with event.install_listener("numba:compile", seen):
            assert halves(3.0) == 3.0
            assert gc.get_threshold()[0] == usual
            with pytest.raises(TypingError):
                wrong(3)
        assert gc.get_threshold()[0] == usual
    finally:
        gc.set_threshold(*before)
    assert len(seen.at) >= 3
    assert set(seen.at) == {meanwhile}
