"""Score (Lagrange-multiplier) test of everything a model may lack, at a fit without it.

One pass gives the derivatives ``X`` of the whitened innovations ``r`` to the amplitudes of a hypothesis, its shapes and
moments at one value of a grid. With what the fit moves projected out (``X`` less its regression on the fit's own
derivatives ``N``), ``b = -X'r`` and ``G = X'X`` promise the gain ``max_a b'a - a'G a / 2`` in log-likelihood within the
bounds of the amplitudes, and ``G^-1`` is the smallest covariance with which these drives could show them (Rao 1948;
Engle 1984).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from harness.loop.fit import Fitted, Fitting
from harness.loop.hypotheses import ALL_PARAMETERS, PRIOR, Hypothesis

Floats = NDArray[np.float64]
Columns = NDArray[np.float32]
"""Many responses at once; they only choose where to look closer."""

SPACING = 2.0
"""s between the moments at which a change is tried."""

_BEAM = 60
"""Choices of moments kept while drives are joined one after the other."""


@dataclass(frozen=True)
class Score:
    """What a hypothesis promises at a fit without it.

    Attributes:
        hypothesis: What was tried.
        gain: Promised gain in log-likelihood.
        amplitudes: With these values.
        error: Standard error that the drives would leave of each amplitude, infinite if they say nothing of it.
        freedom: Numbers that it adds to the fit; under a prior, as many as the drives know better than the prior.
        shapes: Values of the grid.
        moments: By drive and moment ``(drives, moments)``, in s.
        response: Of the whitened innovations, projected, to the amplitudes: one array per drive ``(samples, ny)``.
    """

    hypothesis: Hypothesis
    gain: float
    amplitudes: Floats
    error: Floats
    freedom: float
    shapes: Floats
    moments: Floats
    response: tuple[Floats, ...]

    @property
    def excited(self) -> bool:
        """Whether the drives could show it at all."""
        return bool(np.isfinite(self.error).any())


@dataclass(frozen=True)
class _Choice:
    """One choice of moments for some drives: sums of ``b`` and ``G`` over them.

    ``moments`` are indices into the grid of each drive, of the beginning and the end; -1 for never.
    """

    b: Floats
    G: Floats
    moments: tuple[tuple[int, int], ...]


class ScoreTest:
    """The test at one fit.

    Args:
        fitting: The recordings.
        fitted: The fit; what it moved is projected out.
    """

    def __init__(self, fitting: Fitting, fitted: Fitted) -> None:
        self.fitting, self.point = fitting, fitted.point
        self.whole, self.drives = fitting.whole, fitting.drives
        self.kept = fitting.passes(fitted.point)
        shape = len(self.whole.model.outputs)
        self.residual = [np.nan_to_num(k.whitened).reshape(-1) for k in self.kept]
        numbers = range(len(self.drives))
        self.moved = self.whole.share(
            lambda i: _flat(fitting.columns(fitted.coordinates, fitted.point, i, self.kept[i])),
            numbers,
        )
        self._outputs = shape
        self._cached: dict[tuple[int, str], Columns] = {}
        information = total([N.T @ N for N in self.moved])
        self._pull = total([N.T @ r for N, r in zip(self.moved, self.residual, strict=True)])
        self._inverse = np.linalg.pinv(information, rcond=1e-10, hermitian=True)

    def of(self, tried: Sequence[Hypothesis]) -> list[Score]:
        """Return the scores of hypotheses, in their order."""
        plain = [h for h in tried if not h.moments]
        columns = self._plain_columns(plain)
        found = {id(h): self._plain(h, columns) for h in plain}
        found |= {id(h): self._moments(h) for h in tried if h.moments}
        return [found[id(h)] for h in tried]

    def _sensitivities(
        self, drive: int, values: Floats, names: Sequence[str], starts: Sequence[int] | None = None
    ) -> Floats:
        """Return columns ``(samples * ny, n)`` for a parameter each, at values of their own ``(np, n)``."""
        directions = np.zeros_like(values)
        directions[[self.whole.row(n) for n in names], range(len(names))] = 1.0
        found = self.whole.sensitivities(self.drives[drive], values, directions, self.kept[drive], starts)
        return _flat(found)

    def _plain_columns(self, plain: Sequence[Hypothesis]) -> list[dict[tuple[str, tuple[float, ...]], Floats]]:
        """Return the columns of all amplitudes at all shapes, once each, by drive."""
        wanted: dict[tuple[str, tuple[float, ...]], tuple[str, ...]] = {}
        for h in plain:
            for shapes in self._grid(h):
                wanted |= {(a, shapes): h.shapes for a in h.amplitudes}

        def of_drive(i: int) -> dict[tuple[str, tuple[float, ...]], Floats]:
            values = np.repeat(self.point.values[:, [i]], len(wanted), axis=1)
            for j, ((_, shapes), names) in enumerate(wanted.items()):
                values[[self.whole.row(n) for n in names], j] = shapes
            columns = self._sensitivities(i, values, [a for a, _ in wanted])
            return {key: columns[:, j] for j, key in enumerate(wanted)}

        return self.whole.share(of_drive, range(len(self.drives)))

    def _grid(self, h: Hypothesis) -> list[tuple[float, ...]]:
        """Return the shapes at which a hypothesis is tried; a parameter in force already keeps its value."""
        parameters = [self.whole.model.parameters[self.whole.row(n)] for n in h.shapes]
        return list(
            itertools.product(*(p.grid or (float(self.point.values[self.whole.row(p.name), 0]),) for p in parameters))
        )

    def _plain(self, h: Hypothesis, columns: Sequence[dict[tuple[str, tuple[float, ...]], Floats]]) -> Score:
        tried = []
        for shapes in self._grid(h):
            X = [np.column_stack([c[a, shapes] for a in h.amplitudes]) for c in columns]
            tried.append(self._judged(h, X, np.array(shapes), np.zeros((len(self.drives), 0))))
        return max(tried, key=lambda s: s.gain)

    def _judged(self, h: Hypothesis, X: Sequence[NDArray[np.floating]], shapes: Floats, moments: Floats) -> Score:
        cross = total([N.T @ x for N, x in zip(self.moved, X, strict=True)])
        weights = self._inverse @ cross
        square = total([x.T @ x for x in X])
        G = square - cross.T @ weights
        b = weights.T @ self._pull - total([x.T @ r for x, r in zip(X, self.residual, strict=True)])
        freedom = float(h.count(len(self.drives)))
        if h.name == ALL_PARAMETERS:  # stated values count as measured, once, within the prior
            prior = np.diag((PRIOR * self.point.values[[self.whole.row(n) for n in h.amplitudes], 0]) ** -2.0)
            freedom, G = float(np.trace(np.linalg.solve(G + prior, G))), G + prior
        raw = np.diagonal(square)
        # A column whose power the fit's own columns explain but for 1e-9 is not there.
        seen = np.diagonal(G) > np.maximum(1e-9 * raw, 1e-300)
        a, gain = best_amplitudes(b, G, seen, *self._room(h))
        error = np.full(len(b), np.inf)
        if seen.any():
            inverse = np.linalg.pinv(scaled(G[np.ix_(seen, seen)])[0], rcond=1e-9, hermitian=True)
            error[seen] = np.sqrt(np.diagonal(inverse) / np.diagonal(G)[seen])
        promised = weights @ a
        response = tuple((x @ a - N @ promised).reshape(-1, self._outputs) for x, N in zip(X, self.moved, strict=True))
        start = np.array([self.point.values[self.whole.row(n), 0] for n in h.amplitudes])
        return Score(h, gain, start + a, error, freedom, shapes, moments, response)

    def _room(self, h: Hypothesis) -> tuple[Floats, Floats]:
        """Return how far each amplitude may move down and up."""
        rows = [self.whole.row(n) for n in h.amplitudes]
        at = self.point.values[rows, 0]
        parameters = [self.whole.model.parameters[r] for r in rows]
        return np.array([p.lower for p in parameters]) - at, np.array([p.upper for p in parameters]) - at

    def _moments(self, h: Hypothesis) -> Score:
        """Score a change at a time of its own in every drive, at the best of a grid of times.

        A second moment ends what the first one began, so its response is that of the beginning, taken back.
        """
        shapes = self._grid(h)[0]
        grids = [self._times(i) for i in range(len(self.drives))]
        steps = self.whole.share(lambda i: self._steps(h, shapes, i, grids[i]), range(len(self.drives)))
        chosen = self._join([self._choices(h, i, steps[i]) for i in range(len(self.drives))])
        X, moments = [], np.zeros((len(self.drives), len(h.moments)))
        for i, (first, second) in enumerate(chosen):
            never = float(self.drives[i].time[-1])
            moments[i] = [grids[i][k] if k >= 0 else never for k in (first, second)][: len(h.moments)]
            x = steps[i][:, :, first] if first >= 0 else np.zeros_like(steps[i][:, :, 0])
            X.append(x - steps[i][:, :, second] if second >= 0 else x)
        return self._judged(h, X, np.array(shapes), moments)

    def moments_of(self, h: Hypothesis) -> Floats:
        """Return the likeliest moments of a hypothesis whose amplitudes are known ``(drives, moments)``.

        The fit is that without it; its amplitudes are those of the point, which mean nothing as long as its moments
        are never.
        """
        a = self.point.values[[self.whole.row(n) for n in h.amplitudes], 0]
        found, shapes = np.zeros((len(self.drives), len(h.moments))), self._grid(h)[0]
        for i, drive in enumerate(self.drives):
            grid = self._times(i)
            choices = self._choices(h, i, self._steps(h, shapes, i, grid))
            best = max(choices, key=lambda c: float(c.b @ a - 0.5 * a @ c.G @ a)).moments[0]
            found[i] = [grid[k] if k >= 0 else drive.time[-1] for k in best][: len(h.moments)]
        return found

    def _times(self, drive: int) -> Floats:
        return np.arange(SPACING, self.drives[drive].time[-1] - SPACING, SPACING)

    def _steps(self, h: Hypothesis, shapes: tuple[float, ...], drive: int, grid: Floats) -> Columns:
        """Return responses to changes at the times of a grid ``(samples * ny, amplitudes, times)``."""
        parts = []
        for a in h.amplitudes:
            if (drive, a) in self._cached:
                parts.append(self._cached[drive, a])
                continue
            values = np.repeat(self.point.values[:, [drive]], len(grid), axis=1)
            values[[self.whole.row(n) for n in h.shapes]] = np.array(shapes)[:, None]
            for m in h.moments:
                values[self.whole.row(m)] = self.whole.model.parameters[self.whole.row(m)].upper
            values[self.whole.row(h.moments[0])] = grid
            starts = np.searchsorted(self.drives[drive].time, grid - 0.1).tolist()
            found = self._sensitivities(drive, values, [a] * len(grid), starts).astype(np.float32)
            self._cached[drive, a] = found
            parts.append(found)
        return np.stack(parts, axis=1)

    def _choices(self, h: Hypothesis, drive: int, steps: Columns) -> list[_Choice]:
        """Return the best choices of moments in one drive by themselves, and that of no change there."""
        d, n = steps.shape[1], steps.shape[2]
        flat = steps.reshape(len(steps), -1)
        N = self.moved[drive].astype(np.float32)
        cross = (N.T @ flat).astype(float)
        G = (flat.T @ flat).astype(float) - cross.T @ self._inverse @ cross
        b = -(flat.T @ self.residual[drive].astype(np.float32)).astype(float)
        G, b = G.reshape(d, n, d, n), b.reshape(d, n)
        pairs = [(k, -1) for k in range(n)]
        if len(h.moments) > 1:
            pairs += [(k, m) for k in range(n) for m in range(k + 1, n)]
        choices = [_Choice(np.zeros(d), np.zeros((d, d)), ((-1, -1),))]
        for k, m in pairs:
            bk, Gk = b[:, k], G[:, k, :, k]
            if m >= 0:
                bk = bk - b[:, m]
                Gk = Gk - G[:, k, :, m] - G[:, m, :, k] + G[:, m, :, m]
            choices.append(_Choice(bk, Gk, ((k, m),)))
        return choices

    def _join(self, by_drive: Sequence[list[_Choice]]) -> tuple[tuple[int, int], ...]:
        """Choose moments for all drives with amplitudes in common, the best few of each drive at a time."""
        beam = _most(by_drive[0])
        for choices in by_drive[1:]:
            ranked = _most(choices)
            beam = _most([_Choice(c.b + e.b, c.G + e.G, c.moments + e.moments) for c in beam for e in ranked])
        return beam[0].moments


def _most(choices: list[_Choice]) -> list[_Choice]:
    """Return the choices of largest gain, and the first of them (no change) in any case."""
    order = np.argsort(-_gains(choices))[:_BEAM]
    return [choices[i] for i in dict.fromkeys([*order.tolist(), 0])]


def _gains(choices: Sequence[_Choice]) -> Floats:
    """Return the gains without bounds ``(n,)``."""
    b, G = np.array([c.b for c in choices]), np.array([c.G for c in choices])
    ridge = 1e-9 * np.trace(G, axis1=1, axis2=2)[:, None, None] * np.eye(b.shape[1]) + 1e-300 * np.eye(b.shape[1])
    return 0.5 * np.einsum("ni,ni->n", b, np.linalg.solve(G + ridge, b[:, :, None])[:, :, 0])


def _flat(columns: Floats) -> Floats:
    """Return columns ``(samples, ny, n)`` as ``(samples * ny, n)``."""
    samples, ny, n = columns.shape
    return columns.reshape(samples * ny, n)


def total(parts: Sequence[Floats]) -> Floats:
    """Return the sum over drives."""
    return np.sum(parts, axis=0)


def scaled(G: Floats) -> tuple[Floats, Floats]:
    """Return a matrix scaled to a unit diagonal, and the scale."""
    s = np.sqrt(np.diagonal(G))
    return G / np.outer(s, s), s


def best_amplitudes(b: Floats, G: Floats, seen: NDArray[np.bool_], down: Floats, up: Floats) -> tuple[Floats, float]:
    """Return the amplitudes within bounds that promise most, and the gain they promise.

    Args:
        b: ``(n,)``.
        G: ``(n, n)``.
        seen: Amplitudes that the drives show at all ``(n,)``; the others stay.
        down: How far each may fall, not positive ``(n,)``.
        up: How far each may rise, not negative ``(n,)``.
    """
    a = np.zeros(len(b))
    if not seen.any():
        return a, 0.0
    unit, s = scaled(G[np.ix_(seen, seen)])
    values, vectors = np.linalg.eigh(unit)
    root = np.sqrt(np.maximum(values, 1e-10))[:, None] * vectors.T
    target = (vectors.T @ (b[seen] / s)) / np.sqrt(np.maximum(values, 1e-10))
    low, high = down[seen] * s, up[seen] * s
    found = optimize.lsq_linear(root, target, (low, np.maximum(high, low + 1e-12)), method="bvls").x
    a[seen] = found / s
    return a, float(b @ a - 0.5 * a @ G @ a)


def cosine(one: Score, other: Score) -> float:
    """Return the cosine between the responses that two scores promise; 1 if the drives cannot tell them apart."""
    inner = sum(float(np.vdot(x, y)) for x, y in zip(one.response, other.response, strict=True))
    squares = [sum(float(np.vdot(x, x)) for x in s.response) for s in (one, other)]
    return inner / float(np.sqrt(squares[0] * squares[1])) if min(squares) > 0 else 0.0
