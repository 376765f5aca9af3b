"""Score (Lagrange-multiplier) test of everything a model may lack, at a fit without it.

One pass gives the derivatives ``X`` of the whitened innovations ``r`` to the amplitudes of a hypothesis, its shapes and
change times at one value of a grid. With what the fit moves projected out (``X`` less its regression on the fit's own
derivatives ``N``), ``b = -X'r`` and ``G = X'X`` predict the gain ``max_a b'a - a'G a / 2`` in log-likelihood within the
bounds of the amplitudes, and ``G^-1`` is the smallest covariance with which these drives could show them (Rao 1948;
Engle 1984).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from harness.common.arrays import Floats
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint, in_rows
from harness.diagnosis.innovations.innovation_model import ModelTangents
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.selection.change_times import ChangeResponse, Choices, Columns, Onsets, choices, join
from harness.identification.uncertainty import covariance_of

_ROUNDED = 1e-4
"""Share of the power of responses at single precision that may be left of them by rounding."""

SPACING = 2.0
"""s between the times at which a change is tried."""


@dataclass(frozen=True)
class Score:
    """The score of a hypothesis at a fit without it.

    Attributes:
        hypothesis: What was tried.
        gain: Predicted gain in log-likelihood.
        amplitudes: With these values.
        error: Standard error that the drives would leave of each amplitude, infinite if they do not determine it.
        freedom: Numbers that it adds to the fit; under a prior, as many as the drives know better than the prior.
        shapes: Values of the grid.
        change_times: By drive and parameter ``(drives, change_times)``, in s.
        response: Of the whitened innovations, projected, to the amplitudes: one array per drive ``(samples, ny)``; of
            all that is tried at once in an orthonormal basis of theirs, because samples would take gigabytes.
        excited: Whether the drives could show it at all.
        steps: By how much the amplitudes differ from the values of the fit; none where no response shows them.
    """

    hypothesis: Hypothesis
    gain: float
    amplitudes: Floats
    error: Floats
    freedom: float
    shapes: Floats
    change_times: Floats
    response: tuple[Floats | Columns, ...]
    excited: bool
    steps: Floats = field(default_factory=lambda: np.zeros(0))


_Key = tuple[str, tuple[float, ...]]
"""An amplitude, and values of the shapes that act on it."""


@dataclass(frozen=True)
class _Sums:
    """Products of columns with those of the fit ``(n_fit, n)``, with each other ``(n, n)``, and with the residual."""

    cross: Floats
    square: Floats
    pull: Floats

    def take(self, rows: Sequence[int]) -> _Sums:
        """Return those of some of the columns."""
        return _Sums(self.cross[:, rows], self.square[np.ix_(rows, rows)], self.pull[rows])


@dataclass
class _PlainColumns:
    """Columns of amplitudes that act at once: the place of each, and by drive ``(samples * ny, n)``."""

    places: dict[_Key, int]
    by_drive: list[Floats]


@dataclass(frozen=True)
class _Promised:
    """What columns promise, and the weights with which those of the fit take part ``(n_fit, n)``."""

    gain: float
    amplitudes: Floats
    information: Floats
    seen: NDArray[np.bool_]
    freedom: float
    weights: Floats


class ScoreTest:
    """The test at one fit.

    Args:
        fitting: The recordings.
        fitted: The fit; what it moved is projected out, but for the noise and random processes.
    """

    def __init__(self, fitting: Fitting, fitted: FittedHypothesis) -> None:
        self.fitting, self.point, self._at = fitting, fitted.point, fitted.point
        self.augmented, self.drives = fitting.augmented, fitting.drives
        self.kept = fitting.runs(fitted.point)
        self.residual = [np.nan_to_num(k.whitened).reshape(-1) for k in self.kept]
        self._coordinates = [c for c in fitted.coordinates if c.kind == "parameter"]
        self.moved = fitting.columns(self._coordinates, fitted.point)
        self._outputs = len(self.augmented.model.outputs)
        self._linearisation = ModelTangents(self.augmented)
        self._plain_known = _PlainColumns({}, [np.zeros((len(r), 0)) for r in self.residual])
        # An effect that earlier drives showed keeps its shapes.
        self._held = {n: float(self.point.values[self.augmented.row(n), 0]) for n in self.augmented.held.names}
        self._onsets: dict[int, Onsets] = {}
        self._cached: dict[tuple[int, str], Columns] = {}
        self._own: dict[str, tuple[str, ...]] = {}
        self._ranges: dict[str, tuple[float, float]] = {}
        self._project()

    def _project(self) -> None:
        """Find with what weights the columns of the fit take part in others."""
        moved, point = self._coordinates, self.point
        joint = self.augmented.joint_prior(moved)
        weight = np.diag([c.prior**-2.0 for c in moved]) + (0.0 if joint is None else joint)
        away = np.array([c.coordinate(point.value(c)) - c.centre for c in moved])
        information = total([N.T @ N for N in self.moved]) + weight
        self._pull = total([N.T @ r for N, r in zip(self.moved, self.residual, strict=True)]) + weight @ away
        self._inverse = np.linalg.pinv(information, rcond=1e-10, hermitian=True)
        self._products: dict[tuple[int, str, str], Floats] = {}
        self._crossed: dict[tuple[int, str], Floats] = {}

    def without(self, h: Hypothesis, own: Collection[str], point: ParameterPoint) -> ScoreTest:
        """Return the test of a fit without something that this one moved, as the columns at this one predict it.

        Args:
            h: What is gone; no random process, without which the filter is another one.
            own: Its parameters that nothing else has.
            point: The point of this fit with these as stated.
        """
        test = copy(self)
        step = np.zeros(len(self._coordinates))
        for i, c in enumerate(self._coordinates):
            if c.name in h.amplitudes:
                step[i] = c.coordinate(point.value(c)) - c.coordinate(self.point.value(c))
        kept = [i for i, c in enumerate(self._coordinates) if c.name not in own]
        test.residual = [r + N @ step for r, N in zip(self.residual, self.moved, strict=True)]
        test.moved, test._coordinates = [N[:, kept] for N in self.moved], [self._coordinates[i] for i in kept]
        # Columns of what is in force hold for the shapes that it has.
        test._held = self._held | {n: float(self._at.values[self.augmented.row(n), 0]) for n in h.shapes}
        test.point, test._ranges = point, {}
        test._project()
        return test

    def of(self, tried: Sequence[Hypothesis]) -> list[Score]:
        """Return the scores of hypotheses, in their order."""
        plain = [h for h in tried if not h.change_times]
        changes = [h for h in tried if h.change_times]
        share = self.augmented.share
        self._find_columns(plain)
        sums = self._sums_of(self._plain_known.by_drive)
        scores = dict(zip(plain, share(lambda h: self._plain(h, sums), plain), strict=True))
        share(lambda i: self._change(changes, i), range(len(self.drives)))
        scores |= {h: self._change_times(h) for h in changes}
        return in_basis([scores[h] for h in tried])

    def _sensitivities(self, drive: int, values: Floats, names: Sequence[str]) -> Floats:
        """Return columns ``(samples * ny, n)`` for a parameter each, at values of their own ``(np, n)``."""
        return in_rows(
            self.augmented.sensitivities(self.drives[drive], values, self.augmented.along(names), self.kept[drive])
        )

    def _find_columns(self, plain: Sequence[Hypothesis]) -> None:
        """Find the columns of all amplitudes at all shapes that act on them, once each."""
        for h in sorted(plain, key=lambda h: len(h.shapes)):
            for a in h.amplitudes:
                self._own.setdefault(a, h.shapes)  # what acts at several places has the shapes of all of them
        columns = self._plain_known
        asked = dict.fromkeys(key for h in plain for shapes in self._grid(h) for key in self._keys(h, shapes))
        wanted = [key for key in asked if key not in columns.places]

        def of_drive(i: int) -> Floats:
            values = np.repeat(self._at.values[:, [i]], len(wanted), axis=1)
            for j, (a, shapes) in enumerate(wanted):
                values[[self.augmented.row(n) for n in self._own[a]], j] = shapes
            return self._sensitivities(i, values, [a for a, _ in wanted])

        if wanted:
            new = self.augmented.share(of_drive, range(len(self.drives)))
            before = zip(columns.by_drive, new, strict=True)
            columns.by_drive = [np.hstack(both) for both in before] if columns.places else new
            columns.places |= {key: len(columns.places) + j for j, key in enumerate(wanted)}

    def _keys(self, h: Hypothesis, shapes: tuple[float, ...]) -> list[_Key]:
        """Return the columns of a hypothesis at values of its shapes: each amplitude with the shapes of its own."""
        at = dict(zip(h.shapes, shapes, strict=True))
        return [(a, tuple(at[n] for n in self._own[a])) for a in h.amplitudes]

    def _grid(self, h: Hypothesis) -> list[tuple[float, ...]]:
        """Return the shapes at which a hypothesis is tried; a parameter in force already keeps its value."""

        def values(name: str) -> tuple[float, ...]:
            row = self.augmented.row(name)
            if name in self._held:
                return (self._held[name],)
            return self.augmented.model.parameters[row].grid or (float(self.point.values[row, 0]),)

        return list(itertools.product(*(values(n) for n in h.shapes)))

    def _plain(self, h: Hypothesis, all_sums: _Sums) -> Score:
        columns, grid = self._plain_known, self._grid(h)
        chosen = [[columns.places[key] for key in self._keys(h, shapes)] for shapes in grid]
        gains = [self._promised(h, all_sums.take(places)).gain for places in chosen]
        best = int(np.argmax(gains))
        X = [x[:, chosen[best]] for x in columns.by_drive]
        sums, no_times = all_sums.take(chosen[best]), np.zeros((len(self.drives), 0))
        return self._judged(h, X, sums, np.array(grid[best]), no_times)

    def _sums_of(self, X: Sequence[Floats]) -> _Sums:
        """Return the products of columns ``(samples * ny, n)`` of each drive, summed over the drives."""

        def of_drive(i: int) -> tuple[Floats, Floats, Floats]:
            return self.moved[i].T @ X[i], X[i].T @ X[i], X[i].T @ self.residual[i]

        return _Sums(*map(total, zip(*self.augmented.share(of_drive, range(len(X))), strict=True)))

    def _promised(self, h: Hypothesis, sums: _Sums) -> _Promised:
        """Return the predicted gain of a hypothesis with columns of given products."""
        weights = self._inverse @ sums.cross
        G = sums.square - sums.cross.T @ weights
        b = weights.T @ self._pull - sums.pull
        freedom = float(h.count(len(self.drives)))
        if h.name == ALL_PARAMETERS:  # stated values count as measured, once, within the prior
            prior = np.diag([self.augmented.stated_std(n) ** -2.0 for n in h.amplitudes])
            freedom, G = float(np.trace(np.linalg.solve(G + prior, G))), G + prior
        # A column whose power the fit's own columns explain but for 1e-9 is not there.
        seen = np.diagonal(G) > np.maximum(1e-9 * np.diagonal(sums.square), 1e-300)
        a, gain = best_amplitudes(b, G, seen, *self._room(h))
        return _Promised(gain, a, G, seen, freedom, weights)

    def _judged(self, h: Hypothesis, X: Sequence[Floats], sums: _Sums, shapes: Floats, change_times: Floats) -> Score:
        promise = self._promised(h, sums)
        error = np.full(len(promise.amplitudes), np.inf)
        if promise.seen.any():
            error[promise.seen] = covariance_of(promise.information[np.ix_(promise.seen, promise.seen)]).errors
        moved = promise.weights @ promise.amplitudes
        response = tuple(
            (x @ promise.amplitudes - N @ moved).astype(np.float32).reshape(-1, self._outputs)
            for x, N in zip(X, self.moved, strict=True)
        )
        start = np.array([self.point.values[self.augmented.row(n), 0] for n in h.amplitudes])
        steps, excited = promise.amplitudes, bool(promise.seen.any())
        return Score(
            h, promise.gain, start + steps, error, promise.freedom, shapes, change_times, response, excited, steps
        )

    def _room(self, h: Hypothesis) -> tuple[Floats, Floats]:
        """Return how far each amplitude may move down and up, the others as they are."""
        at = self.point.values[:, 0]
        for n in h.amplitudes:
            if n not in self._ranges:
                self._ranges[n] = self.augmented.possible_range(n, at)
        ends = np.array([self._ranges[n] for n in h.amplitudes])
        lower, upper = ends.T - at[[self.augmented.row(n) for n in h.amplitudes]]
        return lower, upper

    def _change_times(self, h: Hypothesis) -> Score:
        """Score a change at a time of its own in every drive, at the best of a grid of times.

        A second time ends what the first one began, so its response is that of the beginning, taken back.
        """
        chosen = join(self.augmented.share(lambda i: self._choices(h, i), range(len(self.drives))))
        X, change_times = [], np.zeros((len(self.drives), len(h.change_times)))
        for i, (first, second) in enumerate(chosen):
            never, grid = float(self.drives[i].time[-1]), self._times(i)
            change_times[i] = [grid[k] if k >= 0 else never for k in (first, second)][: len(h.change_times)]
            steps = [self._steps(h, a, i) for a in h.amplitudes]
            X.append(np.column_stack([_response(s, first) - _response(s, second) for s in steps]).astype(float))
        return self._judged(h, X, self._sums_of(X), np.array(self._grid(h)[0]), change_times)

    def moments_of(self, h: Hypothesis) -> Floats:
        """Return the likeliest change times of a hypothesis whose amplitudes are known ``(drives, change_times)``.

        The fit is that without it; its amplitudes are those of the point, which have no effect as long as its change
        times are never.
        """
        a = self.point.values[[self.augmented.row(n) for n in h.amplitudes], 0]
        moments = np.zeros((len(self.drives), len(h.change_times)))
        for i, drive in enumerate(self.drives):
            grid, choices = self._times(i), self._choices(h, i)
            best = choices.change_times[np.argmax(choices.b @ a - 0.5 * (choices.G @ a) @ a), 0]
            moments[i] = [grid[k] if k >= 0 else drive.time[-1] for k in best][: len(h.change_times)]
        return moments

    def _times(self, drive: int) -> Floats:
        return np.arange(SPACING, self.drives[drive].time[-1] - SPACING, SPACING)

    def _steps(self, h: Hypothesis, amplitude: str, drive: int) -> Columns:
        """Return responses to changes of an amplitude at the times of a drive's grid ``(samples * ny, times)``."""
        if (drive, amplitude) not in self._cached:
            self._change([h], drive)
        return self._cached[drive, amplitude]

    def _change(self, many: Sequence[Hypothesis], drive: int) -> None:
        """Find the responses to all changes of some hypotheses in a drive at once."""
        if drive not in self._onsets:
            values, kept = self._at.values[:, drive], self.kept[drive]
            self._onsets[drive] = Onsets(self._linearisation, self.drives[drive], values, kept, self._times(drive))
        wanted = {a: h for h in many for a in h.amplitudes if (drive, a) not in self._cached}
        responses = self._onsets[drive].responses(
            [ChangeResponse(a, h.change_times[0], self._begun(h, drive)) for a, h in wanted.items()]
        )
        self._cached |= {(drive, a): x for a, x in zip(wanted, responses, strict=True)}

    def _begun(self, h: Hypothesis, drive: int) -> Floats:
        """Return the point with the first shapes of a hypothesis, and without an end to what begins."""
        values = self._at.values[:, drive].copy()
        values[[self.augmented.row(n) for n in h.shapes]] = self._grid(h)[0]
        for m in h.change_times:
            values[self.augmented.row(m)] = self.augmented.model.parameters[self.augmented.row(m)].upper
        return values

    def _sums(self, drive: int, h: Hypothesis, amplitude: str, other: str) -> Floats:
        """Return what the responses to changes of two amplitudes have in common ``(times, times)``, projected."""
        if (drive, other, amplitude) in self._products:
            return self._products[drive, other, amplitude].T
        if (drive, amplitude, other) not in self._products:
            X, Z = (self._steps(h, a, drive) for a in (amplitude, other))
            along, other_along = (self._along(drive, h, a) for a in (amplitude, other))
            projected = along.T @ self._inverse @ other_along
            square = (X.T @ Z).astype(float)
            if amplitude == other:  # what the fit's own columns leave of a response is known no better than this
                square[np.diag_indices_from(square)] *= 1 + _ROUNDED
            self._products[drive, amplitude, other] = square - projected
        return self._products[drive, amplitude, other]

    def _along(self, drive: int, h: Hypothesis, amplitude: str) -> Floats:
        """Return the products of the fit's columns with responses to changes of an amplitude ``(n_fit, times)``."""
        if (drive, amplitude) not in self._crossed:
            N, X = self.moved[drive].astype(np.float32), self._steps(h, amplitude, drive)
            self._crossed[drive, amplitude] = (N.T @ X).astype(float)
        return self._crossed[drive, amplitude]

    def _choices(self, h: Hypothesis, drive: int) -> Choices:
        """Return all choices of change times in one drive by themselves, and first that of no change there."""
        G = np.array([[self._sums(drive, h, a, c) for c in h.amplitudes] for a in h.amplitudes])
        residual = self.residual[drive].astype(np.float32)
        b = -np.array([residual @ self._steps(h, a, drive) for a in h.amplitudes], dtype=float)
        return choices(b, G, len(h.change_times) > 1)


