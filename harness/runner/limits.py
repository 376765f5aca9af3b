"""Whether states and signals are numbers within their limits, lane by lane."""

from __future__ import annotations

from harness.engine.kernel_names import NS, NX, get, select, splat

LARGEST = 1e150
"""Largest magnitude of a number that enters a score: squares of millions of them can be summed."""


def outside(x, limits):
    """Return 1 in the lanes whose state is not a number or beyond the range where the equations hold."""
    bad = splat(0.0)
    for i in range(NX):
        magnitude = get(x, i)
        inside = (magnitude <= limits[i]) & (magnitude >= -limits[i])  # false for NaN
        bad = select(inside, bad, 1.0)
    return bad


def undefined(s, rows):
    """Return 1 in the lanes in which a signal is no number that can be scored: not one, infinite or absurdly large.

    Args:
        s: Signals ``(ns, LANES)``.
        rows: Negative for those that do not count ``(ns,)``.
    """
    bad = splat(0.0)
    for i in range(NS):
        if rows[i] >= 0:
            value = get(s, i)
            bad = select((value <= LARGEST) & (value >= -LARGEST), bad, 1.0)
    return bad


def beyond(s, largest):
    """Return 1 in the lanes in which a signal is not a number of the magnitude that it may have.

    Args:
        s: Signals ``(ns, LANES)``.
        largest: Largest magnitude of each; zero for those that may be anything ``(ns,)``.
    """
    bad = splat(0.0)
    for i in range(NS):
        if largest[i] > 0.0:
            value = get(s, i)
            bad = select((value <= largest[i]) & (value >= -largest[i]), bad, 1.0)  # false for NaN
    return bad


def surprised(info):
    """Return 1 in the lanes in which NIS or likelihood of a measurement is no number that can be scored."""
    nis, likelihood = get(info.nis, 0), get(info.log_likelihood, 0)
    scorable = (nis <= LARGEST) & (likelihood <= LARGEST) & (likelihood >= -LARGEST)
    return select((get(info.seen, 0) > 0.0) & ~scorable, 1.0, 0.0)
