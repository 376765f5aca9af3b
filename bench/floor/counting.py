"""Count the operations on lanes that a compiled kernel carries out.

The sources of the kernel run as ordinary Python over numbers that count (``counted``): every function that numba
compiled is taken back to its Python form, and the intrinsics of ``harness.engine.simd`` are replaced by theirs here.
So nothing is known twice, branches are those that the data take, and a product that a sum takes up at once counts as
one multiply-add, as the compiler makes of it (``contract``).
"""

from __future__ import annotations

import types
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from harness.engine.simd import lanes, memory, random

counts: Counter[str] = Counter()
"""Operations by kind since it was last cleared: each on all lanes at once."""


class Lane:
    """Numbers of all lanes, with the operators that kernels use; each counts."""

    __array_ufunc__ = None

    def __init__(self, values: Any, product: bool = False) -> None:
        self.values = np.broadcast_to(values, lanes.LANES)
        self._product = product  # not taken up by a sum yet

    def _summed(self, other: Any, values: Any) -> Lane:
        for each in (self, other):
            if isinstance(each, Lane) and each._product:
                each._product = False
                counts["multiply"] -= 1
                counts["multiply-add"] += 1
                return Lane(values)
        counts["add"] += 1
        return Lane(values)

    def __add__(self, other: Any) -> Lane:
        return self._summed(other, self.values + _of(other))

    def __sub__(self, other: Any) -> Lane:
        return self._summed(other, self.values - _of(other))

    def __rsub__(self, other: Any) -> Lane:
        return self._summed(other, _of(other) - self.values)

    def __mul__(self, other: Any) -> Lane:
        counts["multiply"] += 1
        return Lane(self.values * _of(other), product=True)

    def __truediv__(self, other: Any) -> Lane:
        if not isinstance(other, Lane):  # by a number that is the same everywhere: its inverse is a constant (``arcp``)
            return self * (1.0 / other)
        return _called("divide", self.values / other.values)

    def __rtruediv__(self, other: Any) -> Lane:
        return _called("divide", other / self.values)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Lane:
        return Lane(-self.values)  # a sign of a multiply-add or of a sum

    def __lt__(self, other: Any) -> Mask:
        return _compared(self.values < _of(other))

    def __le__(self, other: Any) -> Mask:
        return _compared(self.values <= _of(other))

    def __gt__(self, other: Any) -> Mask:
        return _compared(self.values > _of(other))

    def __ge__(self, other: Any) -> Mask:
        return _compared(self.values >= _of(other))

    def __eq__(self, other: Any) -> Any:
        return _compared(self.values == _of(other))

    __hash__ = None  # type: ignore[assignment]


class Mask:
    """Truth values of all lanes; what combines them is not arithmetic and is not counted."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def __and__(self, other: Mask) -> Mask:
        return Mask(self.values & other.values)

    def __or__(self, other: Mask) -> Mask:
        return Mask(self.values | other.values)

    def __invert__(self) -> Mask:
        return Mask(~self.values)


def _of(value: Any) -> Any:
    return value.values if isinstance(value, Lane) else value


def _called(kind: str, values: Any) -> Lane:
    counts[kind] += 1
    return Lane(values)


def _compared(values: Any) -> Mask:
    counts["compare"] += 1
    return Mask(values)


def _get(array: Any, *index: Any) -> Lane:
    counts["load"] += 1
    return Lane(np.array(array[index]))


def _put(value: Any, array: Any, *index: Any) -> None:
    counts["store"] += 1
    array[index] = _of(value)


def _fma(a: Any, b: Any, c: Any) -> Lane:
    return _called("multiply-add", _of(a) * _of(b) + _of(c))


def _gather(array: Any, rows: Lane, index: int) -> Lane:
    return _called("gather", array[rows.values.astype(int), index, np.arange(lanes.LANES)])


_dice = np.random.default_rng(0)
"""Where a kernel draws, any numbers of the same kind will do: what is counted does not depend on them."""

_INTRINSICS: dict[Any, Callable[..., Any]] = {
    lanes.get: _get,
    lanes.put: _put,
    lanes.fma: _fma,
    lanes.splat: Lane,
    lanes.sqrt: lambda x: _called("root", np.sqrt(_of(x))),
    lanes.floor: lambda x: _called("round", np.floor(_of(x))),
    lanes.absolute: lambda x: Lane(abs(_of(x))),  # bits, beside the arithmetic
    lanes.copysign: lambda x, y: Lane(np.copysign(_of(x), _of(y))),
    lanes.select: lambda mask, yes, no: _called("select", np.where(mask.values, _of(yes), _of(no))),
    lanes.is_nan: lambda x: _compared(np.isnan(x.values)),
    lanes.any_of: lambda mask: bool(np.any(mask.values)),
    lanes.power_of_two: lambda k: _called("add", np.ldexp(1.0, np.clip(_of(k), -1022, 1023).astype(int))),
    lanes.exponent_of: lambda x: _called("add", np.frexp(_of(x))[1] - 1.0),
    random.gather: _gather,
    memory.borrowed: lambda arrays: arrays,
    memory.retain: lambda arrays: None,
    random.next_words: lambda s0, s1: (_called("draw", 0.0), s0, s1),
    random.uniform: lambda word: Lane(_dice.uniform(size=lanes.LANES)),
    random.normal_pair: lambda word: (
        _called("normal pair", _dice.normal(size=lanes.LANES)),
        Lane(_dice.normal(size=8)),
    ),
}


def counted(function: Any) -> Callable[..., Any]:
    """Return a compiled function as one of Python that counts what it does."""
    return _python(function, {})


def _python(value: Any, translated: dict[int, Any]) -> Any:
    """Return what stands for a global of a kernel."""
    for intrinsic, stand_in in _INTRINSICS.items():
        if value is intrinsic:
            return stand_in
    if isinstance(value, types.FunctionType) and value.__module__.startswith("harness"):
        function = value
    elif isinstance(value, Dispatcher):
        function = value.py_func
    else:
        return value
    if id(function) not in translated:
        translated[id(function)] = made = types.FunctionType(
            function.__code__, {}, function.__name__, function.__defaults__, function.__closure__
        )
        made.__globals__.update(
            {k: _python(v, translated) for k, v in function.__globals__.items() if k in _names(function.__code__)}
        )
    return translated[id(function)]


def _names(code: types.CodeType) -> set[str]:
    inner = [c for c in code.co_consts if isinstance(c, types.CodeType)]
    return {*code.co_names, *(name for c in inner for name in _names(c))}
