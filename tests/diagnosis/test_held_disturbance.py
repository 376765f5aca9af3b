"""Disturbances that are held for some samples: against dense least squares over a staircase."""

from dataclasses import replace

import numpy as np
import pytest

from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection
from harness.diagnosis.residuals.disturbance_ranking import held_disturbances, samples_held
from harness.engine.simd.lanes import LANES

SAMPLES, STATES, OUTPUTS, STEP, TIME_CONSTANT, DEVIATION = 83, 5, 3, 0.1, 1.5, 0.7


@pytest.fixture(scope="module")
def drive():
    """A model that changes from sample to sample, whose third output is missing for a while, and two disturbances."""
    rng = np.random.default_rng(7)
    F = 0.5 * np.eye(STATES) + 0.3 / np.sqrt(STATES) * rng.normal(size=(SAMPLES, STATES, STATES))
    C, r = rng.normal(size=(SAMPLES, OUTPUTS, STATES)), 2.0 * rng.normal(size=(SAMPLES, OUTPUTS))
    g, c = rng.normal(size=(2, SAMPLES, STATES)), rng.normal(size=(2, SAMPLES, OUTPUTS))
    for of_third in (C[30:45, 2], r[30:45, 2], c[:, 30:45, 2], r[:1]):
        of_third[...] = 0.0
    return InnovationModel(F, C, r, STEP), [InputDirection(*parts) for parts in zip(g, c, strict=True)]


@pytest.mark.parametrize("held", [1, 2, 3, 7, 100])
def test_gain_and_history_are_those_of_dense_least_squares_over_a_staircase(drive, held):
    model, input_directions = drive
    steps = np.concatenate([[0], 1 + np.arange(SAMPLES - 1) // held])
    stairs = np.eye(steps.max() + 1)[steps]
    lag = np.abs(np.subtract.outer(np.arange(len(stairs[0])), np.arange(len(stairs[0]))))
    prior, r = DEVIATION**2 * np.exp(-lag * held * STEP / TIME_CONSTANT), model.residual.reshape(-1)
    for found, input_direction in zip(held_disturbances(model, input_directions, held), input_directions, strict=True):
        X = model.responses(input_direction, np.eye(SAMPLES)).reshape(-1, SAMPLES) @ stairs
        S = X @ prior @ X.T + np.eye(len(r))
        expected = -0.5 * (r @ np.linalg.solve(S, r) - r @ r + np.linalg.slogdet(S)[1])
        assert found.gains(TIME_CONSTANT, np.full(LANES, DEVIATION)) == pytest.approx(
            np.full(LANES, expected), rel=1e-9
        )
        mean, error = found.smoothed(TIME_CONSTANT, DEVIATION)
        weights = prior @ X.T @ np.linalg.inv(S)
        assert mean[1:] == pytest.approx((stairs @ weights @ r)[1:], abs=1e-9)
        left = stairs @ (prior - weights @ X @ prior) @ stairs.T
        assert error[1:] == pytest.approx(np.sqrt(np.diag(left))[1:], abs=1e-9)
        assert found.power() == pytest.approx(np.sum(X[:, 1:].sum(axis=1) ** 2), rel=1e-9)


def test_a_step_has_no_more_rows_than_tell_anything(drive):
    model, input_directions = drive
    assert held_disturbances(model, input_directions, 2)[0].model.residual.shape == (42, 2 * OUTPUTS)
    assert held_disturbances(model, input_directions, 20)[0].model.residual.shape == (6, STATES + 1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("growth", [1e10, np.inf, np.nan])
@pytest.mark.parametrize("held", [1, 20])
def test_an_unstable_filter_gives_nothing_finite_and_no_warning(drive, growth, held):
    model, input_directions = drive
    unstable = replace(model, transition=np.full_like(model.transition, growth))
    found = held_disturbances(unstable, input_directions, held)[0]
    assert not np.isfinite(found.power())
    assert not np.isfinite(found.gains(TIME_CONSTANT, np.full(LANES, DEVIATION))).any()


def test_a_disturbance_is_held_for_a_tenth_of_its_time_constant():
    assert [samples_held(t, 0.01) for t in (0.05, 0.3, 3.0, 30.0)] == [1, 3, 30, 300]
