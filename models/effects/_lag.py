"""Lags and delays that vanish exactly at zero.

``1 / (1 + T s)`` turns infinitely fast as ``T`` goes to zero: no step size would do, and a score test at zero has
nothing to differentiate. Both forms below have poles that stop at a fixed speed, and zeros that cancel them exactly at
zero. The derivative there is that of the lag or delay, seen through the fixed pole.
"""

from __future__ import annotations

import sympy as sp

FASTEST_LAG = 0.01
"""s; a lag's pole is never faster, so that Euler's step of 10 ms follows it."""

FASTEST_DELAY = 0.05
"""s; likewise for the pair of poles of a delay."""

CONSTANTS: dict[str, str] = {"FASTEST_LAG": "s", "FASTEST_DELAY": "s"}


def lag(value: sp.Expr, state: sp.Expr, time_constant: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Return a quantity behind a first-order lag, and the derivative of the lag's state.

    The transfer function is ``(1 + (B - T) s) / (1 + B s)`` with ``B = sqrt(T^2 + FASTEST_LAG^2)``: 1 at ``T = 0``, the
    lag itself for ``T`` well above ``FASTEST_LAG``, and right to first order in the frequency always.
    """
    behind = sp.sqrt(time_constant**2 + FASTEST_LAG**2)
    rate = (value - state) / behind
    return state + (behind - time_constant) * rate, rate


def delay(value: sp.Expr, first: sp.Expr, second: sp.Expr, time: sp.Expr) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Return a delayed quantity and the derivatives of the two states of its approximation of second order.

    The denominator is that of Pade's approximant of ``exp(-T s)``, ``1 + B s / 2 + (B s)^2 / 12``, with ``B =
    sqrt(T^2 + FASTEST_DELAY^2)``; the numerator is its product with ``exp(-T s)`` up to ``s^2``. So it is 1 at ``T
    = 0``, Pade's approximant for ``T`` well above ``FASTEST_DELAY``, and right to second order in the frequency
    always.
    """
    span = sp.sqrt(time**2 + FASTEST_DELAY**2)
    share = time / span
    bend = 12 * (value - first) - 6 * second
    delayed = first + (sp.Rational(1, 2) - share) * second + (sp.Rational(1, 12) - share / 2 + share**2 / 2) * bend
    return delayed, second / span, bend / span
