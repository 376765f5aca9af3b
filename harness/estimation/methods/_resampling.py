"""Draw the ancestors of particles: systematic, stratified, multinomial and residual resampling."""

from __future__ import annotations

from harness.engine.kernel_names import LANES, get, log, next_words, put, select, splat, uniform

SCHEMES = ("systematic", "stratified", "multinomial", "residual")
"""Kernels know a scheme by its place here."""


def ordered_points(scheme, points, s0, s1):
    """Write N increasing points in (0, 1) at which the cumulated weights are read off, by scheme.

    Systematic: one random offset for all of ``(k + u) / N``; stratified: an offset for each; multinomial: the order
    statistics of N uniform numbers, from exponential gaps, which is the exhaustive search without its N^2.
    """
    count = points.shape[0]
    word, s0, s1 = next_words(s0, s1)
    u = uniform(word)
    total = splat(0.0)
    for k in range(count):
        if scheme <= 1:
            put((k + u) * (1.0 / count), points, k)
        else:
            total = total - log(u)
            put(total, points, k)
        if scheme > 0:
            word, s0, s1 = next_words(s0, s1)
            u = uniform(word)
    if scheme > 1:
        inverse = 1.0 / (total - log(u))
        for k in range(count):
            put(get(points, k) * inverse, points, k)
    return s0, s1


def find_ancestors(weights, points, ancestors, lane, total, residual):
    """Write from which particle each redrawn one of a lane descends.

    With ``residual`` every particle first has ``floor(N w)`` children, and the points share out the rest.
    """
    count = weights.shape[0]
    share = count / total
    given, stretch = 0, 1.0 * count
    if residual:
        for n in range(count):
            for _ in range(int(share * weights[n, lane])):
                if given < count:
                    ancestors[given, lane] = n
                    given += 1
        # the first m of N ordered uniform numbers, over the next one, are m ordered uniform numbers
        if 0 < given < count:
            stretch = (count - given) / points[count - given, lane]
    n, cumulated = -1, 0.0
    for k in range(count - given):
        at = points[k, lane] * stretch
        while cumulated < at and n < count - 1:
            n += 1
            expected = share * weights[n, lane]
            cumulated += expected - int(expected) if residual else expected
        ancestors[given + k, lane] = n


def redraw(scheme, redrawn, weights, total, points, ancestors, s0, s1):
    """Choose the ancestors of all particles, each its own in lanes that are not redrawn.

    Args:
        scheme: Place in ``SCHEMES``.
        redrawn: 1 for lanes to redraw, else 0 ``(1, LANES)``.
        weights: ``(N, LANES)``.
        total: Sum of the weights ``(1, LANES)``.
        points: Scratch ``(N, LANES)``.
        ancestors: Numbers of the particles, written ``(N, LANES)``.
        s0: First word of the generator.
        s1: Second word.

    Returns:
        The words of the generator; they do not move on in lanes that are not redrawn.
    """
    t0, t1 = ordered_points(scheme, points, s0, s1)
    for lane in range(LANES):
        if redrawn[0, lane] > 0.0:
            find_ancestors(weights, points, ancestors, lane, total[0, lane], scheme == 3)
        else:
            for n in range(weights.shape[0]):
                ancestors[n, lane] = n
    chosen = get(redrawn, 0) > 0.0
    return select(chosen, t0, s0), select(chosen, t1, s1)
