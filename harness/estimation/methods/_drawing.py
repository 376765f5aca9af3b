"""Random states of the filters that draw: standard normal numbers and the first members of a cloud."""

from __future__ import annotations

from harness.engine.kernel_names import NX, get, next_words, normal_pair, put


def normals(z, spare, s0, s1):
    """Write independent standard normal numbers, one for each state.

    They come in pairs. With an odd number of states every other call finds one left over, in the last row of ``z``.

    Args:
        z: Written, ``nx`` rows; ``(nx + 1, LANES)``.
        spare: Whether there is one left over by the call before.
        s0: First word of the generator.
        s1: Second word.
    """
    begin = 0
    if NX % 2 == 1 and spare:
        put(get(z, NX), z, 0)
        begin = 1
    for i in range(begin, NX, 2):
        word, s0, s1 = next_words(s0, s1)
        first, second = normal_pair(word)
        put(first, z, i)
        put(second, z, i + 1)
    return s0, s1


def draw_first(mean, factor, drawn, x, s0, s1):
    """Draw one particle from the normal distribution that the run begins with."""
    s0, s1 = normals(drawn, False, s0, s1)
    for i in range(NX):
        value = get(mean, i)
        for k in range(i + 1):
            value = value + get(factor, i, k) * get(drawn, k)
        put(value, x, i)
    return s0, s1
