"""Cases at random in the shares by which traces are judged: nothing missing, one effect, two, an unlisted one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bench.attribution.run import Listed

SHARES = {"none": 30, "parameters": 30, "effect": 55, "pair": 12, "unlisted": 10}
"""Draws of each kind in a block: nothing missing, only parameters wrong, and so on."""

REAL_SHARES = {"baseline-none": 40, "baseline-changed": 60, "alone-changed": 60}
"""The same of the realistic plants: with and without drives of days before, nothing or one thing changed."""

BLOCK = sum(SHARES.values())


def drawn(
    listed: Sequence[Listed], first: int, count: int, shares: Mapping[str, int] = SHARES
) -> list[tuple[str, int]]:
    """Return name and number of the draw for some draws; a draw depends on its number alone.

    The shares hold in each block of as many draws as they add up to, in any order. The vehicle of a draw is one or
    the other, then each case of its kind is as probable.

    Args:
        listed: The cases to choose from.
        first: Number of the first draw.
        count: How many.
        shares: Draws of each kind in a block.
    """
    vehicles = sorted({case.name.split("-")[0] for case in listed})
    draws = []
    for number in range(first, first + count):
        block, place = divmod(number, sum(shares.values()))
        kinds = np.random.default_rng([block]).permutation(np.repeat(list(shares), list(shares.values())))
        rng = np.random.default_rng([block, place])
        vehicle = vehicles[rng.integers(len(vehicles))]
        of_kind = [case for case in listed if case.kind == kinds[place] and case.first_draw <= number]
        cases = [case.name for case in of_kind if case.name.startswith(f"{vehicle}-")]
        draws.append((cases[rng.integers(len(cases))], number))
    return draws
