"""A disturbance as a smooth function of one signal: a penalised cubic B-spline.

Beyond the values that were fitted the curve stays at its end (Eilers and Marx 1996 for the penalty on differences).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from harness.common.arrays import Floats
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.residuals.regressors import Regressor

DEGREE = 3
FUNCTIONS = 9
"""Numbers that describe a curve."""

_ENDS = 0.002
"""Share of the samples to either side that lies beyond the ends of a curve."""


@dataclass(frozen=True)
class Basis:
    """The functions that a curve is made of.

    Attributes:
        knots: ``(FUNCTIONS + DEGREE + 1,)``.
    """

    knots: Floats

    @staticmethod
    def over(values: Floats) -> Basis:
        """Return a basis for samples of a signal, with evenly spaced knots."""
        low, high = np.quantile(values, [_ENDS, 1.0 - _ENDS])
        inner = np.linspace(low, max(high, low + 1e-12), FUNCTIONS - DEGREE + 1)
        return Basis(np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])]))

    @property
    def ends(self) -> tuple[float, float]:
        """Where the curve becomes constant."""
        return float(self.knots[0]), float(self.knots[-1])

    def of(self, values: Floats) -> Floats:
        """Return the functions at samples of the signal ``(samples, FUNCTIONS)``."""
        return BSpline.design_matrix(np.clip(values, *self.ends), self.knots, DEGREE).toarray()

    @staticmethod
    def roughness() -> Floats:
        """Return the sum of squared second differences as a matrix ``(FUNCTIONS, FUNCTIONS)``."""
        D = np.diff(np.eye(FUNCTIONS), 2, axis=0)
        return D.T @ D


@dataclass(frozen=True)
class Curve:
    """A disturbance at an input as a function of a signal.

    Attributes:
        disturbance_input: The input.
        regressor: The signal.
        basis: Its functions.
        weights: Of the functions ``(FUNCTIONS,)``.
        covariance: Of the weights.
        stability: Share of the halves of the data in which the lasso selected the pair.
        predicted: Gain in log-likelihood of drives from which it was not fitted, in cross-validation.
    """

    disturbance_input: DisturbanceInput
    regressor: Regressor
    basis: Basis
    weights: Floats
    covariance: Floats
    stability: float
    predicted: float

    def at(self, values: Floats) -> Floats:
        """Return the disturbance at samples of the signal."""
        return self.basis.of(values) @ self.weights

    def error(self, values: Floats) -> Floats:
        """Return the standard error there."""
        functions = self.basis.of(values)
        return np.sqrt(np.maximum(np.einsum("si,ij,sj->s", functions, self.covariance, functions), 0.0))
