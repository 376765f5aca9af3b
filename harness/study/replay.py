"""One run of a study computed again from its seeds, with everything kept, as it was or with other values of factors.

The scores come from the kernels that wrote the store, over the same numbers, so they have the bits of the store where
code, packages and processor are the same. What an estimator holds between the samples comes from a loop of its own
(``harness.runner.history``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.config import StudySpec
from harness.config.alone import Change, alone
from harness.engine.simd.lanes import LANES
from harness.estimation.external_filter import ExternalFilter
from harness.models.assembly.plan import GroundPlan, Planner
from harness.models.roles import VEHICLES
from harness.models.signals import signal_attributes
from harness.runner.contract import Batch, Held, InputSeries, Signals
from harness.runner.history import EverySample
from harness.runner.scores import Scores
from harness.study.compiled_study import held_by
from harness.study.design import Unit, points
from harness.study.evaluate import StudyEvaluator
from harness.study.motion import dead_reckoned, motion, published
from harness.study.replayed import OverTime, dataset
from harness.study.run_noise import Case
from harness.study.score_names import LOST_CONTROL


@dataclass(frozen=True)
class Place:
    """Which run of a study: indices from 0."""

    design: int
    band: int
    drive: int
    sample: int = 0
    repeat: int = 0

    @property
    def unit(self) -> Unit:
        """The run as a piece of work."""
        run = self.sample, self.sample + 1, self.repeat, self.repeat + 1
        return Unit(self.design, self.band, self.drive, *run)


@dataclass(frozen=True)
class Replayed:
    """A run computed again.

    Attributes:
        place: Which run.
        study: The same run as a study of its own.
        estimators: Their indices in the study that the run is of.
        scores: By name as a store has them, ``(estimator,)`` or ``(estimator, target)``.
        data: Everything over time, see ``harness.study.replayed.dataset``.
        plant: What the plant held in the run, by parameter, SI.
        everything: All states, ports and inputs of the plant over ``time``, SI units; ``None`` where not asked for.
        plan: Where axles and coupling of the plant stand; ``None`` where not asked for, and where the equations do not
            say it.
        motion: The vehicle seen from above, see ``harness.study.motion.motion``; ``None`` where there is
            no plan.
        paths: ``x`` and ``y`` in m over ``time`` by estimator, dead reckoned from what it estimates; of those that
            estimate all states, and where innovations and ``everything`` were asked for.
    """

    place: Place
    study: StudySpec
    estimators: tuple[int, ...]
    scores: dict[str, NDArray[Any]]
    data: xr.Dataset
    plant: dict[str, float]
    everything: xr.Dataset | None = None
    plan: GroundPlan | None = None
    motion: xr.Dataset | None = None
    paths: Mapping[str, tuple[Floats, Floats]] = field(default_factory=dict)


class Replayer:
    """A study ready to compute single runs again, from one thread at a time.

    Args:
        study: The study.
        workers: Threads over the estimators of a run.

    Raises:
        UserError, ModelError: If a drive, model or estimator cannot be built.
    """

    def __init__(self, study: StudySpec, workers: int | None = None) -> None:
        self.study, self.evaluator = study, StudyEvaluator(study)
        self._pool = ThreadPoolExecutor(workers)
        self._points = [points(study, d).values for d in study.designs]

    @cached_property
    def planner(self) -> Planner | None:
        """What says where axles and coupling of the plant stand; ``None`` for a plant without equations."""
        if self.study.plant.external is not None:
            return None
        return Planner(self.study.plant.model(), VEHICLES.load(self.study.plant.vehicle))

    @cached_property
    def _watched_signals(self) -> Signals:
        """All that the plant publishes."""
        return Signals(published(self.study.plant.model()), self.evaluator.compiled.recorded.largest)

    def alone(self, place: Place, changes: Sequence[Change] = ()) -> StudySpec:
        """Return a run as a study of its own, see ``harness.config.alone``.

        Raises:
            UserError: If a change is not possible.
        """
        study, design = self.study, self.study.designs[place.design]
        drive, sample, repeat = self.evaluator.noise.key(place.unit, Case(place.sample, place.repeat))
        values = self._points[place.design][place.band, place.sample]
        begin = replace(study.count_from, drive=drive, sample=sample, repeat=repeat)
        return alone(study, design, study.drives[place.drive].name, list(map(float, values)), begin, changes)

    def run(
        self,
        place: Place,
        estimators: Sequence[int] | None = None,
        changes: Sequence[Change] = (),
        innovations: bool = True,
        everything: bool = False,
    ) -> Replayed:
        """Compute a run again.

        Args:
            place: Which run.
            estimators: Indices of those to run; all by default.
            changes: Values that differ from the run's.
            innovations: Whether to keep all states, innovations, NIS and NEES, or the drawn signals alone, which takes
                half the time.
            everything: Whether to keep all that the plant publishes, and how the vehicle moves.

        Raises:
            UserError: If a change is not possible.
        """
        study, unit, case = self.study, place.unit, [Case(place.sample, place.repeat)]
        chosen = tuple(range(len(study.estimators)) if estimators is None else estimators)
        own = self.alone(place, changes)
        factors = own.designs[0]
        row = np.array([[f.lower[0] for f in factors.factors]] * LANES).reshape(LANES, -1)
        profile = self.evaluator.compiled.drives[unit.drive].profile
        plant = held_by(own.plant, factors, "plant", row, profile)
        believed = held_by(own.belief, factors, "belief", row, profile)
        batch = self.evaluator.simulate(unit, case, plant=plant, believed=believed)
        scored = [self._pool.submit(self._scores, e, place, batch, believed) for e in chosen]
        followed = [self._pool.submit(self._follow, e, place, batch, believed) for e in chosen] if innovations else []
        over_time = [job.result() for job in followed] or [()] * len(chosen)
        runs = [OverTime(job.result(), *kept) for job, kept in zip(scored, over_time, strict=True)]
        result = self.evaluator.pending(unit)
        for e, run in zip(chosen, runs, strict=True):
            lost = None if batch.lost is None else batch.lost[:1]
            self.evaluator.enter(result, unit, e, batch.left_at[:1], run.scores, lost)
        scores = {name: values[0, 0, list(chosen)] for name, values in result.items() if name != LOST_CONTROL}
        data = dataset(self.evaluator, unit, batch, believed, dict(zip(chosen, runs, strict=True)))
        held = dict(zip(own.plant.model().parameter_names, map(float, plant.values[:, 0]), strict=True))
        seen, plan, moves = self._watched(unit, case, plant, held) if everything else (None, None, None)
        paths = self._paths(unit, chosen, batch, believed, data) if everything and innovations else {}
        return Replayed(place, own, chosen, scores, data, held, seen, plan, moves, paths)

    def _paths(
        self, unit: Unit, chosen: Sequence[int], batch: Batch, believed: Held, data: xr.Dataset
    ) -> dict[str, tuple[Floats, Floats]]:
        """Return where each estimator would be by what it estimates."""
        model, held = self.evaluator.compiled.belief.model, {}
        values = dict(zip(model.parameter_names, believed.values[:, 0], strict=True))
        for e in chosen:
            name = self.study.estimators[e].name
            table = self.evaluator.inputs(e, unit.drive, batch, believed).at
            held[name] = values | {n: table[:, i, 0] for i, n in enumerate(model.inputs)}
            own = data["estimate"].sel(estimator=name).values
            held[name] |= {str(t): own[:, i] for i, t in enumerate(data["target"].values) if str(t) in model.states}
        return dead_reckoned(model, held, data["time"].values)

    def _watched(
        self, unit: Unit, case: list[Case], plant: Held, held: Mapping[str, float]
    ) -> tuple[xr.Dataset, GroundPlan | None, xr.Dataset | None]:
        """Return what the plant publishes in a run, and how it moves."""
        names = self._watched_signals.names
        batch = self.evaluator.simulate(unit, case, plant=plant, record=self._watched_signals)
        model, samples = self.study.plant.model(), len(batch.truth)
        drive, gone = self.evaluator.compiled.drives[unit.drive], np.arange(samples) >= batch.left_at[0]
        columns = {name: drive.plant[:samples, i, 0] for i, name in enumerate(model.inputs)}
        columns |= {name: np.where(gone, np.nan, batch.truth[:, i, 0]) for i, name in enumerate(names)}
        everything = xr.Dataset(
            {name: ("time", values, signal_attributes(name)) for name, values in columns.items()},
            coords={"time": ("time", drive.profile.time[:samples], {"units": "s"})},
        )
        plan = None if self.planner is None else self.planner.plan(held)
        return everything, plan, None if plan is None else motion(plan, model, everything, held)

    def warm_up(self, estimator: int) -> None:
        """Compile what a run of one estimator needs beyond the kernels of the study."""
        unit, case = Unit(0, 0, 0, 0, 1, 0, 1), [Case(0, 0)]
        batch, believed = self.evaluator.simulate(unit, case, samples=3), self.evaluator.held(unit, case, "belief")
        self.evaluator.simulate(unit, case, samples=3, record=self._watched_signals)
        self._scores(estimator, Place(0, 0, 0), batch, believed)
        self._follow(estimator, Place(0, 0, 0), batch, believed)

    def _scores(self, index: int, place: Place, batch: Batch, believed: Held) -> Scores:
        """Return the scores of one estimator."""
        inputs, held = self._given(index, place, batch, believed)
        sums = self.evaluator.sums(index, inputs, batch, held, keep=True)
        return replace(sums, errors=sums.errors[..., :1], per_run=sums.per_run[:, :1]).scores()

    def _follow(self, index: int, place: Place, batch: Batch, believed: Held) -> tuple[Floats, ...]:
        """Return what one estimator holds over time, see ``harness.study.replayed.OverTime``."""
        compiled, (inputs, held) = self.evaluator.compiled, self._given(index, place, batch, believed)
        measured = compiled.measured(batch.measurements)
        kept = compiled.estimators[index].run(inputs, measured, held, EverySample())
        kept.facts[0] = np.nan
        if isinstance(estimator := compiled.estimators[index], ExternalFilter):
            kept.facts[:, 0] *= estimator.nis_scale
        variance = np.einsum("kaa->ka", kept.spread)
        return kept.mean, kept.state_covariance, kept.innovation, variance, kept.facts[:, :2]

    def _given(self, index: int, place: Place, batch: Batch, believed: Held) -> tuple[InputSeries, Held]:
        """Return what one estimator gets to know and what it believes."""
        unit, case = place.unit, [Case(place.sample, place.repeat)]
        inputs = self.evaluator.inputs(index, unit.drive, batch, believed)
        return inputs, self.evaluator.believed_by(index, unit, case, believed)
