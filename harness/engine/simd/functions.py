"""Elementary functions of lanes as branch-free polynomials.

Coefficients are those of the Cephes library (Moshier 1992) but for sine, cosine and arc tangent, whose polynomials are
interpolated at Chebyshev nodes with 60 digits: a longer polynomial costs less than a second one or a division. Each
function is accurate to a few units in the last place over the range vehicle models use;
``tests/engine/test_lanes.py`` states and checks the bounds.
"""

from __future__ import annotations

from math import inf, nan, pi

from harness.engine.simd.inner import inner
from harness.engine.simd.lanes import (
    absolute,
    copysign,
    exponent_of,
    floor,
    fma,
    power_of_two,
    select,
)

_HALF_PI = 1.5707963267948966
_HALF_PI_REST = 6.123233995736766e-17  # pi/2 minus its double
_PI_REST = 1.2246467991473532e-16
_LN2 = 0.6931471805599453
_LN2_HIGH, _LN2_REST = 6.93145751953125e-1, 1.42860682030941723212e-6


@inner
def _reduce(x):
    """Return the quadrant (0 to 3) and the rest of an angle, |rest| <= pi/4."""
    k = floor(x * (1.0 / _HALF_PI) + 0.5)
    rest = fma(k, -_HALF_PI_REST, fma(k, -_HALF_PI, x))
    return k - 4.0 * floor(0.25 * k), rest


@inner
def _sin_near_zero(r):
    z = r * r
    p = (((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z
        - 1.98412698295895385996e-4) * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1)  # fmt: skip
    return r + r * z * p


@inner
def _cos_near_zero(r):
    z = r * r
    p = (((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z
        + 2.48015872888517045348e-5) * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2)  # fmt: skip
    return 1.0 - 0.5 * z + z * z * p


@inner
def _sin_half_turn(r):
    z = r * r
    z2 = z * z  # in pairs (Estrin), half as deep as Horner's scheme
    p = -0.16666666666666666 + 0.008333333333333316 * z
    q = -0.00019841269841254966 + 2.7557319219160833e-06 * z
    r1 = -2.505210761669045e-08 + 1.6058977292642743e-10 * z
    s1 = -7.643969663988074e-13 + 2.7314368769379893e-15 * z
    p = (p + q * z2) + (r1 + s1 * z2) * (z2 * z2)
    return fma(r * z, p, r)


@inner
def sin(x):
    """Return the sine."""
    k = floor(x * (1.0 / pi) + 0.5)
    r = fma(k, -_PI_REST, fma(k, -pi, x))
    half = 0.5 * k
    value = _sin_half_turn(r)
    return select(half > floor(half), -value, value)


@inner
def cos(x):
    """Return the cosine."""
    k = floor(x * (1.0 / pi))
    m = k + 0.5
    r = fma(m, -_PI_REST, fma(m, -pi, x))
    half = 0.5 * k
    value = _sin_half_turn(r)
    return select(half > floor(half), value, -value)


@inner
def tan(x):
    """Return the tangent."""
    q, r = _reduce(x)
    odd = (q == 1.0) | (q == 3.0)
    s, c = _sin_near_zero(r), _cos_near_zero(r)
    return select(odd, -c, s) / select(odd, s, c)


@inner
def atan(x):
    """Return the arc tangent; the only division is that of the argument's reduction."""
    a = absolute(x)
    large, middle = a > 2.414213562373095, a > 0.41421356237309503
    top = select(large, -1.0, select(middle, a - 1.0, a))
    bottom = select(large, a, select(middle, a + 1.0, 1.0))
    offset = select(large, _HALF_PI, select(middle, 0.25 * pi, 0.0))
    t = top / bottom
    z = t * t
    z2 = z * z
    z4 = z2 * z2
    a0 = -0.3333333333333333 + 0.19999999999995516 * z
    a1 = -0.14285714284665682 + 0.11111111015187018 * z
    a2 = -0.0909090457530649 + 0.07692183125376892 * z
    a3 = -0.06664510525508936 + 0.05858140904866328 * z
    a4 = -0.050854078345894844 + 0.03923044778479309 * z
    p = (a0 + a1 * z2) + ((a2 + a3 * z2) + (a4 - 0.019175404711104935 * z2) * z4) * z4
    return copysign(offset + fma(t * z, p, t), x)


@inner
def _exp_fraction(x):
    """Return p, q and k of ``2^k (q + p) / (q - p)``, which is e to the power x; x is held between -708 and 709."""
    inside = select(x > 709.0, 709.0, select(x < -708.0, -708.0, x))
    k = floor(inside * (1.0 / _LN2) + 0.5)
    r = fma(k, -_LN2_REST, fma(k, -_LN2_HIGH, inside))
    z = r * r
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 9.99999999999999999910e-1)
    q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    return p, q, k


@inner
def exp(x):
    """Return e to the power x; 0 below -708 and infinity above 709."""
    p, q, k = _exp_fraction(x)
    value = (1.0 + 2.0 * (p / (q - p))) * power_of_two(k)
    value = select(x > 709.0, inf, select(x < -708.0, 0.0, value))
    return select(x == x, value, nan)


@inner
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


@inner
def tanh(x):
    """Return the hyperbolic tangent; of its three fractions the one that is needed is divided."""
    a = absolute(x)
    z = x * x
    p = (-9.64399179425052238628e-1 * z - 9.92877231001918586564e1) * z - 1.61468768441708447952e3
    q = ((z + 1.12811678491632931402e2) * z + 2.23548839060100448583e3) * z + 4.84406305325125486048e3
    half, whole, k = _exp_fraction(2.0 * a)  # exp(2 a) = 2^k (whole + half) / (whole - half)
    bottom = whole - half
    small = a < 0.625
    rest = select(small, z * p, 2.0 * bottom) / select(small, q, (whole + half) * power_of_two(k) + bottom)
    return select(small, x + x * rest, copysign(1.0 - rest, x))


@inner
def sign(x):
    """Return -1, 0 or 1."""
    return select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0 * x))


@inner
def maximum(a, b):
    """Return the larger of two lanes or numbers; NaN in ``a`` stays NaN."""
    return select(a < b, b, a)


@inner
def minimum(a, b):
    """Return the smaller of two lanes or numbers; NaN in ``a`` stays NaN."""
    return select(a > b, b, a)
