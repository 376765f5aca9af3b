"""The numbers of the sections on designs over all factors at once: Sobol indices and tolerances, each computed once."""

from __future__ import annotations

import json
from functools import cached_property
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.study import sobol_indices
from harness.study.results import Design
from harness.study.score_names import ESTIMATOR_DIVERGED
from harness.study.sobol_indices import Indices
from harness.study.tolerance import Tolerance, tolerance

FEWEST = 0.05
"""Share of the points that must differ from the others in their diverged runs; an index of fewer is mostly chance."""


class Ranking:
    """Sobol indices of a ``saltelli`` design."""

    def __init__(self, design: Design, seed: int):
        self.design = design
        self.seed = seed

    def _indices(self, outcome: Floats) -> Indices | None:
        if not np.isfinite(outcome).all():
            return None
        return sobol_indices.sobol_indices(outcome, len(self.design.factors), seed=self.seed)

    @cached_property
    def outcomes(self) -> Floats:
        """Error of each point over all drives in report units, diverged runs scored, ``(target, estimator, sample)``.

        Runs of a vehicle out of control count up to there. NaN for an estimator that does not give the target.
        """
        errors = self.design.errors_under_control[:, 0]
        return np.stack([sobol_indices.over_drives(sobol_indices.scored(values)) for values in errors])

    @cached_property
    def lost(self) -> Floats:
        """Share of the runs of each point in which an estimator diverged, ``(estimator, sample)``."""
        return np.asarray(np.mean(self.design.status[0] == ESTIMATOR_DIVERGED, axis=(1, 3)))

    @cached_property
    def out_of_control(self) -> Indices | None:
        """Indices of the share of runs of a vehicle out of control; None as ``divergence``."""
        share = np.asarray(np.mean(self.design.out_of_control[0], axis=(0, 2)))
        return self._indices(share) if np.mean(share != np.median(share)) >= FEWEST else None

    @cached_property
    def errors(self) -> list[list[Indices | None]]:
        """Indices of the error by target and estimator; None where it does not vary or no run has a score."""
        return [[self._indices(y) for y in row] for row in self.outcomes]

    @cached_property
    def of_ranks(self) -> list[list[Indices | None]]:
        """Indices of the rank of the error, for which the score of a diverged run matters little."""
        return [[self._indices(np.where(np.isnan(y), y, sobol_indices.ranks(y))) for y in row] for row in self.outcomes]

    @cached_property
    def divergence(self) -> list[Indices | None]:
        """Indices of the share of diverged runs by estimator; None where too few points differ in it from others."""
        return [self._indices(y) if np.mean(y != np.median(y)) >= FEWEST else None for y in self.lost]

    def converging(self, target: int, estimator: int) -> list[Indices]:
        """Return the indices of the error from ever more of the points."""
        return sobol_indices.converging(self.outcomes[target, estimator], len(self.design.factors), seed=self.seed)

    def best(self, target: int) -> int:
        """Return the estimator with the smallest median of the error, diverged runs scored."""
        medians = np.median(self.outcomes[target], axis=-1)
        return int(np.argmin(np.where(np.isnan(medians), np.inf, medians)))

    def order(self, target: int) -> list[int]:
        """Return the factors by their mean total index over the estimators, largest first."""
        totals = [[t.value for t in indices.total] for indices in self.errors[target] if indices is not None]
        return [int(i) for i in np.argsort(-np.mean(totals, axis=0), kind="stable")] if totals else []


def limits_of(attributes: dict[str, Any]) -> dict[str, float]:
    """Return the largest tolerable error of each target, SI, by the attributes of a store; empty if it has none."""
    stored = attributes.get("limits", {})
    return dict(json.loads(stored) if isinstance(stored, str) else stored)


def tolerances(design: Design, limits: dict[str, float]) -> dict[tuple[int, int], Tolerance]:
    """Return what each estimator that gives a target tolerates in a ``tolerance`` design, by target and estimator.

    Args:
        design: The design.
        limits: Largest tolerable RMSE by target, SI; targets without one are left out.
    """
    by_target = {}
    for t, target in enumerate(design.targets):
        if target.name not in limits:
            continue
        for e in design.giving(t):
            errors = design.errors_under_control[t, :, e]
            worst = np.fmax.reduce(errors, axis=(1, 3), initial=0.0)  # over drives and repeats
            by_target[t, e] = tolerance(worst, limits[target.name] * target.scale, len(design.factors))
    return by_target