def _response(steps: Columns, moment: int) -> Columns:
    """Return the response to a change at a time of the grid; none to one that never comes."""
    return steps[:, moment] if moment >= 0 else np.zeros_like(steps[:, 0])


def total(parts: Sequence[Floats]) -> Floats:
    """Return the sum over drives."""
    return np.sum(parts, axis=0)


def scaled(G: Floats) -> tuple[Floats, Floats]:
    """Return a matrix scaled to a unit diagonal, and the scale."""
    s = np.sqrt(np.diagonal(G))
    return G / np.outer(s, s), s


def best_amplitudes(b: Floats, G: Floats, seen: NDArray[np.bool_], down: Floats, up: Floats) -> tuple[Floats, float]:
    """Return the amplitudes within bounds of the largest predicted gain, and that gain.

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
    solution = optimize.lsq_linear(root, target, (low, np.maximum(high, low + 1e-12)), method="bvls").x
    a[seen] = solution / s
    return a, float(b @ a - 0.5 * a @ G @ a)


def cosine(score: Score, other: Score) -> float:
    """Return the cosine between the predicted responses of two scores; 1 if the drives cannot distinguish them."""
    squares = [sum(float(np.vdot(x, x)) for x in s.response) for s in (score, other)]
    if min(squares) == 0.0:
        return 0.0
    inner = sum(float(np.vdot(x, y)) for x, y in zip(score.response, other.response, strict=True))
    return inner / float(np.sqrt(squares[0] * squares[1]))


def in_basis(scores: Sequence[Score]) -> list[Score]:
    """Return scores with their responses in an orthonormal basis of these ``(scores,)``: all cosines are the same."""
    if not scores:
        return []
    drives = zip(*(s.response for s in scores), strict=True)
    products = total([R @ R.T for R in (np.array(own, dtype=float).reshape(len(scores), -1) for own in drives)])
    sizes = np.sqrt(np.diagonal(products))
    units = np.where(sizes > 0.0, sizes, 1.0)
    values, vectors = np.linalg.eigh(products / np.outer(units, units))
    basis = vectors * np.sqrt(np.maximum(values, 0.0)) * sizes[:, None]
    return [replace(s, response=(row,)) for s, row in zip(scores, basis, strict=True)]
