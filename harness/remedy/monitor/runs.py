"""Runs of a study through a trust monitor, and the study with a design that is as believed."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import DesignSpec, FactorSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.signals import turn_of
from harness.runner.monitor import Bounds, Watching
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator

AS_BELIEVED = "as believed"


@dataclass(frozen=True)
class WatchedRun:
    """A run from its first scored sample to where the vehicle left the range of its model.

    Attributes:
        wrong: Whether the error of each target is beyond its limit, or no number ``(samples, targets)``.
        statistics: Of NIS and innovations, in standard deviations of their averages ``(samples, 1 + ny)``.
        verdicts: Level of trust, reasons and evidence ``(samples, 3)``.
        seen: Inputs, their rates per sample, measurements, NaN where missing, and estimates
            ``(samples, 2 nu + ny + ns)``.
    """

    wrong: Mask
    statistics: Floats
    verdicts: Floats
    seen: Floats


class Watcher:
    """A study and one of its estimators, ready to be watched; its first design is as believed.

    Args:
        study: The study.
        estimator: Name of the estimator; the first by default.
        limits: By target, SI.
        repeats: Runs that are as believed, by drive.

    Attributes:
        study: With that design and estimator.
        evaluator: Of it.
        estimator: The estimator.
        targets: With a limit, in the order of the study.

    Raises:
        UserError: If there is no such estimator or target, or it has no innovations.
    """

    def __init__(self, study: StudySpec, estimator: str | None, limits: dict[str, float], repeats: int) -> None:
        names = [e.name for e in study.estimators]
        if estimator is not None and estimator not in names:
            raise UserError(
                f"--estimator '{estimator}': study '{study.name}' has none of that name{closest(estimator, names)}"
            )
        spec = study.estimators[0 if estimator is None else names.index(estimator)]
        nominal = DesignSpec(AS_BELIEVED, believed_factors(study), repeats=repeats)
        self.study = replace(
            study, estimators=(spec,), designs=(nominal, *study.designs), history=(), over_time=None, limits=limits
        )
        self.evaluator = StudyEvaluator(self.study)
        made = self.evaluator.compiled.estimators[0]
        if not isinstance(made, CompiledEstimator) or not made.has_covariance:
            raise UserError(
                f"estimator '{spec.name}' ({spec.kind}) cannot be monitored: it states no covariance of innovations, "
                "or is no kernel of the harness"
            )
        self.estimator, self.targets = made, tuple(t for t in study.targets if t in limits)
        compiled = self.evaluator.compiled
        self._limits = np.array([limits[t] for t in self.targets])
        self._rows = [compiled.truth_names.index(t) for t in self.targets]
        self._columns = [compiled.signals.index(t) for t in self.targets]
        self._turns = np.array([turn_of(t) for t in self.targets])

    def runs(
        self, unit: Unit, bounds: Bounds, pool: ThreadPoolExecutor, most: int | None = None
    ) -> Iterator[WatchedRun]:
        """Give the runs of a unit, of many up to so many at even distances, a batch at a time."""
        cases = np.asarray(self.evaluator.cases(unit))
        if most is not None and most < len(cases):
            cases = cases[np.linspace(0, len(cases) - 1, most).round().astype(int)]
        groups = [cases[i : i + LANES] for i in range(0, len(cases), LANES)]
        for first in range(0, len(groups), _AT_ONCE):
            chosen = groups[first : first + _AT_ONCE]
            for runs in pool.map(lambda group: self._batch(unit, group, bounds), chosen):
                yield from runs

    def _batch(self, unit: Unit, group: NDArray[np.int64], bounds: Bounds) -> list[WatchedRun]:
        evaluator, compiled = self.evaluator, self.evaluator.compiled
        batch, believed = evaluator.simulate(unit, group), evaluator.held(unit, group, "belief")
        inputs, measured = evaluator.inputs(0, unit.drive, batch, believed), compiled.measured(batch.measurements)
        held = evaluator.believed_by(0, unit, group, believed)
        watched = self.estimator.run(inputs, measured, held, Watching(bounds))
        error = watched.estimates[:, self._columns] - batch.truth[:, self._rows]
        turns = np.where(self._turns > 0.0, self._turns, np.inf)[:, None]
        with np.errstate(invalid="ignore"):
            error = error - np.where(self._turns[:, None] > 0.0, turns * np.floor(error / turns + 0.5), 0.0)
            wrong = ~(np.abs(error) <= self._limits[:, None])
        rates = np.diff(inputs.at, axis=0, prepend=inputs.at[:1])
        y = measured.copy()
        y[0] = np.nan
        seen = np.concatenate([inputs.at, rates, y, watched.estimates], axis=1)
        first = max(evaluator.first_scored, 1)
        runs = []
        for lane in range(len(group)):
            kept = slice(first, max(int(batch.left_at[lane]), first))
            parts = wrong, watched.statistics, watched.verdicts, seen
            runs.append(WatchedRun(*(np.ascontiguousarray(each[kept, :, lane]) for each in parts)))
        return runs


_AT_ONCE = 8
"""Batches that are in memory at a time."""


def believed_factors(study: StudySpec) -> tuple[FactorSpec, ...]:
    """Return the factors of all designs with the value that the belief holds."""
    factors: dict[tuple[str, str], FactorSpec] = {}
    for factor in (f for design in study.designs for f in design.factors):
        held = (factor.nominal,)
        factors[factor.parameter, factor.of] = replace(
            factor, levels=held, lower=held, upper=held, labels=(AS_BELIEVED,), marginal=None, log=False
        )
    return tuple(factors.values())
