"""Evaluate a unit of a study: simulate its runs, let every estimator see the same ones, return the scores."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.config import HistorySpec, ModelSpec, Study
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.kernel_names import Belief, State
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import Estimator, Scores
from harness.models.assembly.assemble import Model
from harness.models.contracts import DRIVE_INPUTS, Profile
from harness.simulation.drives import profile_of
from harness.simulation.simulate import Batch, Simulator, first_state, in_lanes, input_table
from harness.study.design import Lanes, Unit, lanes, points, scale_noise
from harness.study.scores import (
    ESTIMATOR_DIVERGED,
    OK,
    OVER_TIME,
    PENDING,
    PER_RUN,
    PER_TARGET,
    PLANT_DIVERGED,
)


class Case(NamedTuple):
    """One run of a unit: its Sobol point and its repeat."""

    sample: int
    repeat: int


@dataclass(frozen=True)
class Road:
    """A drive ready to run.

    Attributes:
        profile: Inputs over time.
        plant_inputs: As the plant reads them, ``(samples, nu, LANES)``.
        belief_inputs: What the estimators know, ``(samples, nu, LANES)``; NaN for what the plant supplies.
    """

    profile: Profile
    plant_inputs: Floats
    belief_inputs: Floats


class Bench:
    """A study with everything compiled and every drive built, ready to evaluate units from any thread.

    Args:
        study: The study.

    Raises:
        UserError, ModelError: If a drive, model or estimator cannot be built.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        belief_model, plant_model = study.belief.model(), study.plant.model()
        drawn = [name for history in study.history for name in history.signals]
        self.signals = tuple(dict.fromkeys([*study.targets, *study.belief.unknown_inputs, *drawn]))  # scored first
        known = {*plant_model.states, *plant_model.inputs, *plant_model.ports}
        self.supplied = supplied_inputs(plant_model, belief_model)
        states = (s for s in belief_model.states if s in known)
        exact = (name for name in self.supplied if name not in plant_model.outputs)
        watched = tuple(dict.fromkeys([*states, *exact, *(s for s in self.signals if s in known)]))
        self.roads = [self._road(i) for i in range(len(study.drives))]
        self.plant = _compile(study.plant, watched)
        self.belief = _compile(study.belief, self.signals)
        self.simulator = Simulator(self.plant)
        self._measured = [list(plant_model.outputs).index(name) for name in belief_model.outputs]
        self.estimators = [Estimator(e.kind, self.belief, e.settings, e.base) for e in study.estimators]
        self._points = [points(study, d).values for d in study.designs]

    def _road(self, index: int) -> Road:
        study, drive = self.study, self.study.drives[index]
        profile = profile_of(study.plant, drive)
        plant, belief = study.plant.model(), study.belief.model()
        tables = (
            input_table(profile, plant.inputs, plant.rates),
            input_table(profile, belief.inputs, belief.rates, self.supplied),
        )
        return Road(profile, *(in_lanes(table) for table in tables))

    def warm_up(self, index: int) -> str:
        """Compile one kernel (0 is the simulation, then the estimators) and return its name; ``range(kernels)``."""
        short = Unit(0, 0, 0, 0, 1)
        if index == 0:
            self.simulate(short, [Case(0, 0)], samples=3)
            return "simulation"
        batch, belief = (
            self.simulate(short, [Case(0, 0)], samples=3),
            self.held(short, [Case(0, 0)], "belief"),
        )
        self.estimate(index - 1, short, [Case(0, 0)], batch, belief)
        return self.study.estimators[index - 1].name

    @property
    def kernels(self) -> int:
        """Number of kernels that ``warm_up`` compiles."""
        return 1 + len(self.estimators)

    def evaluate(self, unit: Unit) -> dict[str, NDArray[np.generic]]:
        """Return the scores of a unit: ``(sample, repeat, estimator[, target])`` by name, SI units."""
        design = self.study.designs[unit.design]
        shape = (unit.stop - unit.first, design.repeats, len(self.estimators))
        result: dict[str, NDArray[np.generic]] = {
            n: np.full((*shape, len(self.study.targets)), np.nan) for n in PER_TARGET
        }
        result |= {n: np.full(shape, np.nan) for n in PER_RUN}
        result["status"] = np.full(shape, PENDING, dtype=np.int8)
        windows = self.windows(unit.design, unit.drive)
        if windows is not None:
            result[OVER_TIME] = np.full((*shape, len(self.study.targets), windows), np.nan, dtype=np.float32)
        cases = [Case(s, r) for s in range(unit.first, unit.stop) for r in range(design.repeats)]
        for start in range(0, len(cases), LANES):
            group = cases[start : start + LANES]
            batch, belief = self.simulate(unit, group), self.held(unit, group, "belief")
            for e in range(len(self.estimators)):
                scores = self.estimate(e, unit, group, batch, belief, keep=windows is not None)
                self._enter(result, unit, group, e, batch, scores)
        return result

    def windows(self, design: int, drive: int) -> int | None:
        """Return the number of windows in which errors are kept over time; ``None`` where nobody asked for them."""
        wanted = self.study.over_time
        if wanted is None or (self.study.designs[design].name, self.study.drives[drive].name) != (
            wanted.design,
            wanted.drive,
        ):
            return None
        return max(1, len(self.roads[drive].profile.time) // self._window)

    @property
    def _window(self) -> int:
        """Samples of a window."""
        assert self.study.over_time is not None
        return max(1, round(self.study.over_time.window / self.study.plant.step))

    def _over_time(self, batch: Batch, scores: Scores, windows: int) -> NDArray[np.float32]:
        """Return the RMSE of each target by window ``(LANES, targets, windows)``; NaN from a divergence on."""
        assert scores.kept is not None
        targets = self.study.targets
        truth = batch.truth[:, [self.plant.signal_names.index(name) for name in targets]]
        error = scores.kept[:, 0, : len(targets)] - truth
        ended = np.arange(len(error))[:, None] >= np.minimum(scores.diverged_at, batch.left_at)
        error = np.where(ended[:, None], np.nan, error)[: windows * self._window]
        squares = np.square(error).reshape(windows, -1, *error.shape[1:])
        return np.sqrt(squares.mean(axis=1)).transpose(2, 1, 0).astype(np.float32)

    def histories(self) -> list[xr.Dataset]:
        """Return the runs the study wants drawn over time.

        Where the plant lacks a signal its truth is NaN; so is an estimate from its divergence on, and everything from
        where the plant leaves its range.
        """
        return [self._history(wanted) for wanted in self.study.history]

    def _history(self, wanted: HistorySpec) -> xr.Dataset:
        study = self.study
        names = [d.name for d in study.drives]
        design = next(i for i, d in enumerate(study.designs) if d.name == wanted.design)
        unit = Unit(design, wanted.band, names.index(wanted.drive), wanted.sample, wanted.sample + 1)
        case = [Case(wanted.sample, wanted.repeat)]
        batch, held = self.simulate(unit, case), self.held(unit, case, "belief")
        road = self.roads[unit.drive]
        runs = [self.estimate(e, unit, case, batch, held, keep=True) for e in range(len(self.estimators))]
        shown = list(dict.fromkeys([*study.targets, *study.belief.unknown_inputs, *wanted.signals]))
        truth = np.full((len(batch.truth), len(shown)), np.nan)
        for i, name in enumerate(shown):
            if name in self.plant.signal_names:
                truth[:, i] = batch.truth[:, self.plant.signal_names.index(name), 0]
        places = [self.signals.index(name) for name in shown]
        kept = np.stack([r.kept[:, :, places, 0] for r in runs if r.kept is not None], axis=1)
        sample = np.arange(len(kept))[:, None]
        left = sample[:, 0] >= batch.left_at[0]
        kept[(sample >= [r.diverged_at[0] for r in runs]) | left[:, None]] = np.nan
        truth[left] = np.nan
        dataset = xr.Dataset(
            {
                "truth": (("time", "target"), truth),
                "estimate": (("time", "estimator", "target"), kept[:, :, 0]),
                "std": (("time", "estimator", "target"), kept[:, :, 1]),
            },
            coords={
                "time": road.profile.time,
                "estimator": [e.name for e in study.estimators],
                "target": shown,
            },
        )
        for output, measured, variance in zip(
            self.belief.model.outputs, self._measured, held.measurement_noise[0], strict=True
        ):
            if output in shown:  # sensors name an output after what it measures
                values = np.where(left, np.nan, batch.measurements[:, measured, 0])
                dataset[f"measured_{output}"] = ("time", values, {"variance": variance})
        stated = [e.has_covariance for e in self.estimators]
        dataset["std"] = dataset["std"].where(xr.DataArray(stated, dims="estimator"))
        for i, name in enumerate(self.plant.model.inputs):
            dataset[f"input_{name}"] = ("time", road.plant_inputs[:, i, 0])
        rmse = {
            e.name: {t: float(r.rmse[i, 0]) for i, t in enumerate(study.targets)}
            for e, r in zip(study.estimators, runs, strict=True)
        }
        dataset.attrs = {
            "name": wanted.name,
            "design": wanted.design,
            "band_label": study.designs[design].band_labels[wanted.band],
            "drive": wanted.drive,
            "repeat": wanted.repeat,
            "rmse": rmse,
        }
        return dataset

    def held(self, unit: Unit, group: list[Case], side: str) -> Lanes:
        """Return what plant or belief holds in each lane; lanes without a run repeat the last one."""
        design = self.study.designs[unit.design]
        rows = [c.sample for c in group] + [group[-1].sample] * (LANES - len(group))
        values = self._points[unit.design][unit.band, rows]
        if side == "plant":
            return lanes(self.study.plant, design, "plant", values)
        return lanes(self.study.belief, design, "belief", values)

    def simulate(self, unit: Unit, group: list[Case], samples: int | None = None) -> Batch:
        """Simulate up to ``LANES`` runs of a unit, with the noise that belongs to them; all samples by default."""
        plant, inputs = self.held(unit, group, "plant"), self.roads[unit.drive].plant_inputs[:samples]
        width = self.plant.nx + self.plant.ny
        noise = np.empty((len(inputs), width, LANES))
        keys = [self._noise_key(unit, case) for case in group]
        for lane, key in enumerate(keys):
            if lane and key == keys[lane - 1]:
                noise[:, :, lane] = noise[:, :, lane - 1]
                continue
            rng = np.random.default_rng(np.random.SeedSequence(self.study.seed, spawn_key=key))
            noise[:, :, lane] = rng.standard_normal((len(inputs), width))
        noise[:, :, len(group) :] = noise[:, :, len(group) - 1 : len(group)]
        return self.simulator.run(
            inputs,
            self.plant.constants(plant.values.T),
            np.ascontiguousarray(plant.process_noise.T),
            np.ascontiguousarray(plant.measurement_noise.T),
            noise,
            first_state(self.plant.model, plant.values.T, self.roads[unit.drive].profile),
        )

    def _noise_key(self, unit: Unit, case: Case) -> tuple[int, int, int]:
        """Return what a run's noise depends on: not the band, as levels share it, and in some designs not the point."""
        common = self.study.designs[unit.design].common_noise
        return unit.drive, 0 if common else case.sample, case.repeat

    def _seeds(self, unit: Unit, group: list[Case], estimator: str) -> list[np.random.SeedSequence]:
        """Return the seed of an estimator in each lane; it depends on its name, not on its place in the study."""
        tag = zlib.crc32(estimator.encode())
        keys = [(*self._noise_key(unit, c), tag) for c in group]
        keys += keys[-1:] * (LANES - len(group))
        return [np.random.SeedSequence(self.study.seed, spawn_key=key) for key in keys]

    def estimate(
        self, index: int, unit: Unit, group: list[Case], batch: Batch, held: Lanes, keep: bool = False
    ) -> Scores:
        """Run one estimator over a simulated batch with what the belief holds in each lane, and score it."""
        belief, first = self.begin(index, unit, group, held)
        inputs, measurements = self.seen(unit.drive, batch)
        return self.estimators[index].run(
            inputs,
            measurements,
            batch.truth,
            self.plant.signal_names,
            batch.left_at,
            belief,
            first,
            keep,
        )

    def begin(self, index: int, unit: Unit, group: list[Case], held: Lanes) -> tuple[Belief, State]:
        """Return what an estimator believes and its first state, for what the belief holds in each lane."""
        estimator = self.estimators[index]
        held = scale_noise(held, self.study.belief, self.study.estimators[index].noise)
        process = np.ascontiguousarray(held.process_noise.T)
        belief = estimator.belief(
            self.belief.constants(held.values.T), process, np.ascontiguousarray(held.measurement_noise.T)
        )
        mean = first_state(self.belief.model, held.values.T, self.roads[unit.drive].profile)
        seeds = self._seeds(unit, group, self.study.estimators[index].name)
        return belief, estimator.init(mean, self._first_variance(process), seeds)

    def seen(self, drive: int, batch: Batch) -> tuple[Floats, Floats]:
        """Return what an estimator sees of a simulated batch: inputs ``(samples, nu, LANES)`` and measurements."""
        measurements = batch.measurements
        if self._measured != list(range(self.plant.ny)):
            measurements = np.ascontiguousarray(measurements[:, self._measured])
        return self._known(self.roads[drive], batch), measurements

    def _first_variance(self, process: Floats) -> Floats:
        """Return the first covariance ``(nx, LANES)``: the process noise (Ziaukas 2023, 5.1 and 6.1) if not stated."""
        first = process.copy()
        for state, variance in self.belief.model.start_variance.items():
            first[self.belief.model.states.index(state)] = variance
        return first

    def _known(self, road: Road, batch: Batch) -> Floats:
        """Return the belief's inputs ``(samples, nu, LANES)``, those that the plant supplies filled in."""
        inputs = road.belief_inputs[: len(batch.truth)]
        if not self.supplied:
            return inputs
        inputs = inputs.copy()
        outputs = list(self.plant.model.outputs)
        for name in self.supplied:
            column = self.belief.model.inputs.index(name)
            if name in outputs:
                inputs[:, column] = batch.measurements[:, outputs.index(name)]
            else:
                inputs[:, column] = batch.truth[:, self.plant.signal_names.index(name)]
        return inputs

    def _enter(
        self,
        result: dict[str, NDArray[np.generic]],
        unit: Unit,
        group: list[Case],
        e: int,
        batch: Batch,
        scores: Scores,
    ) -> None:
        """Write a batch's scores of one estimator into the unit's arrays."""
        count, targets = len(group), len(self.study.targets)
        at = (np.array([c.sample for c in group]) - unit.first, np.array([c.repeat for c in group]), e)
        for name in PER_TARGET:
            result[name][at] = getattr(scores, name)[:targets, :count].T
        if OVER_TIME in result:
            windows = result[OVER_TIME].shape[-1]
            result[OVER_TIME][at] = self._over_time(batch, scores, windows)[:count]
        for name in PER_RUN[:-1]:
            result[name][at] = getattr(scores, name)[:count]
        samples = len(batch.truth)
        diverged = scores.diverged_at[:count] < samples
        left = ~diverged & (batch.left_at[:count] < samples)
        first = np.where(diverged, scores.diverged_at[:count], batch.left_at[:count])
        result["status"][at] = np.where(diverged, ESTIMATOR_DIVERGED, np.where(left, PLANT_DIVERGED, OK))
        result["time_of_divergence"][at] = np.where(diverged | left, first * self.study.plant.step, np.nan)


def supplied_inputs(plant: Model, belief: Model) -> tuple[str, ...]:
    """Return the inputs of the belief that are no input of a drive but come from the vehicle itself.

    They are what its sensors measure, noise included, or where no sensor does, the plant's exact state or port.
    """
    driven = {*plant.inputs, *belief.rates, *DRIVE_INPUTS, "time"}
    return tuple(name for name in belief.inputs if name not in driven)


def _compile(spec: ModelSpec, signals: tuple[str, ...]) -> CompiledModel:
    return compile_model(spec.model(), spec.step, spec.integrator, spec.substeps, signals)
