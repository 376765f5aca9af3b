"""The numbers of a population, each computed once: errors of its vehicles, and shares of its factors in them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from harness.common.arrays import Floats
from harness.config import StudySpec
from harness.models.quantities import words
from harness.study.given_data import Shares, shares
from harness.study.report.ranking import Ranking, limits_of
from harness.study.results import Design
from harness.study.score_names import ESTIMATOR_DIVERGED, NORMAL_SCORE


class Population:
    """What a ``population`` design says of each estimator.

    Args:
        design: The design.
        seed: Of the study.
        attributes: Of the store.
    """

    def __init__(self, design: Design, seed: int, attributes: Mapping[str, Any]) -> None:
        self.design, self._ranking, self._attributes = design, Ranking(design, seed), attributes
        self._stated: dict[str, list[list[Any]]] = self._stored("groups")

    def _stored(self, name: str) -> Any:
        """Return what a store holds by design as JSON."""
        stored = self._attributes.get(name) or {}
        return json.loads(stored) if isinstance(stored, str) else stored

    @property
    def scramblings(self) -> int:
        """Independent scramblings, of equally many points each, one behind the other."""
        return int(self.design.data.attrs["scramblings"])

    @property
    def correlation(self) -> Floats:
        """Correlation of the normal scores of the factors, ``(factor, factor)``."""
        stored = self.design.data.attrs.get("correlation")
        return np.eye(len(self.design.factors)) if stored is None else np.array(json.loads(stored), dtype=float)

    @cached_property
    def share(self) -> float | None:
        """How likely it is that the vehicle is one of these, in a ratio to other designs; ``None`` if not stated."""
        share: float | None = self._stored("shares").get(self.design.name)
        return share

    @cached_property
    def groups(self) -> dict[str, list[int]]:
        """Factors that are ranked as one, by their name in words: a group that was stated, or a factor alone."""
        names = [f.name for f in self.design.factors]
        stated = {words(g): [names.index(n) for n in members] for g, members in self._stated.get(self.design.name, [])}
        taken = {i for members in stated.values() for i in members}
        return {**stated, **{f.words: [i] for i, f in enumerate(self.design.factors) if i not in taken}}

    @property
    def within(self) -> float:
        """Half-width of the interval of a probability for which points are counted."""
        return float(self._attributes.get("probability_within", StudySpec.probability_within))

    @cached_property
    def limits(self) -> dict[int, float]:
        """Largest tolerable error by the number of the target, in report units."""
        limits = limits_of(dict(self._attributes))
        return {t: limits[q.name] * q.scale for t, q in enumerate(self.design.targets) if q.name in limits}

    @cached_property
    def rmse(self) -> Floats:
        """RMSE of each vehicle on its worst drive, ``(target, estimator, scrambling, point)``; infinite if diverged."""
        return self._worst(self.design.errors_under_control)

    @cached_property
    def largest(self) -> Floats:
        """Largest error of each vehicle at any time, shape as ``rmse``."""
        values = self.design.in_report_units("max_error")
        values[:, self.design.status == ESTIMATOR_DIVERGED] = np.inf
        return self._worst(values)

    def _worst(self, values: Floats) -> Floats:
        worst = np.fmax.reduce(values[:, 0], axis=(2, 4), initial=0.0)  # over drives and repeats
        return worst.reshape(*worst.shape[:2], self.scramblings, -1)

    @cached_property
    def shares(self) -> list[list[Shares | None]]:
        """Shares of the groups in the variance of the error, by target and estimator."""
        factors = [f.name for f in self.design.factors]
        scores = np.stack([self.design.data[f"{NORMAL_SCORE}_{name}"].values for name in factors], axis=-1)
        cut = scores.reshape(self.scramblings, -1, len(factors))
        return [[self._shares(cut, outcome) for outcome in row] for row in self._ranking.outcomes]

    def _shares(self, scores: Floats, outcome: Floats) -> Shares | None:
        if not np.isfinite(outcome).all():
            return None
        with threadpool_limits(1):  # thousands of small products, for which threads wait longer than they work
            return shares(scores, outcome.reshape(self.scramblings, -1), self.correlation, list(self.groups.values()))

    def order(self, target: int) -> list[int]:
        """Return the groups by their mean share over the estimators, largest first."""
        sizes = [[s.value for s in own.shapley] for own in self.shares[target] if own is not None]
        return [int(i) for i in np.argsort(-np.mean(sizes, axis=0), kind="stable")] if sizes else []

    def best(self, target: int) -> int:
        """Return the estimator with the smallest median of the error."""
        return self._ranking.best(target)

    def named(self, groups: Sequence[int]) -> list[str]:
        """Return the names of groups in words."""
        names = list(self.groups)
        return [names[i] for i in groups]
