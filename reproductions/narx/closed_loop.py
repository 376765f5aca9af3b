"""The free-running network: its error, and the gradient of it by backpropagation through time.

Windows of the drives run side by side as lanes. A window starts from true outputs and then feeds its own back; a
window as long as a drive starts like the estimator does, from the outputs at standstill.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.engine.simd.functions import tanh
from harness.engine.simd.lanes import LANES, get, put, splat


class Group(NamedTuple):
    """Windows side by side: inputs ``(samples, inputs, LANES)``, outputs the same, weight of each ``(1, LANES)``."""

    inputs: Floats
    outputs: Floats
    weight: Floats


@njit(cache=True, nogil=True, error_model="numpy")
def _regressor(u, y, k, n_id, n_fd, x):
    """Collect the delayed inputs and outputs."""
    n_in, n_out, at = u.shape[1], y.shape[1], 0
    for m in range(1, n_id + 1):
        for i in range(n_in):
            put(get(u, k - m, i), x, at)
            at += 1
    for m in range(1, n_fd + 1):
        for o in range(n_out):
            put(get(y, k - m, o), x, at)
            at += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _run(p, sizes, n_id, n_fd, u, t, y, hidden, x):
    """Run free; writes the outputs ``y`` and the activations of the hidden layers of every sample."""
    d, last = max(n_id, n_fd), len(sizes) - 2
    for k in range(d):
        for o in range(t.shape[1]):
            put(get(t, k, o), y, k, o)
    for k in range(d, len(u)):
        _regressor(u, y, k, n_id, n_fd, x)
        w, below = 0, 0
        for layer in range(last + 1):
            n_from, n_to = sizes[layer], sizes[layer + 1]
            for j in range(n_to):
                s = splat(p[w + n_from])
                for i in range(n_from):
                    s = s + p[w + i] * (get(x, i) if layer == 0 else get(hidden, k, below + i))
                w += n_from + 1
                if layer < last:
                    put(tanh(s), hidden, k, (below + n_from if layer > 0 else 0) + j)
                else:
                    put(s, y, k, j)
            if layer > 0:
                below += n_from


@njit(cache=True, nogil=True, error_model="numpy")
def _back(p, sizes, n_id, n_fd, u, t, y, hidden, weight, x, dy, da, db, gradient):
    """Go back through time; adds to the gradient ``(P, LANES)`` of the weighted sum of squared errors."""
    d, last, n_in, n_out = max(n_id, n_fd), len(sizes) - 2, u.shape[1], t.shape[1]
    for k in range(len(u) - 1, d - 1, -1):
        _regressor(u, y, k, n_id, n_fd, x)
        for o in range(n_out):
            put(get(dy, k, o) + 2.0 * get(weight, 0) * (get(y, k, o) - get(t, k, o)), da, o)
        w, top = len(p), hidden.shape[1]
        for layer in range(last, -1, -1):
            n_from, n_to = sizes[layer], sizes[layer + 1]
            w -= n_to * (n_from + 1)
            if layer > 0:
                top -= n_from
            for i in range(n_from):
                put(splat(0.0), db, i)
            for j in range(n_to):
                delta, row = get(da, j), w + j * (n_from + 1)
                for i in range(n_from):
                    a = get(x, i) if layer == 0 else get(hidden, k, top + i)
                    put(get(gradient, row + i) + delta * a, gradient, row + i)
                    put(get(db, i) + p[row + i] * delta, db, i)
                put(get(gradient, row + n_from) + delta, gradient, row + n_from)
            for i in range(n_from):
                if layer > 0:
                    a = get(hidden, k, top + i)
                    put(get(db, i) * (1.0 - a * a), da, i)
        at = n_in * n_id
        for m in range(1, n_fd + 1):
            for o in range(n_out):
                put(get(dy, k - m, o) + get(db, at), dy, k - m, o)
                at += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _squares(t, y, d, weight, total):
    """Sum the weighted squared errors of each output, ``(outputs, LANES)``."""
    for o in range(t.shape[1]):
        s = splat(0.0)
        for k in range(d, len(t)):
            e = get(y, k, o) - get(t, k, o)
            s = s + e * e
        put(get(weight, 0) * s, total, o)


class ClosedLoop:
    """The free-running problem on windows of some drives.

    Args:
        series: Scaled ``(inputs, outputs)`` of each drive, ``(samples, ...)``.
        sizes: Lengths of regressor, hidden layers and output.
        input_delays: Past samples of the inputs.
        output_delays: Past samples of the outputs.
        window: Samples a window runs free; ``None`` for whole drives from standstill.
        standstill: Scaled outputs at standstill ``(outputs,)``, with which whole drives start.
        threads: How many groups of windows run at once; the result does not depend on it.

    Raises:
        UserError: If a drive is too short for the delays or the window.
    """

    def __init__(
        self,
        series: Sequence[tuple[Floats, Floats]],
        sizes: Sequence[int],
        input_delays: int,
        output_delays: int,
        window: int | None = None,
        standstill: Floats | None = None,
        threads: int = 2,
    ) -> None:
        self.sizes = np.array(sizes, dtype=np.int64)
        self._delays = (input_delays, output_delays)
        self._threads = threads
        d = max(input_delays, output_delays)
        cut: list[tuple[Floats, Floats]] = []
        for u, t in series:
            if len(u) <= d + (window or 0):
                raise UserError(f"a drive of {len(u)} samples is too short for delays of {d} and windows of {window}")
            if window is None:
                begun = t.copy()
                begun[:d] = t[:d] if standstill is None else standstill
                cut.append((u, begun))
            else:
                starts = range(0, len(u) - d - window + 1, window)
                cut += [(u[s : s + d + window], t[s : s + d + window]) for s in starts]
        self.count = sum(len(u) - d for u, _ in cut)
        self.groups = [_group(cut[k : k + LANES]) for k in range(0, len(cut), LANES)]

    def errors(self, p: Floats) -> Floats:
        """Return the mean squared error of each output, ``(outputs,)``, scaled."""
        parts = self._map(lambda g: self._one(g, p, back=False)[0])
        return np.sum(parts, axis=0) / self.count

    def value_and_gradient(self, p: Floats) -> tuple[float, Floats]:
        """Return the mean squared error summed over the outputs, and its gradient ``(P,)``."""
        parts = self._map(lambda g: self._one(g, p, back=True))
        value = float(np.sum([e for e, _ in parts])) / self.count
        return value, np.sum([g for _, g in parts], axis=0) / self.count

    def _map(self, task):
        if self._threads < 2 or len(self.groups) < 2:
            return [task(g) for g in self.groups]
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(task, self.groups))

    def _one(self, group: Group, p: Floats, back: bool) -> tuple[Floats, Floats]:
        u, t, weight = group
        n_id, n_fd = self._delays
        hidden = np.empty((len(u), max(1, int(self.sizes[1:-1].sum())), LANES))
        y, x = np.empty_like(t), np.empty((int(self.sizes[0]), LANES))
        total = np.empty((t.shape[1], LANES))
        _run(p, self.sizes, n_id, n_fd, u, t, y, hidden, x)
        _squares(t, y, max(n_id, n_fd), weight, total)
        if not back:
            return total.sum(axis=1), np.empty(0)
        gradient, dy = np.zeros((len(p), LANES)), np.zeros_like(t)
        da, db = (np.empty((int(self.sizes.max()), LANES)) for _ in range(2))
        _back(p, self.sizes, n_id, n_fd, u, t, y, hidden, weight, x, dy, da, db, gradient)
        return total.sum(axis=1), gradient.sum(axis=1)


def _group(windows: Sequence[tuple[Floats, Floats]]) -> Group:
    """Put windows of one length side by side; spare lanes repeat the last one with no weight."""
    lengths = {len(u) for u, _ in windows}
    if len(lengths) > 1:
        raise UserError(f"drives to run side by side must have one length, these have {sorted(lengths)} samples")
    filled = [*windows, *[windows[-1]] * (LANES - len(windows))]
    weight = np.zeros((1, LANES))
    weight[0, : len(windows)] = 1.0
    stack = [np.ascontiguousarray(np.stack([w[i] for w in filled], axis=-1)) for i in (0, 1)]
    return Group(stack[0], stack[1], weight)
