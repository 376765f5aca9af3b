"""Evaluate units of a study on a graphics card: a thread for each run, many units at once.

The kernels are those of processors (``harness.cuda``), the random numbers as well. Simulated signals stay on the
card; only sums of scores leave it. While it computes, the processor prepares the next units and enters the last ones.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numba.np.random._constants import fi_double, ki_double, wi_double
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import StudySpec
from harness.config.roles import ESTIMATORS
from harness.cuda import compiling, loops
from harness.cuda.kernels import CardKernel, check_card, name_of_card
from harness.cuda.lanes import upper_half as upper_half_on_card
from harness.engine.kernel_names import Belief, State
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import upper_half
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import kernels_of, load_estimator
from harness.runner.contract import Held
from harness.runner.filter_loop import BATCH
from harness.runner.scores import SCORES, Compared, Sums, comparison
from harness.runner.simulation_loop import SIMULATION
from harness.simulation.simulate import largest
from harness.study.compiled_study import in_a_row, parameter_truth
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Cases

DEVICE = "cuda"
"""What estimators that run on a card say in ``DEVICES``."""

check, name, versions = check_card, name_of_card, compiling.versions

SHARE = 0.5
"""Share of the card's free memory that signals of simulated runs may take."""

MOST = 2**17
"""Runs at a time: beyond what a card computes side by side more do not make it faster."""


def compared() -> list[str]:
    """Return the estimators whose scores on a card were compared with the processor's (docs/gpu.md)."""
    return [kind for kind in ESTIMATORS.names() if DEVICE in load_estimator(kind).DEVICES]


class UnitRuns(NamedTuple):
    """A unit, its runs, and what plant and belief hold in each."""

    unit: Unit
    cases: Cases
    plant: Held
    believed: Held


class Loaded(NamedTuple):
    """What a card is told of the plants of runs.

    Attributes:
        words: From ``RunNoise.words`` ``(runs, 1 + words)``.
        constants, process_noise, measurement_noise, first: What the plants hold, each ``(n, runs)``; variances.
        parameters: From ``parameter_truth`` ``(names, runs)``.
    """

    words: NDArray[np.uint64]
    constants: Floats
    process_noise: Floats
    measurement_noise: Floats
    first: Floats
    parameters: Floats


class Simulated(NamedTuple):
    """Simulated runs on a card: inputs, truth and measurements ``(samples, n, runs)``, where each left its range.

    Inputs that all runs have in common are ``(samples, nu, 1)``.
    """

    inputs: Any
    truth: Any
    measured: Any
    left_at: Any


class Begun(NamedTuple):
    """What an estimator believes and begins with, each ``(..., runs)``; the memory has room for two steps behind it."""

    belief: Belief
    first: State


class Prepared(NamedTuple):
    """Units of one drive that are computed at once, with what a card is told of their plants and by each estimator."""

    drive: int
    parts: Sequence[UnitRuns]
    loaded: Loaded
    begun: Sequence[Begun]


class Computed(NamedTuple):
    """What comes back of them: where each run left its range, and the sums of each estimator."""

    left_at: Floats
    sums: Sequence[Sums]


Scored = tuple[Unit, dict[str, NDArray[np.generic]]]
"""A unit with its scores as ``StudyEvaluator.evaluate`` gives them."""


