"""Moments of changes: choices against least squares on the responses themselves, drive by drive and jointly."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.selection.change_times import choices, join
from harness.diagnosis.selection.score_test import ScoreTest

MOMENTS, SAMPLES = 5, 40


def drive(rng, amplitudes: int, begin: int, end: int, size) -> tuple[np.ndarray, np.ndarray]:
    """Return responses ``(samples, amplitudes, change_times)`` and a residual with a change between two moments."""
    X = rng.normal(size=(SAMPLES, amplitudes, MOMENTS))
    r = 0.1 * rng.normal(size=SAMPLES) - (X[:, :, begin] - (X[:, :, end] if end >= 0 else 0.0)) @ size
    return X, r


def sums(X, r) -> tuple[np.ndarray, np.ndarray]:
    """Return ``b`` and ``G`` of all moments."""
    return -np.einsum("iak,i->ak", X, r), np.einsum("iak,ibm->abkm", X, X)


def gain(X, r, pair) -> float:
    """Return by least squares what a pair of moments takes from half the sum of squares."""
    k, m = pair
    Z = np.zeros((SAMPLES, X.shape[1])) if k < 0 else X[:, :, k] - (X[:, :, m] if m >= 0 else 0.0)
    a = np.linalg.lstsq(Z, -r, rcond=None)[0]
    return 0.5 * (r @ r - np.sum((r + Z @ a) ** 2))


@pytest.mark.parametrize("ends", [False, True])
def test_gain_of_each_choice_is_that_of_least_squares(ends) -> None:
    X, r = drive(np.random.default_rng(1), 2, 1, 3 if ends else -1, np.array([1.0, -2.0]))
    found = choices(*sums(X, r), ends)
    assert len(found.b) == 1 + MOMENTS + (MOMENTS * (MOMENTS - 1) // 2 if ends else 0)
    expected = [gain(X, r, pair) for pair in found.change_times[:, 0].tolist()]
    np.testing.assert_allclose(found.gains(), expected, rtol=1e-4, atol=1e-6)


def test_joined_drives_share_their_amplitudes() -> None:
    """In a drive that shows little by itself the moments are those that suit the other's amplitude."""
    rng = np.random.default_rng(2)
    size = np.array([1.5])
    drives = [drive(rng, 1, 1, 3, size), drive(rng, 1, 0, 4, size), drive(rng, 1, 2, -1, size)]
    assert join([choices(*sums(*d), True) for d in drives]) == ((1, 3), (0, 4), (2, -1))


def test_join_finds_the_best_of_all_combinations() -> None:
    rng = np.random.default_rng(3)
    drives = [drive(rng, 2, 0, 2, np.array([0.2, 0.1])), drive(rng, 2, 1, 4, np.array([0.2, 0.1]))]
    found = [choices(*sums(*d), True) for d in drives]
    best = max(
        itertools.product(range(len(found[0].b)), range(len(found[1].b))),
        key=lambda ij: _joint(found[0], found[1], *ij),
    )
    assert join(found) == tuple(tuple(f.change_times[i, 0].tolist()) for f, i in zip(found, best, strict=True))


def _joint(one, other, i, j) -> float:
    b, G = one.b[i] + other.b[j], one.G[i] + other.G[j]
    return 0.0 if not G.any() else 0.5 * float(b @ np.linalg.solve(G + 1e-9 * np.eye(len(b)), b))


@pytest.mark.parametrize("pairs", [[(1, 3)], [(0, 4), (2, -1), (1, 2)]])
def test_moments_of_known_amplitudes_are_found_in_each_drive(pairs) -> None:
    rng, size = np.random.default_rng(4), np.array([1.5, -0.5])
    found = [choices(*sums(*drive(rng, 2, *pair, size)), True) for pair in pairs]
    grid = 10.0 + np.arange(MOMENTS)
    test = SimpleNamespace(
        point=SimpleNamespace(values=np.tile(np.array([[-9.0], [1.5], [-0.5]]), len(pairs))),
        augmented=SimpleNamespace(row={"first": 1, "second": 2}.__getitem__),
        drives=[SimpleNamespace(time=np.array([0.0, 99.0]))] * len(pairs),
        _times=lambda _: grid,
        _choices=lambda _, number: found[number],
    )
    hypothesis = SimpleNamespace(amplitudes=("first", "second"), change_times=("begin", "end"))
    expected = [[grid[k] if k >= 0 else 99.0 for k in pair] for pair in pairs]
    np.testing.assert_array_equal(ScoreTest.moments_of(test, hypothesis), expected)
