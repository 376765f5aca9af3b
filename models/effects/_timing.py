"""A change that happens at a time: smooth, so that it does not matter where samples and stages of integrators fall."""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.expressions import larger, smaller


def progress(time: sp.Expr, begin: sp.Expr, duration: sp.Expr) -> sp.Expr:
    """Return how much of a change is done, from 0 at ``begin`` to 1 after ``duration``; its rate is a raised cosine."""
    x = larger(0, smaller(1, (time - begin) / duration))
    return x - sp.sin(2 * sp.pi * x) / (2 * sp.pi)
