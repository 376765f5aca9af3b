"""On which signal does a disturbance depend, and where? Sparse regression with stability selection.

The terms are a few functions of every regressor at the inputs of the largest gain. Each is filtered as the innovations
are, so that the innovations themselves are explained and not a smoothed disturbance. The lasso selects terms on halves
of the drives, cut into pieces and drawn in complementary pairs; a term that is selected often is kept (Meinshausen and
Buehlmann 2010; Shah and Samworth 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.innovations.innovation_model import lasso
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.regressors import Regressor

PIECE = 10.0
"""s; pieces of a drive that are drawn together."""

PAIRS = 20
"""Complementary halves that are drawn."""

TAKEN = 6
"""Terms that the lasso takes of each half."""

_SHAPES = (
    lambda s: s,
    lambda s: s**3,
    lambda s: np.tanh(3.0 * s),
    lambda s: np.abs(s),
    lambda s: s**2,
)
"""Of a signal over twice its standard deviation: linear, hardening, saturating, and two even functions."""


@dataclass(frozen=True)
class Proposal:
    """A pair of input and regressor with the share of halves in which one of its terms was selected."""

    disturbance_input: DisturbanceInput
    regressor: Regressor
    stability: float


def proposals(
    ranking: DisturbanceRanking,
    disturbance_inputs: Sequence[DisturbanceInput],
    regressors: Sequence[Regressor],
    signals: Sequence[Floats],
    moved: Sequence[Floats],
    residuals: Sequence[Floats],
) -> list[Proposal]:
    """Return pairs of input and regressor, the most stable first.

    Args:
        ranking: At the fit.
        disturbance_inputs: Inputs to be tried.
        regressors: Signals to be tried.
        signals: Their values by drive ``(samples, regressors)``.
        moved: What the fitted parameters do to the innovations, by drive ``(samples * ny, parameters)``.
        residuals: Whitened innovations that are to be explained, by drive ``(samples, ny)``.
    """
    scale = 2.0 * np.std(np.concatenate(signals), axis=0)
    pieces = ranking.augmented.share(
        lambda i: _pieces(
            ranking, disturbance_inputs, signals[i] / np.where(scale > 0, scale, 1.0), moved[i], residuals[i], i
        ),
        range(len(signals)),
    )
    gram, pull = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    rng = np.random.default_rng(0)
    count, fixed = len(gram), moved[0].shape[1]
    taken = np.zeros(len(disturbance_inputs) * len(regressors))
    for _ in range(PAIRS):
        order = rng.permutation(count)
        for half in (order[: count // 2], order[count // 2 :]):
            weights = _sparse(gram[half].sum(axis=0), pull[half].sum(axis=0), fixed)
            taken += np.any(weights.reshape(len(taken), len(_SHAPES)) != 0.0, axis=1)
    stability = taken / (2 * PAIRS)
    found = [
        Proposal(disturbance_inputs[j // len(regressors)], regressors[j % len(regressors)], float(stability[j]))
        for j in np.argsort(-stability, kind="stable")
    ]
    return [p for p in found if p.stability > 0]


def _pieces(
    ranking: DisturbanceRanking,
    disturbance_inputs: Sequence[DisturbanceInput],
    signals: Floats,
    moved: Floats,
    residual: Floats,
    drive: int,
) -> tuple[Floats, Floats]:
    """Return Gram matrix and pull of all terms, behind those of the parameters, for each piece of a drive."""
    shapes = np.stack([shape(signals) for shape in _SHAPES], axis=2)
    shapes -= shapes.mean(axis=0)
    terms = shapes.reshape(len(signals), -1)
    model = ranking.linear[drive].innovations
    ny = residual.shape[1]
    columns = [moved.astype(np.float32)]
    for disturbance_input in disturbance_inputs:
        response = model.responses(ranking.input_directions(disturbance_input)[drive], terms)
        columns.append(response.reshape(len(signals) * ny, -1).astype(np.float32))
    X, r = np.concatenate(columns, axis=1), residual.reshape(-1)
    length = round(PIECE / model.step) * ny
    pieces = []
    for begin in range(0, len(r), length):
        x = X[begin : begin + length].astype(float)  # where a linearised model grows its squares need the range
        pieces.append((x.T @ x, x.T @ r[begin : begin + length]))
    gram, pull = zip(*pieces, strict=True)
    return np.array(gram), np.array(pull)


def _sparse(gram: Floats, pull: Floats, fixed: int) -> Floats:
    """Return the lasso's weights of the terms, with the first ``fixed`` columns projected out."""
    cross = np.linalg.pinv(gram[:fixed, :fixed], rcond=1e-9, hermitian=True) @ gram[:fixed, fixed:]
    G, b = gram[fixed:, fixed:] - cross.T @ gram[:fixed, fixed:], pull[fixed:] - cross.T @ pull[:fixed]
    power, raw = np.diagonal(G), np.diagonal(gram)[fixed:]
    seen = power > 1e-4 * np.maximum(raw, 1e-300)
    scale = np.sqrt(np.where(seen, power, 1.0))
    weights = np.zeros(len(b))
    if seen.any():
        unit = G[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
        floor = np.sqrt(2.0 * np.log(seen.sum() + 1.0))  # the largest of as many pulls by chance (Donoho and Johnstone)
        weights[seen] = lasso(unit, b[seen] / scale[seen], float(floor), TAKEN)
    return weights
