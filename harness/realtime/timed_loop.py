"""The loop over time of an estimator whose steps are timed, pasted behind its kernels.

It is no recorder of ``harness.runner.filter_loop``: that makes its arrays in the call, so that each step of a cycle
would find them in the caches, and a step's stores could be moved past the reading of the clock.
"""

from __future__ import annotations

from harness.engine.clock import nanoseconds
from harness.engine.simd.memory import borrowed
from harness.runner.filter_loop import advance


def timed_steps(before, u, y, belief, work, after, info, ticks):
    """Take samples one after the other, each between two readings of the clock.

    All arrays come from outside: the compiler must take it that the call of the clock sees them, so it can move
    neither a load nor a store of a step past it.

    Args:
        before: State at the first sample; with an even number of steps the last one is written here.
        u: Inputs ``(steps + 1, nu, LANES)``.
        y: Measurements ``(steps + 1, ny, LANES)``.
        belief: ``harness.engine.kernel_names.Belief``.
        work: From ``workspace``.
        after: With an odd number of steps the last state is written here.
        info: Written.
        ticks: Time before and after each step in ns, written ``(steps, 2)``.
    """
    before, u, y, belief, work, after, info = borrowed((before, u, y, belief, work, after, info))
    for k in range(ticks.shape[0]):
        ticks[k, 0] = nanoseconds()
        advance(before, u[k], u[k + 1], y[k + 1], belief, work, after, info)
        ticks[k, 1] = nanoseconds()
        before, after = after, before


def timed_nothing(ticks):
    """Read the clock twice, as around a step."""
    for k in range(ticks.shape[0]):
        ticks[k, 0] = nanoseconds()
        ticks[k, 1] = nanoseconds()
