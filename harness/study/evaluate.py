"""Evaluate a unit of a study: simulate its runs, run every estimator on the same ones, return the scores."""

from __future__ import annotations

import copy
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError, placed
from harness.config import StudySpec
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import standard_normal
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.external_filter import ExternalFilter
from harness.external.losses import Losses
from harness.runner.contract import Batch, Filter, Held, InputSeries, Signals, Simulator
from harness.runner.scores import Scores, Scoring, Sums
from harness.simulation.external_plant import ExternalPlant
from harness.simulation.simulate import CompiledSimulator, as_stated
from harness.study.compiled_study import (
    CompiledStudy,
    ErrorWindows,
    held_by,
    in_a_row,
    in_batches,
    parameter_truth,
    scale_noise,
)
from harness.study.design import Unit, points
from harness.study.run_noise import Case, Cases, NoisyInputs, RunNoise, in_whole_batches
from harness.study.score_names import (
    ESTIMATOR_DIVERGED,
    LOST,
    LOST_CONTROL,
    OK,
    OVER_TIME,
    PENDING,
    PER_RUN,
    PER_TARGET,
    PLANT_DIVERGED,
    STATUS,
)

Result = dict[str, NDArray[np.generic]]
"""Scores by name as a store has them."""

_SIMULATED_AT_ONCE = 2**20
"""Bytes of simulated batches that a processor's caches hold in addition to everything else."""


