"""Timing on a shared machine: many short measurements, taken in turn, of which the quickest counts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping


def quickest(
    work: Mapping[str, Callable[[], object]], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, float]:
    """Return the shortest time of each piece of work in s; the pieces alternate, so that a busy moment hits all.

    Args:
        work: By name.
        rounds: Measurements of each.
        clock: In s. ``time.thread_time``, which stands still while others have the processor, measures the work of one
            thread on a busy machine; several threads need the clock on the wall.
    """
    best = dict.fromkeys(work, float("inf"))
    for run in work.values():
        run()  # compile, fill caches
    for _ in range(rounds):
        for name, run in work.items():
            start = clock()
            run()
            best[name] = min(best[name], clock() - start)
    return best
