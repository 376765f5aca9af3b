"""Mean square error of an estimator as a quadratic function of how far parameters are from what it believes.

Of a filter that is right but for small errors of parameters the bias is linear in these, and the mean square error is
what remains without them and a positive form in them: ``E e^2 = a + b' x + x' M x``. The regression is one of gamma
distributed scatter, whose standard deviation is in proportion to the mean (iterated weights; McCullagh and Nelder 1989,
*Generalized Linear Models*, ch. 8, here with the identity as link), so that the many small errors count as much as the
few large ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError

_ROUNDS = 5
"""Rounds of the weights, behind which they no longer change much."""

_RUNS_PER_NUMBER = 2
"""Vehicles for each number of the regression, at least."""


@dataclass(frozen=True)
class SquaredErrorModel:
    """A regression of squared errors.

    Attributes:
        floor: Without any deviation.
        slope: At none ``(n,)``.
        curvature: Positive semi-definite ``(n, n)``.
        explained: Share of the variance of the squared errors that it explains.
    """

    floor: float
    slope: Floats
    curvature: Floats
    explained: float

    def expected(self, covariance: Floats) -> float:
        """Return the mean square error where deviations scatter about none with a covariance ``(n, n)``."""
        return self.floor + float(np.sum(self.curvature * covariance))

    def at(self, away: Floats) -> Floats:
        """Return the mean square error at deviations ``(vehicles, n)``."""
        return np.asarray(self.floor + away @ self.slope + np.sum((away @ self.curvature) * away, axis=1))


def numbers_of(count: int) -> int:
    """Return how many numbers the regression on so many parameters has."""
    return 1 + count + count * (count + 1) // 2


def squared_error_model(away: Floats, squares: Floats, where: str) -> SquaredErrorModel:
    """Return the regression of squared errors on deviations.

    Args:
        away: Of the parameters of each vehicle from what is believed ``(vehicles, n)``.
        squares: Mean square error of each ``(vehicles,)``, positive.
        where: What they are of, for the error.

    Raises:
        UserError: If there are too few vehicles.
    """
    count = away.shape[1]
    if len(squares) < (needed := _RUNS_PER_NUMBER * numbers_of(count)):
        raise UserError(
            f"{where}: {len(squares)} vehicles without a lost run; for {count} parameters {needed} are needed. Run the "
            "study with more samples, or with fewer factors"
        )
    rows, columns = np.triu_indices(count)
    products = away[:, rows] * away[:, columns]
    table = np.column_stack([np.ones(len(away)), away, products])
    upper = _weighted(table, squares)[1 + count :]
    matrix = np.zeros((count, count))
    matrix[rows, columns] = upper
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    curvature = (vectors * np.maximum(values, 0.0)) @ vectors.T  # a square is nowhere negative
    quadratic = np.sum((away @ curvature) * away, axis=1)
    floor, *slope = _weighted(table[:, : 1 + count], squares, quadratic)
    model = SquaredErrorModel(float(np.clip(floor, 0.0, squares.mean())), np.array(slope), curvature, 0.0)
    missed = float(np.mean(np.square(squares - model.at(away))))
    return SquaredErrorModel(model.floor, model.slope, curvature, max(1.0 - missed / float(squares.var() or 1.0), 0.0))


def _weighted(table: Floats, squares: Floats, offset: Floats | float = 0.0) -> Floats:
    """Return the coefficients of a regression with weights by the inverse square of what it gives ``(columns,)``."""
    root: Floats = 1.0 / np.broadcast_to(squares.mean(), squares.shape)
    least = squares.min()
    coefficients: Floats = np.zeros(table.shape[1])
    for _ in range(_ROUNDS):
        coefficients = np.asarray(np.linalg.lstsq(table * root[:, None], (squares - offset) * root, rcond=None)[0])
        root = 1.0 / np.maximum(table @ coefficients + offset, least)
    return coefficients
