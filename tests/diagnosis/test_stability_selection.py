"""Sparse regression with stability selection: the term that made the residuals is selected, whatever is beside it."""

import warnings
from types import SimpleNamespace

import numpy as np

from harness.diagnosis.residuals.dependence import Regressor, proposals

STEP, SAMPLES, GROWN = 0.01, 6000, 1e25
PARAMETERS = 2


def search(made_by, sizes):
    """Return what is proposed for residuals that one of two signals makes at the first of several inputs.

    Args:
        made_by: ``(signal, values)`` to what is seen of it, beside noise of the same size.
        sizes: Of the response at each input; they respond at once, the others with noise of their own.
    """
    rng = np.random.default_rng(4)
    signals = [rng.standard_normal((SAMPLES, 2)).cumsum(axis=0) / 50.0 for _ in range(2)]
    seen = [made_by(s)[:, None] + rng.standard_normal((SAMPLES, 1)) for s in signals]
    moved = [rng.standard_normal((SAMPLES, PARAMETERS)) for _ in range(2)]

    def responses(entry, terms):
        other = np.random.default_rng(entry).standard_normal((SAMPLES, 1)) if entry else 1.0
        return (sizes[entry] * other * terms)[:, None, :]

    ranking = SimpleNamespace(
        augmented=SimpleNamespace(share=lambda work, tasks: [work(task) for task in tasks]),
        linear=[SimpleNamespace(innovations=SimpleNamespace(step=STEP, responses=responses))] * 2,
        input_directions=lambda entry: [entry] * 2,
    )
    regressors = [Regressor(name, name, "1", signal=lambda *_: None) for name in ("first", "second")]
    return proposals(ranking, range(len(sizes)), regressors, signals, moved, seen)


def test_the_signal_and_the_input_that_made_the_residuals_are_the_most_stable():
    best, *others = search(lambda s: np.abs(s[:, 1]), (1.0, 1.0))
    assert (best.disturbance_input, best.regressor.name, best.stability) == (0, "second", 1.0)
    assert all(p.stability < 1.0 for p in others)
    assert all(p.stability < 0.5 for p in search(lambda s: 0.0 * s[:, 1], (1.0, 1.0)))


def test_responses_that_grow_without_end_overflow_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        best, *_ = search(lambda s: np.abs(s[:, 1]), (1.0, GROWN))
    assert (best.disturbance_input, best.regressor.name) == (0, "second")
