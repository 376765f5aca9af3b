"""Elementary functions of dual numbers: values are those of ``simd.functions``, tangents their derivatives."""

from __future__ import annotations

from harness.engine.simd import functions
from harness.engine.simd.dual import select, tangent_of, value_of, with_tangent
from harness.engine.simd.inner import inner

_sin, _cos, _tan, _atan = functions.sin, functions.cos, functions.tan, functions.atan
_exp, _log, _tanh, _sign = functions.exp, functions.log, functions.tanh, functions.sign


@inner
def sin(x):
    """Return the sine."""
    v = value_of(x)
    return with_tangent(_sin(v), _cos(v) * tangent_of(x))


@inner
def cos(x):
    """Return the cosine."""
    v = value_of(x)
    return with_tangent(_cos(v), -_sin(v) * tangent_of(x))


@inner
def tan(x):
    """Return the tangent."""
    t = _tan(value_of(x))
    return with_tangent(t, (1.0 + t * t) * tangent_of(x))


@inner
def atan(x):
    """Return the arc tangent."""
    v = value_of(x)
    return with_tangent(_atan(v), tangent_of(x) / (1.0 + v * v))


@inner
def exp(x):
    """Return e to the power x."""
    e = _exp(value_of(x))
    return with_tangent(e, e * tangent_of(x))


@inner
def log(x):
    """Return the natural logarithm."""
    v = value_of(x)
    return with_tangent(_log(v), tangent_of(x) / v)


@inner
def tanh(x):
    """Return the hyperbolic tangent."""
    t = _tanh(value_of(x))
    return with_tangent(t, (1.0 - t * t) * tangent_of(x))


@inner
def sign(x):
    """Return -1, 0 or 1, which do not change with x."""
    v = _sign(value_of(x))
    return with_tangent(v, 0.0 * v)


@inner
def maximum(a, b):
    """Return the larger of two duals or numbers, with its derivative; NaN in ``a`` stays NaN."""
    return select(a < b, b, a)


@inner
def minimum(a, b):
    """Return the smaller of two duals or numbers, with its derivative; NaN in ``a`` stays NaN."""
    return select(a > b, b, a)
