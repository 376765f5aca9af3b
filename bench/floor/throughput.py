"""Measure how long this processor takes for each kind of operation on all lanes where nothing waits for a result."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from bench.timing import quickest
from harness.engine.compile import load_source
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import seed_words, standard_normal

_OPERATIONS = {
    "add": "{a} + b",
    "multiply": "{a} * b",
    "multiply-add": "fma({a}, b, c)",
    "select": "select({a} < b, b, c)",
    "round": "floor({a} + b)",
    "divide": "b / {a}",
    "root": "sqrt({a})",
    "gather": "gather(rows, {a}, 0)",
    "draw": "next_words({a}, b)[1]",
    "normal pair": "normal_pair({a})[0] + normal_pair({a})[1]",
}
"""What becomes of ``{a}``, by kind."""

_BESIDE = {"round": "add", "normal pair": "add"}
"""An operation whose time is that of another as well, which is taken off."""

EXACT_NORMAL = "exact normal"
"""A number of NumPy's sequence for each lane, as noise is drawn; that these wait for each other is their definition."""

_REPEATS = 2000

_CHAINS = (4, 6, 8, 12)
"""Independent chains: enough to hide the latency, few enough for the registers; the quickest number counts."""


def throughput(rounds: int = 30) -> dict[str, float]:
    """Return nanoseconds per operation on all lanes by kind, on one core; a comparison is half of one with a selection.

    Args:
        rounds: Measurements of each, of which the quickest counts.
    """
    v, rows, out = np.full((24, LANES), 1.0), np.zeros((1, 1, LANES)), np.empty((24, LANES))
    work = {}
    for kind in _OPERATIONS:
        for chains in _CHAINS:
            run = load_source("throughput", _source(kind, chains)).run
            work[f"{kind}/{chains}"] = partial(run, v * (kind != "gather"), rows, out, _REPEATS)
    words = seed_words(0, np.arange(LANES)[:, None])
    work[EXACT_NORMAL] = partial(standard_normal, words, _REPEATS, 1)
    times = quickest(work, rounds, time.thread_time)
    best = {
        kind: min(1e9 * times[f"{kind}/{chains}"] / _REPEATS / chains for chains in _CHAINS) for kind in _OPERATIONS
    }
    for kind, other in _BESIDE.items():
        best[kind] = max(best[kind] - best[other], 0.0)
    best["select"] /= 2
    return best | {"compare": best["select"], EXACT_NORMAL: 1e9 * times[EXACT_NORMAL] / _REPEATS}


def _source(kind: str, chains: int) -> str:
    names = [f"a{k}" for k in range(chains)]
    lines = [
        f'"""The throughput of one operation ({kind})."""',
        "from numba import njit",
        "from harness.engine.simd.random import gather",
        "from harness.engine.simd.lanes import floor, fma, get, put, select, sqrt",
        "from harness.engine.simd.random import next_words, normal_pair",
        "",
        '@njit(cache=True, nogil=True, error_model="numpy")',
        "def run(v, rows, out, n):",
        f"    b, c = get(v, {max(_CHAINS)}), get(v, {max(_CHAINS) + 1})",
        *(f"    {a} = get(v, {k})" for k, a in enumerate(names)),
        "    for _ in range(n):",
        *(f"        {a} = {_OPERATIONS[kind].format(a=a)}" for a in names),
        *(f"    put({a}, out, {k})" for k, a in enumerate(names)),
    ]
    return "\n".join([*lines, ""])