class CardEvaluator:
    """A study ready to evaluate units on a card.

    Args:
        evaluator: The study on the processor.

    Raises:
        UserError: If there is no card, or the study asks for something that is computed on a processor only.
        ModelError: If an estimator uses what no card can have.
    """

    def __init__(self, evaluator: StudyEvaluator) -> None:
        check_card()
        self._evaluator, study = evaluator, evaluator.study
        compiled = evaluator.compiled
        unknown = [each for each in study.estimators if DEVICE not in load_estimator(each.kind).DEVICES]
        if unknown:
            raise UserError(
                f"{study.path}: estimator '{unknown[0].name}': nobody has compared '{unknown[0].kind}' on a card with "
                f"the processor; a card runs {', '.join(compared())} (docs/gpu.md)"
            )
        if study.belief.input_noise or study.plant.input_noise:
            raise UserError(f"{study.path}: inputs with noise are computed on the processor only; leave out '--device'")
        if study.plant.model().degradations:
            raise UserError(f"{study.path}: degraded sensors are computed on the processor only; leave out '--device'")
        self._draw = CardKernel("noise", loops.draw_noise, None, {upper_half: upper_half_on_card})
        self.simulate_kernel = CardKernel("simulate", loops.simulate_runs, compiled.plant, SIMULATION)
        self._copy, self._hold = (CardKernel(f.__name__, f) for f in (loops.copy_row, loops.hold_row))
        of_kind = {
            kind: CardKernel(
                f"estimate_{kind}",
                loops.estimate_runs,
                compiled.belief,
                kernels_of(load_estimator(kind), compiled.belief.model) | BATCH | SCORES,
            )
            for kind in dict.fromkeys(each.kind for each in study.estimators)
        }
        self.estimate_kernels = [of_kind[each.kind] for each in study.estimators]
        self._layers = [cuda.to_device(np.asarray(table)) for table in (wi_double, ki_double, fi_double)]

    def evaluate(self, units: Sequence[Unit]) -> Iterator[Scored]:
        """Evaluate units; give each with its scores, in any order."""
        units = yield from self._over_time(units)
        batches = list(self._batches(units))
        card = ThreadPoolExecutor(1)  # it waits for the card, without the lock that this thread needs
        computing: tuple[Prepared, Future[Computed]] | None = None
        try:
            for drive, batch in batches:
                prepared = self._prepared(drive, batch)
                following = prepared, card.submit(self._computed, prepared)
                if computing is not None:
                    yield from self._entered(*computing)
                computing = following
            if computing is not None:
                yield from self._entered(*computing)
        finally:
            card.shutdown(cancel_futures=True)

    def _batches(self, units: Sequence[Unit]) -> Iterator[tuple[int, list[Unit]]]:
        """Return the units that are computed together, and their drive."""
        study = self._evaluator.study
        for drive in sorted({unit.drive for unit in units}):
            batch: list[Unit] = []
            room = free = self._runs_at_once(drive)
            for unit in (u for u in units if u.drive == drive):
                runs = -(-unit.runs(study) // LANES) * LANES
                if batch and runs > free:
                    yield drive, batch
                    batch, free = [], room
                batch.append(unit)
                free -= runs
            yield drive, batch

    def _over_time(self, units: Sequence[Unit]) -> Generator[Scored, None, Sequence[Unit]]:
        """Evaluate those whose errors are kept over time, which the processor does; return the others."""
        evaluator, others = self._evaluator, []
        for unit in units:
            if evaluator.windows.count(unit.design, unit.drive) is None:
                others.append(unit)
            else:
                yield unit, evaluator.evaluate(unit)
        return others

    @property
    def study(self) -> StudySpec:
        """The study."""
        return self._evaluator.study

    @property
    def loops(self) -> list[Any]:
        """The kernels that ``warm_up`` compiles; estimators that differ in settings alone share one."""
        return [each.function for each in (self.simulate_kernel, *self.estimate_kernels)]

    @property
    def kernels(self) -> int:
        """Number of kernels that ``warm_up`` compiles."""
        return len(self.loops)

    def warm_up(self, index: int) -> str:
        """Compile one kernel (0 is the simulation, then the estimators) and return its name; ``range(kernels)``."""
        part = self.part(Unit(0, 0, 0, 0, 1))
        if index == 0:
            self.simulate(0, self.loaded([part]), samples=3)
            return "simulation"
        e, (truth, measured, left_at) = index - 1, self._room(3, part.plant.first.shape[-1])
        self.sums(e, self.estimate(e, self._simulated(0, truth, measured, left_at), self.believed(e, [part])))
        return self.study.estimators[e].name

    def _runs_at_once(self, drive: int) -> int:
        """Return how many runs of a drive are on the card at a time."""
        compiled = self._evaluator.compiled
        plant, samples = compiled.plant, len(compiled.drives[drive].plant)
        rows = plant.nx + 2 * plant.ny + len(compiled.truth_names) + compiled.belief.ny
        rows += compiled.belief.nu if compiled.supplied else 0
        free, _ = cuda.current_context().get_memory_info()
        return int(min(MOST, max(1, SHARE * free // (8 * samples * rows))))

    def part(self, unit: Unit) -> UnitRuns:
        """Return a unit with what its runs hold."""
        evaluator = self._evaluator
        cases = evaluator.cases(unit)
        return UnitRuns(unit, cases, evaluator.held(unit, cases, "plant"), evaluator.held(unit, cases, "belief"))

    def _prepared(self, drive: int, units: Sequence[Unit]) -> Prepared:
        """Return what a card needs to evaluate units of one drive at once."""
        parts = [self.part(unit) for unit in units]
        begun = [self.believed(e, parts) for e in range(len(self.estimate_kernels))]
        return Prepared(drive, parts, self.loaded(parts), begun)

    def _computed(self, prepared: Prepared) -> Computed:
        """Simulate and estimate on the card, and wait for it."""
        simulated = self.simulate(prepared.drive, prepared.loaded)
        sums = [self.sums(e, self.estimate(e, simulated, begun)) for e, begun in enumerate(prepared.begun)]
        return Computed(simulated.left_at.copy_to_host().reshape(-1), sums)

    def _entered(self, prepared: Prepared, computing: Future[Computed]) -> Iterator[Scored]:
        """Wait for the card; give each unit with its scores."""
        evaluator, (left_at, sums) = self._evaluator, computing.result()
        start = 0
        for part in prepared.parts:
            result, own = evaluator.pending(part.unit), slice(start, start + len(part.cases))
            for e, totals in enumerate(sums):
                scores = Sums(totals.errors[..., own], totals.per_run[:, own], totals.stated).scores()
                evaluator.enter(result, part.unit, e, left_at[own], scores)
            start += -(-len(part.cases) // LANES) * LANES
            yield part.unit, result

    def loaded(self, parts: Sequence[UnitRuns]) -> Loaded:
        """Return what a card is told of the plants of some units."""
        study, noise = self._evaluator.study, self._evaluator.noise
        words = [noise.words(part.unit, part.cases) for part in parts]
        widest = max(each.shape[1] for each in words)
        padded = [np.pad(each, ((0, 0), (0, widest - each.shape[1]))) for each in words]
        wanted = bool(study.belief.parameter_states)  # run by run, so not where nothing is wanted
        still = [
            parameter_truth(study.plant, study.belief, part.plant, part.believed)
            if wanted
            else np.empty((0, in_a_row(part.plant.values, 2).shape[1]))
            for part in parts
        ]
        plants = [part.plant for part in parts]
        return Loaded(
            np.concatenate(padded),
            in_rows([self._evaluator.compiled.plant.constants(each.values) for each in plants]),
            in_rows([each.process_noise for each in plants]),
            in_rows([each.measurement_noise for each in plants]),
            in_rows([each.first for each in plants]),
            np.ascontiguousarray(np.concatenate(still, axis=1)),
        )

    def simulate(self, drive: int, loaded: Loaded, samples: int | None = None) -> Simulated:
        """Simulate runs of a drive, all samples by default."""
        compiled, runs = self._evaluator.compiled, len(loaded.words)
        plant = compiled.plant
        inputs = _sent(compiled.drives[drive].plant[:samples, :, :1])
        samples, own = inputs.shape[0], len(plant.signal_names)
        noise = cuda.device_array((samples, plant.nx + plant.ny, runs))
        self._draw(runs, _sent(loaded.words), *self._layers, noise)
        truth, measured, left_at = self._room(samples, runs)
        self.simulate_kernel(
            runs, inputs, inputs, _sent(loaded.constants), _sent(np.sqrt(loaded.process_noise)),
            _sent(np.sqrt(loaded.measurement_noise)), _sent(plant.model.limits), _sent(largest(compiled.recorded)),
            _sent(loaded.first), noise, truth, measured, left_at,
        )  # fmt: skip
        if len(loaded.parameters):
            values = _sent(loaded.parameters)
            for i in range(len(loaded.parameters)):
                self._hold(runs, values, i, truth, own + i)
        return self._simulated(drive, truth, measured, left_at)

    def _room(self, samples: int, runs: int) -> tuple[Any, Any, Any]:
        """Return arrays on the card for what is simulated: truth, measurements, where each run left its range."""
        rows = max(1, len(self._evaluator.compiled.truth_names)), max(1, self._evaluator.compiled.plant.ny)
        truth, measured = (cuda.device_array((samples, n, runs)) for n in rows)
        return truth, measured, cuda.device_array((1, runs))

    def _simulated(self, drive: int, truth: Any, measured: Any, left_at: Any) -> Simulated:
        """Return what estimators take of the signals of a plant."""
        runs = truth.shape[2]
        return Simulated(self._known(drive, truth, measured, runs), truth, self._measured(measured, runs), left_at)

    def _known(self, drive: int, truth: Any, measured: Any, runs: int) -> Any:
        """Return the belief's inputs on the card, those that the plant supplies filled in."""
        compiled = self._evaluator.compiled
        table = compiled.drives[drive].belief[: truth.shape[0], :, :1]
        if not compiled.supplied:
            return _sent(table)
        inputs = _sent(np.repeat(table, runs, axis=-1))
        outputs = list(compiled.plant.model.outputs)
        for name in compiled.supplied:
            place = compiled.belief.model.inputs.index(name)
            if name in outputs:
                self._copy(runs, measured, outputs.index(name), inputs, place)
            else:
                self._copy(runs, truth, compiled.plant.signal_names.index(name), inputs, place)
        return inputs

    def _measured(self, measured: Any, runs: int) -> Any:
        """Return the measurements that the belief has outputs for, on the card."""
        places = self._evaluator.compiled.measured_rows
        if places == list(range(measured.shape[1])):
            return measured
        chosen = cuda.device_array((measured.shape[0], max(1, len(places)), runs))
        for i, place in enumerate(places):
            self._copy(runs, measured, place, chosen, i)
        return chosen

    def believed(self, e: int, parts: Sequence[UnitRuns]) -> Begun:
        """Return what an estimator believes in the runs of some units and what it begins with."""
        evaluator, estimator = self._evaluator, self._estimator(e)
        held = (evaluator.believed_by(e, part.unit, part.cases, part.believed) for part in parts)
        beliefs, first = zip(*(estimator.begin(each) for each in held), strict=True)
        carried = in_rows([state.memory for state in first])
        memory = np.zeros((3, max(1, len(carried)), carried.shape[-1]))
        memory[0, : len(carried)] = carried
        belief = Belief(
            in_rows([each.constants for each in beliefs]),
            in_rows([each.process_noise for each in beliefs]),
            in_rows([each.measurement_noise for each in beliefs]),
            estimator.tuning,
        )
        mean, covariance = in_rows([state.mean for state in first]), in_rows([state.covariance for state in first], 3)
        return Begun(belief, State(mean, covariance, memory))

    def _estimator(self, e: int) -> CompiledEstimator:
        estimator = self._evaluator.compiled.estimators[e]
        assert isinstance(estimator, CompiledEstimator)
        return estimator

    def _compared(self, e: int) -> Compared:
        evaluator = self._evaluator
        return comparison(self._estimator(e), evaluator.compiled.truth_names, evaluator.first_scored)

    def estimate(self, e: int, simulated: Simulated, begun: Begun) -> tuple[Any, Any]:
        """Run an estimator; return the sums of ``Sums`` on the card."""
        estimator, (belief, first) = self._estimator(e), begun
        rows, turns, _, options, bounds = self._compared(e)
        runs, priors = first.mean.shape[-1], np.concatenate([np.zeros((1, 2)), estimator.priors])
        errors = cuda.device_array((3, len(estimator.signals), runs))
        per_run = cuda.device_array((10, runs))
        self.estimate_kernels[e](
            runs, simulated.inputs, simulated.measured, simulated.truth, _sent(rows), _sent(turns),
            simulated.left_at,
            *map(_sent, belief[:4]), _sent(priors), *map(_sent, first),
            _sent(estimator.limits), _sent(options), _sent(bounds), errors, per_run,
        )  # fmt: skip
        return errors, per_run

    def sums(self, e: int, on_card: tuple[Any, Any]) -> Sums:
        """Return sums that lie on the card."""
        errors, per_run = (each.copy_to_host() for each in on_card)
        if (without := self._compared(e).without) is not None:
            errors[:, without] = np.nan
        return Sums(errors, per_run, self._estimator(e).has_covariance)


def _sent(array: NDArray[np.generic]) -> Any:
    """Return an array on the card; one of no length, which a card does not take, with one row of zeros."""
    if array.size == 0:
        array = np.zeros([max(1, n) for n in array.shape], array.dtype)
    return cuda.to_device(np.ascontiguousarray(array))


def in_rows(parts: Sequence[Floats], dimensions: int = 2) -> Floats:
    """Return numbers of batches of several units, each ``(..., LANES)``, with all runs behind each other."""
    return np.ascontiguousarray(np.concatenate([in_a_row(part, dimensions) for part in parts], axis=-1))


evaluator = CardEvaluator
