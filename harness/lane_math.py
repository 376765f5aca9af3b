"""Elementary functions of lanes as branch-free polynomials.

Coefficients are those of the Cephes library (Moshier 1992). Each function is accurate to a few units in the
last place over the range vehicle models use; ``tests/harness/test_lanes.py`` states and checks the bounds.
"""

from __future__ import annotations

from math import inf, nan, pi

from numba import njit

from harness.lanes import absolute, copysign, exponent_of, floor, fma, power_of_two, select

_jit = njit(error_model="numpy", cache=False)

_HALF_PI = 1.5707963267948966
_HALF_PI_REST = 6.123233995736766e-17  # pi/2 minus its double
_LN2 = 0.6931471805599453
_LN2_HIGH, _LN2_REST = 6.93145751953125e-1, 1.42860682030941723212e-6


@_jit
def _reduce(x):
    """Return the quadrant (0 to 3) and the rest of an angle, |rest| <= pi/4."""
    k = floor(x * (1.0 / _HALF_PI) + 0.5)
    rest = fma(k, -_HALF_PI_REST, fma(k, -_HALF_PI, x))
    return k - 4.0 * floor(0.25 * k), rest


@_jit
def _sin_near_zero(r):
    z = r * r
    p = (((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z
        - 1.98412698295895385996e-4) * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1)  # fmt: skip
    return r + r * z * p


@_jit
def _cos_near_zero(r):
    z = r * r
    p = (((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z
        + 2.48015872888517045348e-5) * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2)  # fmt: skip
    return 1.0 - 0.5 * z + z * z * p


@_jit
def sin(x):
    """Return the sine."""
    q, r = _reduce(x)
    odd = (q == 1.0) | (q == 3.0)
    value = select(odd, _cos_near_zero(r), _sin_near_zero(r))
    return select(q >= 2.0, -value, value)


@_jit
def cos(x):
    """Return the cosine."""
    q, r = _reduce(x)
    odd = (q == 1.0) | (q == 3.0)
    value = select(odd, _sin_near_zero(r), _cos_near_zero(r))
    return select((q == 1.0) | (q == 2.0), -value, value)


@_jit
def tan(x):
    """Return the tangent."""
    q, r = _reduce(x)
    odd = (q == 1.0) | (q == 3.0)
    s, c = _sin_near_zero(r), _cos_near_zero(r)
    return select(odd, -c, s) / select(odd, s, c)


@_jit
def atan(x):
    """Return the arc tangent, one division for the argument's reduction and one for the rational function."""
    a = absolute(x)
    large, middle = a > 2.414213562373095, a > 0.66
    top = select(large, -1.0, select(middle, a - 1.0, a))
    bottom = select(large, a, select(middle, a + 1.0, 1.0))
    offset = select(large, _HALF_PI, select(middle, 0.25 * pi, 0.0))
    t = top / bottom
    z = t * t
    p = ((((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z
        - 1.228866684490136173410e2) * z - 6.485021904942025371773e1)  # fmt: skip
    q = (((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z
        + 4.853903996359136964868e2) * z + 1.945506571482613964425e2)  # fmt: skip
    return copysign(offset + (t + t * z * (p / q)), x)


@_jit
def exp(x):
    """Return e to the power x; 0 below -708 and infinity above 709."""
    inside = select(x > 709.0, 709.0, select(x < -708.0, -708.0, x))
    k = floor(inside * (1.0 / _LN2) + 0.5)
    r = fma(k, -_LN2_REST, fma(k, -_LN2_HIGH, inside))
    z = r * r
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1)
    q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    value = (1.0 + 2.0 * (p / (q - p))) * power_of_two(k)
    value = select(x > 709.0, inf, select(x < -708.0, 0.0, value))
    return select(x == x, value, nan)


@_jit
def log(x):
    """Return the natural logarithm of positive normal numbers, NaN for negative ones, -infinity at zero."""
    e = exponent_of(x)
    m = x * power_of_two(-e)  # in [1, 2)
    high = m > 1.4142135623730951
    e = select(high, e + 1.0, e)
    f = select(high, 0.5 * m, m) - 1.0
    z = f * f
    p = (((((1.01875663804580931796e-4 * f + 4.97494994976747001425e-1) * f + 4.70579119878881725854e0) * f
        + 1.44989225341610930846e1) * f + 1.79368678507819816313e1) * f + 7.70838733755885391666e0)  # fmt: skip
    q = (((((f + 1.12873587189167450590e1) * f + 4.52279145837532221105e1) * f + 8.29875266912776603211e1) * f
        + 7.11544750618563894466e1) * f + 2.31251620126765340583e1)  # fmt: skip
    value = f + (f * z * (p / q) - 2.121944400546905827679e-4 * e - 0.5 * z) + 0.693359375 * e
    return select(x > 0.0, value, select(x == 0.0, -inf, nan))


@_jit
def tanh(x):
    """Return the hyperbolic tangent."""
    a = absolute(x)
    z = x * x
    p = (-9.64399179425052238628e-1 * z - 9.92877231001918586564e1) * z - 1.61468768441708447952e3
    q = ((z + 1.12811678491632931402e2) * z + 2.23548839060100448583e3) * z + 4.84406305325125486048e3
    small = x + x * z * (p / q)
    large = copysign(1.0 - 2.0 / (exp(2.0 * a) + 1.0), x)
    return select(a < 0.625, small, large)


@_jit
def sign(x):
    """Return -1, 0 or 1."""
    return select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0 * x))


@_jit
def maximum(a, b):
    """Return the larger of two lanes or numbers; NaN in ``a`` stays NaN."""
    return select(a < b, b, a)


@_jit
def minimum(a, b):
    """Return the smaller of two lanes or numbers; NaN in ``a`` stays NaN."""
    return select(a > b, b, a)