class StudyEvaluator:
    """A study ready to evaluate units, from any thread.

    Args:
        study: The study.
        simulator, filters: As of ``CompiledStudy``.

    Attributes:
        compiled: Its models, estimators and drives.
        noise: The random numbers of its runs.
        windows: Those in which errors are kept over time.

    Raises:
        UserError, ModelError: If a drive, model or estimator cannot be built.
    """

    def __init__(
        self, study: StudySpec, simulator: Simulator | None = None, filters: Mapping[str, Filter] | None = None
    ) -> None:
        self.study, self.compiled, self.noise = study, CompiledStudy(study, simulator, filters), RunNoise(study)
        self.windows = ErrorWindows(study, self.compiled)
        self._noisy = NoisyInputs(study.belief) if study.belief.input_noise else None
        self._points: dict[int, NDArray[np.float64]] = {}

    def at(self, design: int, values: Floats) -> StudyEvaluator:
        """Return the same evaluator with other points of a design, which share the noise of its first.

        Args:
            design: Index of the design.
            values: Of its factors, ``(band, sample, factor)``.
        """
        other = copy.copy(self)
        other._points, other.noise = {**self._points, design: values}, self.noise.in_common(design)
        return other

    def warm_up(self, index: int) -> str:
        """Compile one kernel (0 is the simulation, then the estimators) and return its name; ``range(kernels)``."""
        short = Unit(0, 0, 0, 0, 1)
        if index == 0:
            self._try_plant(short)
            return "simulation"
        batch, believed = self.simulate(short, [Case(0, 0)], samples=3), self.held(short, [Case(0, 0)], "belief")
        self.estimate(index - 1, short, [Case(0, 0)], batch, believed)
        name, estimator = self.study.estimators[index - 1].name, self.compiled.estimators[index - 1]
        if isinstance(estimator, ExternalFilter) and (lost := estimator.losses.taken()):
            raise UserError(
                f"{self.study.path}: estimator '{name}' fails within the first 3 samples, at the first of which dt is "
                f"0 and no measurement is there: {lost[0]}"
            )
        return name

    def _try_plant(self, unit: Unit) -> None:
        """Simulate three samples; of a plant of somebody else as it is stated: one that never works is no study.

        Raises:
            UserError: If it fails.
        """
        simulator, case = self.compiled.simulator, [Case(0, 0)]
        if not isinstance(simulator, ExternalPlant):
            self.simulate(unit, case, samples=3)
            return
        stated = as_stated(self.study.plant, self.compiled.drives[unit.drive].profile)
        with placed(self.study.path, self.compiled.key_of_plant):
            lost = self.simulate(unit, case, samples=3, plant=stated).left_at[0] < 3
        sentences = simulator.losses.taken()
        if lost:
            why = sentences[0] if sentences else "it publishes no finite numbers within its limits"
            raise UserError(f"{self.study.path}: the plant fails before any factor is varied: {why}")

    @property
    def first_scored(self) -> int:
        """First sample that is scored."""
        return round(self.study.score_after / self.study.plant.step)

    @property
    def kernels(self) -> int:
        """Number of kernels that ``warm_up`` compiles."""
        return len(self.loops)

    @property
    def loops(self) -> list[Any]:
        """What ``warm_up`` calls, compiled loops over time; estimators that differ in settings alone share one."""
        compiled = self.compiled
        simulator = compiled.simulator
        loop = simulator.loop(compiled.recorded) if isinstance(simulator, CompiledSimulator) else simulator.run
        return [loop, *(e.loop if isinstance(e, CompiledEstimator) else e.run for e in compiled.estimators)]

    def time_of_batch(self, unit: Unit) -> float:
        """Return how long the first batch of a unit takes, simulation and all estimators, in s."""
        begin = time.perf_counter()
        group = self.cases(unit)[:LANES]
        batch, believed = self.simulate(unit, group), self.held(unit, group, "belief")
        for e in range(len(self.compiled.estimators)):
            self.estimate(e, unit, group, batch, believed, keep=self.windows.count(unit.design, unit.drive) is not None)
        return time.perf_counter() - begin

    def _batches_at_once(self, unit: Unit) -> int:
        """Return how many batches of a unit are simulated before the first is estimated."""
        recorded, outputs = self.compiled.recorded.names, self.compiled.simulator.ports.outputs
        numbers = len(recorded) + len(outputs) + len(self.study.plant.input_noise)
        return max(1, _SIMULATED_AT_ONCE // (8 * LANES * numbers * len(self.compiled.drives[unit.drive].plant)))

    @property
    def losses(self) -> list[Losses]:
        """Runs that plants and estimators of somebody else lost, those of each."""
        ran = (self.compiled.simulator, *self.compiled.estimators)
        return [losses for each in ran if isinstance(losses := getattr(each, "losses", None), Losses)]

    def lost(self) -> list[str]:
        """Return in words which runs plants and estimators of somebody else lost, and why, since the last call."""
        return [sentence for losses in self.losses for sentence in losses.taken()]

    def cases(self, unit: Unit) -> Cases:
        """Return the runs of a unit."""
        of_unit = range(self.study.designs[unit.design].repeats)[unit.repeats]
        repeats = np.arange(of_unit.start, of_unit.stop)
        return np.stack(np.meshgrid(np.arange(unit.first, unit.stop), repeats, indexing="ij"), axis=-1).reshape(-1, 2)

    def evaluate(self, unit: Unit) -> Result:
        """Return the scores of a unit: ``(sample, repeat, estimator[, target])`` by name, SI units."""
        result, windows = self.pending(unit), self.windows.count(unit.design, unit.drive)
        if windows is not None:
            shape = result["rmse"].shape
            result[OVER_TIME] = np.full((*shape, windows), np.nan, dtype=np.float32)
        cases, estimators = self.cases(unit), range(len(self.compiled.estimators))
        plant, believed = self.held(unit, cases, "plant"), self.held(unit, cases, "belief")
        each_believes = [self.believed_by(e, unit, cases, believed) for e in estimators]
        words = self.noise.words(unit, cases)
        left_at, signals = np.empty(len(cases)), len(self.compiled.signals)
        lost = np.zeros(len(cases), dtype=bool)
        stated = [e.has_covariance for e in self.compiled.estimators]
        totals = [Sums(np.empty((3, signals, len(cases))), np.empty((10, len(cases))), s) for s in stated]
        at_once = self._batches_at_once(unit) if windows is None and self._noisy is None else 1
        # Stage by stage, so that one is done with the caches before the next begins.
        for first in range(0, len(cases), LANES * at_once):
            lanes = slice(first, first + LANES * at_once)
            group, believed_there = cases[lanes], believed.of(lanes)
            batch = self.simulate(unit, group, plant=plant.of(lanes), believed=believed_there, words=words[lanes])
            left_at[lanes] = batch.left_at.reshape(-1)[: len(group)]
            if batch.lost is not None:
                lost[lanes] = batch.lost.reshape(-1)[: len(group)]
            for e, total in enumerate(totals):
                inputs = self.inputs(e, unit.drive, batch, believed_there)
                sums = self.sums(e, inputs, batch, each_believes[e].of(lanes), windows is not None)
                total.errors[..., lanes] = in_a_row(sums.errors, 3)[..., : len(group)]
                total.per_run[:, lanes] = in_a_row(sums.per_run, 2)[:, : len(group)]
                if windows is not None:
                    over_time = self.windows.rmse(batch, sums.scores(), windows)
                    flat = result[OVER_TIME].reshape(len(cases), *result[OVER_TIME].shape[2:])
                    flat[lanes, e] = over_time[: len(group)]
        for e, total in enumerate(totals):
            self.enter(result, unit, e, left_at, total.scores(), lost)
        return result

    def pending(self, unit: Unit) -> Result:
        """Return the scores of a unit, but for those over time, with nothing entered yet."""
        samples = unit.stop - unit.first
        shape = (samples, unit.runs(self.study) // samples, len(self.compiled.estimators))
        result: Result = {n: np.full((*shape, len(self.study.targets)), np.nan) for n in PER_TARGET}
        result |= {n: np.full(shape, np.nan) for n in PER_RUN}
        result[STATUS] = np.full(shape, PENDING, dtype=np.int8)
        result[LOST_CONTROL] = np.full(shape[:2], np.nan)
        return result

    def held(self, unit: Unit, group: Cases, side: Literal["plant", "belief"]) -> Held:
        """Return what plant or belief holds in each run, and in lanes without a run what it holds in the last one."""
        design = self.study.designs[unit.design]
        rows = in_whole_batches(np.asarray(group)[:, 0])
        if unit.design not in self._points:  # two threads that come at once lay out the same
            self._points[unit.design] = points(self.study, design).values
        values, profile = self._points[unit.design][unit.band, rows], self.compiled.drives[unit.drive].profile
        return held_by(getattr(self.study, side), design, side, values, profile)

    def believed_by(self, index: int, unit: Unit, group: Cases, believed: Held) -> Held:
        """Return what one estimator believes: with its noise, the variance of the first state and its seeds."""
        spec = self.study.estimators[index]
        scaled = scale_noise(believed, self.study.belief, spec.noise)
        is_random = self.compiled.estimators[index].is_random
        return replace(
            scaled,
            first_variance=self.compiled.first_variance(scaled.process_noise),
            seeds=self.noise.seeds(unit, group, spec.name) if is_random else None,
        )

    def simulate(
        self,
        unit: Unit,
        group: Cases,
        samples: int | None = None,
        plant: Held | None = None,
        believed: Held | None = None,
        words: NDArray[np.uint64] | None = None,
        record: Signals | None = None,
    ) -> Batch:
        """Simulate runs of a unit, with the noise that belongs to them.

        Up to ``LANES`` runs are one batch. Of more, here as in ``sums``, every array has an axis of batches in front.

        Args:
            unit: The unit.
            group: The runs.
            samples: How many samples of the drive, by default all.
            plant: What the plant holds in each lane, if that is there already.
            believed: What the belief holds in each lane, if that is there already.
            words: What the noise of each lane is drawn from (``RunNoise.words``), if that is there already.
            record: Signals of the plant, if others than scores and estimators need.
        """
        plant = self.held(unit, group, "plant") if plant is None else plant
        simulator, inputs = self.compiled.simulator, self.compiled.drives[unit.drive].plant[:samples]
        words = self.noise.words(unit, group) if words is None else words
        noise = self._drawn(words, len(inputs))
        batch = simulator.run(InputSeries(inputs), plant, noise, record or self.compiled.recorded)
        if self.study.plant.input_noise:
            assert plant.input_noise is not None
            deviations = np.sqrt(plant.input_noise)
            errors = {
                signal: deviations[..., i, None, :] * self.noise.of_input(unit, group, len(inputs), signal)
                for i, signal in enumerate(self.study.plant.input_noise)
            }
            batch = replace(batch, input_errors=errors)
        if not self.study.belief.parameter_states:
            return batch
        return self._with_parameters(batch, plant, believed or self.held(unit, group, "belief"))

    def _drawn(self, words: NDArray[np.uint64], samples: int) -> Floats:
        """Return standard normal numbers for the plant's states and outputs ``(..., samples, nx + ny, LANES)``.

        Sensors of a plant of somebody else have the noise that those of the believed vehicle would have.
        """
        ports, plant, belief = self.compiled.simulator.ports, self.study.plant, self.study.belief
        states, outputs = len(ports.states), len(ports.outputs)
        if plant.external is None:
            return standard_normal(words, samples, states + outputs)
        drawn = max(states, len(replace(belief, unknown_inputs=(), parameter_states=()).model().states))
        numbers = standard_normal(words, samples, drawn + outputs)
        return np.concatenate([numbers[..., :states, :], numbers[..., drawn:, :]], axis=-2)

    def _with_parameters(self, batch: Batch, plant: Held, believed: Held) -> Batch:
        """Add what is true of the parameters that the belief is not sure of."""
        still = in_batches(parameter_truth(self.study.plant, self.study.belief, plant, believed).T)[..., None, :, :]
        shape = (*batch.truth.shape[:-2], *still.shape[-2:])
        return replace(batch, truth=np.concatenate([batch.truth, np.broadcast_to(still, shape)], axis=-2))

    def estimate(
        self, index: int, unit: Unit, group: Cases, batch: Batch, believed: Held, keep: bool = False
    ) -> Scores:
        """Run one estimator over a simulated batch with what the belief holds in each lane, and score it."""
        inputs = self.inputs(index, unit.drive, batch, believed)
        return self.sums(index, inputs, batch, self.believed_by(index, unit, group, believed), keep).scores()

    def sums(self, index: int, inputs: InputSeries, batch: Batch, held: Held, keep: bool) -> Sums:
        """Run one estimator with what it believes (``believed_by``), and return what scores are made of."""
        record = Scoring(batch.truth, self.compiled.truth_names, batch.left_at, self.first_scored, keep)
        estimator = self.compiled.estimators[index]
        sums = estimator.run(inputs, self.compiled.measured(batch.measurements), held, record)
        if isinstance(estimator, ExternalFilter):
            sums.per_run[..., 4, :] *= estimator.nis_scale
        return sums

    def inputs(self, index: int, drive: int, batch: Batch, believed: Held) -> InputSeries:
        """Return the inputs that an estimator gets ``(samples, nu, LANES)``, and what it is told of their errors."""
        table = self.compiled.known(drive, batch)
        if self._noisy is None:
            return InputSeries(table)
        assert believed.input_noise is not None
        kind = self.study.estimators[index].input_signal or "filtered"
        return self._noisy.known(batch, table, believed.input_noise, kind)

    def enter(
        self,
        result: Result,
        unit: Unit,
        e: int,
        left_at: Floats,
        scores: Scores,
        lost: NDArray[np.bool_] | None = None,
    ) -> None:
        """Write a unit's scores of one estimator.

        Args:
            result: Written.
            unit: The unit.
            e: Index of the estimator.
            left_at: Sample at which each run's plant went out of control.
            scores: Of the estimator.
            lost: Runs that the code of the plant lost.
        """
        targets, runs = len(self.study.targets), result[STATUS].shape[:2]
        for name in PER_TARGET:
            result[name][:, :, e] = getattr(scores, name)[:targets].T.reshape(*runs, targets)
        for name in PER_RUN[:-1]:
            result[name][:, :, e] = getattr(scores, name).reshape(runs)
        length = len(self.compiled.drives[unit.drive].profile.time)
        diverged = scores.diverged_at < length
        beyond = ~diverged & (left_at < length)
        status = np.where(diverged, ESTIMATOR_DIVERGED, np.where(beyond, PLANT_DIVERGED, OK))
        if lost is not None:
            status = np.where(lost, LOST, status)
        step = self.study.plant.step
        first = np.where(diverged | beyond, np.where(diverged, scores.diverged_at, left_at) * step, np.nan)
        result[STATUS][:, :, e], result["time_of_divergence"][:, :, e] = status.reshape(runs), first.reshape(runs)
        result[LOST_CONTROL][...] = np.where(left_at < length, left_at * step, np.nan).reshape(runs)
