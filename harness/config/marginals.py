"""Distribution of one factor by its inverse distribution function."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.common.arrays import Floats

SMALLEST = 2.0**-31
"""Probability beyond which no point of a design lies at an end at infinity: half the spacing of scrambled points."""

EDGE = 0.001
"""Probability beyond the edges that stand for an end at infinity where a design needs ends, as in a nested box."""

STEPS = ("discrete", "empirical")


@dataclass(frozen=True)
class Marginal:
    """Distribution of one factor, SI units.

    Attributes:
        kind: As in a study file.
        arguments: ``normal``, ``lognormal``: mean and standard deviation of the value or its logarithm;
            ``truncated_normal``: the same before truncation, and both ends; ``triangular``: smallest, likeliest and
            largest value; ``beta``: both exponents and both ends; ``discrete``, ``empirical``: values in ascending
            order, then how many times each there is.
    """

    kind: str
    arguments: tuple[float, ...]

    @functools.cached_property
    def _law(self) -> Any:
        """The distribution of SciPy."""
        from scipy import stats

        a = self.arguments
        match self.kind:
            case "normal":
                return stats.norm(*a)
            case "lognormal":
                return stats.lognorm(a[1], scale=np.exp(a[0]))
            case "truncated_normal":
                return stats.truncnorm((a[2] - a[0]) / a[1], (a[3] - a[0]) / a[1], loc=a[0], scale=a[1])
            case "triangular":
                return stats.triang((a[1] - a[0]) / (a[2] - a[0]), loc=a[0], scale=a[2] - a[0])
        return stats.beta(a[0], a[1], loc=a[2], scale=a[3] - a[2])

    @functools.cached_property
    def _steps(self) -> tuple[Floats, Floats]:
        """Values in ascending order, and the share of all up to each."""
        values, counts = np.reshape(self.arguments, (2, -1))
        return values, np.cumsum(counts) / np.sum(counts)

    @property
    def is_unbounded(self) -> bool:
        """Whether an end lies at infinity, so that points at an edge of the unit interval have no value."""
        return self.kind in ("normal", "lognormal") or not np.isfinite(self.arguments).all()

    def at(self, share: Floats) -> Floats:
        """Return the quantiles of probabilities, of any shape; of 0 and 1 at an end at infinity those next to it."""
        if self.kind in STEPS:
            values, up_to = self._steps
            return np.asarray(values[np.minimum(np.searchsorted(up_to, share, side="right"), len(values) - 1)])
        inside = np.clip(share, SMALLEST, 1.0 - SMALLEST) if self.is_unbounded else share
        values = np.asarray(self._law.ppf(inside), dtype=np.float64)
        if self.kind == "truncated_normal":  # an end is met but for rounding
            return np.clip(values, self.arguments[2], self.arguments[3])
        return values

    def below(self, value: float) -> float:
        """Return the probability of a value up to this one."""
        if self.kind in STEPS:
            values, up_to = self._steps
            count = int(np.searchsorted(values, value, side="right"))
            return float(up_to[count - 1]) if count else 0.0
        return float(self._law.cdf(value))

    def ends(self, beyond: float = SMALLEST) -> tuple[float, float]:
        """Return the smallest and the largest value; for an end at infinity the quantile this far from it."""
        low, high = self.at(np.array([0.0, 1.0])).tolist()
        if not self.is_unbounded:
            return low, high
        near = self.at(np.array([beyond, 1.0 - beyond])).tolist()
        law_low, law_high = self._law.support()
        return (low if np.isfinite(law_low) else near[0]), (high if np.isfinite(law_high) else near[1])
