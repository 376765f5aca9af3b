"""Timing on a shared machine: many short measurements, taken in turn, of which the quickest counts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping


def quickest(work: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the shortest time of each piece of work in s; the pieces alternate, so that a busy moment hits all."""
    best = dict.fromkeys(work, float("inf"))
    for run in work.values():
        run()  # compile, fill caches
    for _ in range(rounds):
        for name, run in work.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    return best
