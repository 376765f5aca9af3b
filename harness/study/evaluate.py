"""Evaluate a unit of a study: simulate its runs, run every estimator on the same ones, return the scores."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.config import Study
from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import Belief, State
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import standard_normal
from harness.estimation.contract import Scores, Sums, UncertainInputs
from harness.simulation.simulate import Batch, Simulator, first_state
from harness.study.compiled_study import CompiledStudy, ErrorWindows, parameter_truth
from harness.study.design import RunParameters, Unit, points, run_parameters, scale_noise
from harness.study.noisy_inputs import NoisyInputs
from harness.study.run_noise import Case, Cases, RunNoise, in_whole_batches
from harness.study.scores import (
    ESTIMATOR_DIVERGED,
    LOST_CONTROL,
    OK,
    OVER_TIME,
    PENDING,
    PER_RUN,
    PER_TARGET,
    PLANT_DIVERGED,
    STATUS,
)

_SIMULATED_AT_ONCE = 2**20
"""Bytes of simulated batches that a processor's caches hold beside everything else."""


class InBatches(NamedTuple):
    """What plant or belief holds in each run as kernels take it: ``(n, LANES)``, ``(batches, n, LANES)`` of several.

    Attributes:
        constants: From ``CompiledModel.constants``.
        process_noise: Variances per step.
        measurement_noise: Variances per sample.
        first: First state.
    """

    constants: Floats
    process_noise: Floats
    measurement_noise: Floats
    first: Floats

    def of(self, runs: slice) -> InBatches:
        """Return those of some runs, whole batches of them."""
        if self.first.ndim == 2:
            return self
        batches = slice(runs.start // LANES, runs.stop // LANES)
        found = InBatches(*(each[batches] for each in self))
        return found if len(found.first) > 1 else InBatches(*(each[0] for each in found))


class StudyEvaluator:
    """A study ready to evaluate units, from any thread.

    Args:
        study: The study.

    Attributes:
        compiled: Its models, estimators and drives.
        noise: The random numbers of its runs.
        windows: Those in which errors are kept over time.

    Raises:
        UserError, ModelError: If a drive, model or estimator cannot be built.
    """

    def __init__(self, study: Study) -> None:
        self.study, self.compiled, self.noise = study, CompiledStudy(study), RunNoise(study)
        self.windows = ErrorWindows(study, self.compiled)
        self._noisy = NoisyInputs(study.belief) if study.belief.input_noise else None
        self._points: dict[int, NDArray[np.float64]] = {}

    def warm_up(self, index: int) -> str:
        """Compile one kernel (0 is the simulation, then the estimators) and return its name; ``range(kernels)``."""
        short = Unit(0, 0, 0, 0, 1)
        if index == 0:
            self.simulate(short, [Case(0, 0)], samples=3)
            return "simulation"
        batch, belief = (
            self.simulate(short, [Case(0, 0)], samples=3),
            self.parameters(short, [Case(0, 0)], "belief"),
        )
        self.estimate(index - 1, short, [Case(0, 0)], batch, belief)
        return self.study.estimators[index - 1].name

    @property
    def first_scored(self) -> int:
        """First sample that is scored."""
        return round(self.study.score_after / self.study.plant.step)

    @property
    def kernels(self) -> int:
        """Number of kernels that ``warm_up`` compiles."""
        return len(self.loops)

    @property
    def loops(self) -> list[Dispatcher]:
        """The compiled loops over time that ``warm_up`` calls; estimators that differ in settings alone share one."""
        return [self.compiled.simulator.loop, *(e.loop for e in self.compiled.estimators)]

    def time_of_batch(self, unit: Unit) -> float:
        """Return how long the first batch of a unit takes, simulation and all estimators, in s."""
        begin = time.perf_counter()
        group = self.cases(unit)[:LANES]
        batch, believed = self.simulate(unit, group), self.parameters(unit, group, "belief")
        for e in range(len(self.compiled.estimators)):
            self.estimate(e, unit, group, batch, believed, keep=self.windows.count(unit.design, unit.drive) is not None)
        return time.perf_counter() - begin

    def _batches_at_once(self, unit: Unit) -> int:
        """Return how many batches of a unit are simulated before the first is estimated."""
        numbers = len(self.compiled.plant.signal_names) + self.compiled.plant.ny + len(self.study.plant.input_noise)
        return max(1, _SIMULATED_AT_ONCE // (8 * LANES * numbers * len(self.compiled.drives[unit.drive].plant)))

    def cases(self, unit: Unit) -> Cases:
        """Return the runs of a unit."""
        of_unit = range(self.study.designs[unit.design].repeats)[unit.repeats]
        repeats = np.arange(of_unit.start, of_unit.stop)
        return np.stack(np.meshgrid(np.arange(unit.first, unit.stop), repeats, indexing="ij"), axis=-1).reshape(-1, 2)

    def evaluate(self, unit: Unit) -> dict[str, NDArray[np.generic]]:
        """Return the scores of a unit: ``(sample, repeat, estimator[, target])`` by name, SI units."""
        result, windows = self.pending(unit), self.windows.count(unit.design, unit.drive)
        if windows is not None:
            shape = result["rmse"].shape
            result[OVER_TIME] = np.full((*shape, windows), np.nan, dtype=np.float32)
        cases, estimators = self.cases(unit), self.compiled.estimators
        plant, believed = self.parameters(unit, cases, "plant"), self.parameters(unit, cases, "belief")
        held = self.in_batches(self.compiled.plant, unit, plant)
        believes = [self.believes(e, unit, believed) for e in range(len(estimators))]
        words = self.noise.words(unit, cases)
        left, signals = np.empty(len(cases)), len(self.compiled.signals)
        totals = [Sums(np.empty((3, signals, len(cases))), np.empty((10, len(cases)))) for _ in estimators]
        at_once = self._batches_at_once(unit) if windows is None and self._noisy is None else 1
        # Stage by stage, so that one is done with the caches before the next begins.
        for first in range(0, len(cases), LANES * at_once):
            lanes = slice(first, first + LANES * at_once)
            group, believed_there = cases[lanes], believed.of(lanes)
            batch = self.simulate(
                unit, group, plant=plant.of(lanes), believed=believed_there, words=words[lanes], held=held.of(lanes)
            )
            left[lanes] = batch.left_at.reshape(-1)[: len(group)]
            for e, total in enumerate(totals):
                begun = self.begun(e, unit, group, believes[e].of(lanes))
                sums = self.sums(e, unit.drive, begun, batch, believed_there, windows is not None)
                total.errors[..., lanes] = in_a_row(sums.errors, 3)[..., : len(group)]
                total.per_run[:, lanes] = in_a_row(sums.per_run, 2)[:, : len(group)]
                if windows is not None:
                    over_time = self.windows.rmse(batch, estimators[e].scores(sums), windows)
                    flat = result[OVER_TIME].reshape(len(cases), *result[OVER_TIME].shape[2:])
                    flat[lanes, e] = over_time[: len(group)]
        for e, total in enumerate(totals):
            self.enter(result, unit, e, left, estimators[e].scores(total))
        return result

    def pending(self, unit: Unit) -> dict[str, NDArray[np.generic]]:
        """Return the scores of a unit, but for those over time, with nothing entered yet."""
        samples = unit.stop - unit.first
        shape = (samples, unit.runs(self.study) // samples, len(self.compiled.estimators))
        result: dict[str, NDArray[np.generic]] = {
            n: np.full((*shape, len(self.study.targets)), np.nan) for n in PER_TARGET
        }
        result |= {n: np.full(shape, np.nan) for n in PER_RUN}
        result[STATUS] = np.full(shape, PENDING, dtype=np.int8)
        result[LOST_CONTROL] = np.full(shape[:2], np.nan)
        return result

    def parameters(self, unit: Unit, group: Cases, side: Literal["plant", "belief"]) -> RunParameters:
        """Return what plant or belief holds in each run, and in lanes without a run what it holds in the last one."""
        design = self.study.designs[unit.design]
        rows = in_whole_batches(np.asarray(group)[:, 0])
        if unit.design not in self._points:  # two threads that come at once lay out the same
            self._points[unit.design] = points(self.study, design).values
        values = self._points[unit.design][unit.band, rows]
        return run_parameters(getattr(self.study, side), design, side, values)

    def simulate(
        self,
        unit: Unit,
        group: Cases,
        samples: int | None = None,
        plant: RunParameters | None = None,
        believed: RunParameters | None = None,
        words: NDArray[np.uint64] | None = None,
        simulator: Simulator | None = None,
        held: InBatches | None = None,
    ) -> Batch:
        """Simulate runs of a unit, with the noise that belongs to them.

        Up to ``LANES`` runs are one batch. Of more, here as in ``begin`` and ``sums``, every array has an axis of
        batches in front.

        Args:
            unit: The unit.
            group: The runs.
            samples: How many samples of the drive, by default all.
            plant: What the plant holds in each lane, if that is known already.
            believed: What the belief holds in each lane, if that is known already.
            words: What the noise of each lane is drawn from (``RunNoise.words``), if that is known already.
            simulator: Of the plant, with other signals than scores and estimators need.
            held: ``plant`` as kernels take it, if that is known already.
        """
        plant = self.parameters(unit, group, "plant") if plant is None else plant
        simulator = simulator or self.compiled.simulator
        model, inputs = simulator.compiled, self.compiled.drives[unit.drive].plant[:samples]
        words = self.noise.words(unit, group) if words is None else words
        held = self.in_batches(model, unit, plant) if held is None else held
        noise = standard_normal(words, len(inputs), model.nx + model.ny)
        batch = simulator.run(inputs, held.constants, held.process_noise, held.measurement_noise, noise, held.first)
        deviations = np.sqrt(in_batches(plant.input_noise))
        errors = {
            signal: deviations[..., i, None, :] * self.noise.of_input(unit, group, len(inputs), signal)
            for i, signal in enumerate(self.study.plant.input_noise)
        }
        batch = replace(batch, input_errors=errors) if errors else batch
        if not self.study.belief.parameter_states:
            return batch
        return self._with_parameters(batch, plant, believed or self.parameters(unit, group, "belief"))

    def _with_parameters(self, batch: Batch, plant: RunParameters, believed: RunParameters) -> Batch:
        """Add what is true of the parameters that the belief is not sure of."""
        still = in_batches(parameter_truth(self.study.plant, self.study.belief, plant, believed).T)[..., None, :, :]
        shape = (*batch.truth.shape[:-2], *still.shape[-2:])
        return replace(batch, truth=np.concatenate([batch.truth, np.broadcast_to(still, shape)], axis=-2))

    def estimate(
        self, index: int, unit: Unit, group: Cases, batch: Batch, believed: RunParameters, keep: bool = False
    ) -> Scores:
        """Run one estimator over a simulated batch with what the belief holds in each lane, and score it."""
        sums = self.sums(index, unit.drive, self.begin(index, unit, group, believed), batch, believed, keep)
        return self.compiled.estimators[index].scores(sums)

    def sums(
        self, index: int, drive: int, begun: tuple[Belief, State], batch: Batch, believed: RunParameters, keep: bool
    ) -> Sums:
        """Run one estimator from where it has ``begun``, as ``estimate`` does, and return what scores are made of."""
        belief, first = begun
        inputs, uncertain = self.inputs(index, drive, batch, believed)
        return self.compiled.estimators[index].sums(
            inputs,
            self.compiled.measured(batch.measurements),
            batch.truth,
            self.compiled.truth_names,
            batch.left_at,
            belief,
            first,
            keep,
            uncertain,
            self.first_scored,
        )

    def in_batches(self, model: CompiledModel, unit: Unit, held: RunParameters) -> InBatches:
        """Return what a model holds on the drive of a unit as kernels take it."""
        first = first_state(model.model, held.values.T, self.compiled.drives[unit.drive].profile).T
        noise = in_batches(held.process_noise), in_batches(held.measurement_noise)
        return InBatches(model.constants(in_batches(held.values)), *noise, in_batches(first))

    def begin(self, index: int, unit: Unit, group: Cases, believed: RunParameters) -> tuple[Belief, State]:
        """Return what an estimator believes and its first state, with what the belief holds in each lane."""
        return self.begun(index, unit, group, self.believes(index, unit, believed))

    def believes(self, index: int, unit: Unit, believed: RunParameters) -> InBatches:
        """Return what an estimator believes as kernels take it."""
        scaled = scale_noise(believed, self.study.belief, self.study.estimators[index].noise)
        return self.in_batches(self.compiled.belief, unit, scaled)

    def begun(self, index: int, unit: Unit, group: Cases, believed: InBatches) -> tuple[Belief, State]:
        """Return the same of what it believes as kernels take it."""
        estimator, name = self.compiled.estimators[index], self.study.estimators[index].name
        seeds = self.noise.seeds(unit, group, name) if estimator.is_random else None
        belief = estimator.belief(believed.constants, believed.process_noise, believed.measurement_noise)
        variance = self.compiled.first_variance(believed.process_noise)
        return belief, estimator.init(believed.first, variance, seeds)

    def inputs(
        self, index: int, drive: int, batch: Batch, believed: RunParameters
    ) -> tuple[Floats, UncertainInputs | None]:
        """Return the inputs an estimator gets ``(samples, nu, LANES)``, and what it is told of their errors, if any."""
        table = self.compiled.known(drive, batch)
        if self._noisy is None:
            return table, None
        kind = self.study.estimators[index].input_signal or "filtered"
        return self._noisy.known(batch, table, believed.input_noise.T, kind)

    def enter(self, result: dict[str, NDArray[np.generic]], unit: Unit, e: int, left: Floats, scores: Scores) -> None:
        """Write a unit's scores of one estimator; ``left`` is where each run's plant went out of control."""
        targets, runs = len(self.study.targets), result[STATUS].shape[:2]
        for name in PER_TARGET:
            result[name][:, :, e] = getattr(scores, name)[:targets].T.reshape(*runs, targets)
        for name in PER_RUN[:-1]:
            result[name][:, :, e] = getattr(scores, name).reshape(runs)
        length = len(self.compiled.drives[unit.drive].profile.time)
        diverged = scores.diverged_at < length
        lost = ~diverged & (left < length)
        status = np.where(diverged, ESTIMATOR_DIVERGED, np.where(lost, PLANT_DIVERGED, OK))
        first = np.where(diverged | lost, np.where(diverged, scores.diverged_at, left) * self.study.plant.step, np.nan)
        result[STATUS][:, :, e], result["time_of_divergence"][:, :, e] = status.reshape(runs), first.reshape(runs)
        result[LOST_CONTROL][...] = np.where(left < length, left * self.study.plant.step, np.nan).reshape(runs)


def in_batches(rows: Floats) -> Floats:
    """Return numbers of runs ``(runs, n)`` as kernels take them: ``(n, LANES)``, of more ``(batches, n, LANES)``."""
    if len(rows) == LANES:
        return np.ascontiguousarray(rows.T)
    return np.ascontiguousarray(rows.reshape(len(rows) // LANES, LANES, rows.shape[1]).transpose(0, 2, 1))


def in_a_row(values: Floats, dimensions: int) -> Floats:
    """Return numbers of batches ``(..., LANES)``, of so many dimensions each, with all runs behind each other."""
    if values.ndim == dimensions:
        return values
    runs = len(values) * values.shape[-1]
    return values.transpose(*range(1, dimensions), 0, dimensions).reshape(*values.shape[1:-1], runs)
