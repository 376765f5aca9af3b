"""A lane on a graphics card: one number, of one thread. What ``harness.engine.simd.lanes`` is on a processor.

An array ends in an axis of runs there as well. A thread sees one column of it (``own``), and what it has for itself has
one column, so ``get`` and ``put`` read and write number 0 of the last axis of either. Plain functions of numba, so that
its simulator runs them, too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import config

from harness.cuda.compiling import device, inlined


def _typed(*functions: Any) -> Any:
    """Return functions of two kinds as one."""
    return functions


if config.ENABLE_CUDASIM:

    def fma(x, y, z):
        """Return ``x y + z``, rounded twice where there is no card."""
        return x * y + z

    @device
    def upper_half(a, b):
        """Return the upper 64 bits of the product of two words."""
        return np.uint64((int(a) * int(b)) >> 64)

    floor, sqrt, absolute, copysign = _typed(np.floor, np.sqrt, np.abs, np.copysign)
else:
    from numba.cuda import libdevice

    fma = libdevice.fma
    floor, sqrt, absolute, copysign = _typed(libdevice.floor, math.sqrt, math.fabs, math.copysign)

    @device
    def upper_half(a, b):
        """Return the upper 64 bits of the product of two words."""
        return np.uint64(libdevice.umul64hi(a, b))


LANES = 1


@device
def get(array, *indices):
    """Return the number at ``array[indices]`` of this thread; one index fewer than the array has axes."""
    return array[indices + (0,)]  # noqa: RUF005 - numba knows no unpacking here


@device
def put(value, array, *indices):
    """Write a number to ``array[indices]`` of this thread."""
    array[indices + (0,)] = value  # noqa: RUF005


@inlined
def own(array, thread):
    """Return the column of a thread, ``(..., 1)``, of ``(..., runs)``; what is ``(..., 1)`` all have in common."""
    column = min(thread, array.shape[array.ndim - 1] - 1)
    return array[..., column : column + 1]


@device
def splat(value):
    """Return a number as such."""
    return float(value)


@device
def select(condition, yes, no):
    """Return ``yes`` where the condition holds, else ``no``."""
    return yes if condition else no


@device
def inverted(condition):
    """Return whether a condition does not hold: ``~`` of a mask, which of Python's truth values is no truth value."""
    return not condition


@device
def is_nan(value):
    """Return whether it is not a number."""
    return value != value


@device
def any_of(condition):
    """Return whether the condition holds for this thread."""
    return condition


@device
def power_of_two(exponent):
    """Return ``2**k`` for whole ``k`` in [-1022, 1023]."""
    return math.ldexp(1.0, int(exponent))


@device
def exponent_of(value):
    """Return ``e`` with ``value = m * 2**e`` and ``1 <= m < 2`` for positive normal numbers."""
    return math.frexp(value)[1] - 1.0


@inlined
def borrowed(arrays):
    """Return the same: a card counts no users of an array."""
    return arrays


@inlined
def retain(arrays):
    """Do nothing, as ``borrowed`` does."""


@inlined
def shaped(array, sizes):
    """Return an array of which the sizes are told to whoever compiles it, 0 for one that is not known before."""
    return array
