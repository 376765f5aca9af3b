"""A study ready to run: its models and estimators compiled, its drives built, and what its runs are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import ModelError, UserError, placed
from harness.config import NOISE_SCALES, DesignSpec, ModelSpec, StudySpec
from harness.config.bounds import loading
from harness.config.derived import settled
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.filters import estimator_of
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.assembly.parameter_states import true_states
from harness.models.contracts import DRIVE_INPUTS, Profile
from harness.models.drives._shapes import lateral_acceleration
from harness.models.quantities import listed
from harness.runner.contract import Batch, Filter, Held, Signals, Simulator
from harness.runner.scores import Scores
from harness.runner.simulation_loop import LARGEST
from harness.simulation.drives import context_of, profile_of
from harness.simulation.external_plant import ExternalPlant
from harness.simulation.simulate import CompiledSimulator, first_state, in_lanes, input_table


def signals_of(study: StudySpec) -> tuple[str, ...]:
    """Return what the estimators tell of: targets first, then unknown inputs and what is drawn over time."""
    drawn = [name for history in study.history for name in history.signals]
    unknown = (*study.belief.unknown_inputs, *study.belief.estimated_parameters)
    return tuple(dict.fromkeys([*study.targets, *unknown, *drawn]))  # scored first


def truth_names(belief: ModelSpec) -> tuple[str, ...]:
    """Return what ``parameter_truth`` gives: states of parameters, then parameters and what follows from them."""
    model = belief.model()
    return (*model.within, *model.estimated)


def parameter_truth(plant: ModelSpec, belief: ModelSpec, driven: Held, believed: Held) -> Floats:
    """Return the plant's parameters as the belief has them among its states, ``(len(truth_names), runs)``.

    NaN where the plant has no such parameter.
    """
    names = truth_names(belief)
    rows = [in_a_row(held.values, 2).T for held in (driven, believed)]
    truth = np.full((len(names), len(rows[0])), np.nan)
    for run, (true, held) in enumerate(zip(*rows, strict=True)):
        of_plant, of_belief = _all(plant, true), _all(belief, held)
        values = of_plant | true_states(belief.parameter_states, of_plant, of_belief)
        truth[:, run] = [values.get(name, np.nan) for name in names]
    return truth


def held_by(
    spec: ModelSpec, design: DesignSpec, side: Literal["plant", "belief"], values: Floats, profile: Profile
) -> Held:
    """Return what a model holds at given points of a design.

    Args:
        spec: ``study.plant`` or ``study.belief``.
        design: The design the points belong to.
        side: Which of the two ``spec`` is.
        values: Points of the design, shape ``(run, factor)``, e.g. ``points.values[band, samples]``; whole batches.
        profile: The drive, which says where states start.
    """
    model, runs = spec.model(), len(values)
    names = model.parameter_names
    parameters = np.tile([spec.values[n] for n in names], (runs, 1)).reshape(runs, len(names))
    process = np.tile([spec.process_noise[s] for s in model.states], (runs, 1))
    measurement = np.tile([spec.measurement_noise[o] for o in model.outputs], (runs, 1))
    inputs = np.tile(list(spec.input_noise.values()), (runs, 1))
    scaled = dict(zip(NOISE_SCALES, (process, measurement, inputs), strict=True))
    varied: dict[str, Floats] = {}
    for column, factor in enumerate(design.factors):
        if factor.of not in (side, "both"):
            continue
        if factor.parameter in scaled:
            scaled[factor.parameter] *= values[:, column, None]
        else:
            varied[factor.parameter] = values[:, column]
    for name, changed in settled(spec, varied).items():
        parameters[:, names.index(name)] = changed
    first = first_state(model, parameters.T, profile).T
    parts = (in_batches(rows) for rows in (parameters, process, measurement, first, inputs))
    values_, process_, measurement_, first_, inputs_ = parts
    return Held(values_, process_, measurement_, first_, input_noise=inputs_)


def scale_noise(believed: Held, belief: ModelSpec, factors: Mapping[str, float]) -> Held:
    """Return what one estimator believes after tuning: variances multiplied by the factor of their group.

    Args:
        believed: What the belief holds.
        belief: The belief; its unknown inputs are a group of their own.
        factors: By ``NOISE_GROUPS``; a group that is absent stays as it is.
    """
    if not factors:
        return believed
    groups = ["unknown_inputs" if s in belief.unknown_inputs else "process" for s in belief.model().states]
    return replace(
        believed,
        process_noise=believed.process_noise * np.array([factors.get(group, 1.0) for group in groups])[:, None],
        measurement_noise=believed.measurement_noise * factors.get("measurement", 1.0),
    )


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


def _all(spec: ModelSpec, row: Floats) -> dict[str, float]:
    """Return parameters and, where there is one, the load that belongs to them."""
    values = dict(zip(spec.model().parameter_names, map(float, row), strict=True))
    try:
        return values | loading(spec.vehicle, values)
    except ModelError:  # lighter than without a load
        return values


@dataclass(frozen=True)
class DriveInputs:
    """A drive ready to run.

    Attributes:
        profile: Inputs over time.
        plant: As the plant reads them, ``(samples, nu, LANES)``.
        belief: What the estimators know, ``(samples, nu, LANES)``; NaN for what the plant supplies.
    """

    profile: Profile
    plant: Floats
    belief: Floats


class CompiledStudy:
    """The models, estimators and drives of a study.

    Args:
        study: The study.
        simulator: What runs in place of the compiled plant.
        filters: What runs in place of compiled estimators, by their names in the study.

    Attributes:
        signals: What the estimators tell of: targets first, then unknown inputs and what is drawn over time.
        supplied: Inputs of the belief that come from the vehicle itself, see ``supplied_inputs``.
        drives: In the order of the study.
        watched: Signals of the plant that scores and estimators need, and its slip angles.
        truth_names: What is known of a simulated run: the plant's signals, then its parameters as the belief has them.
        belief: The compiled model that the estimators hold for true.
        simulator: The plant.
        recorded: What is recorded of it.
        measured_rows: Of the plant's outputs, those that the belief has, in its order.
        estimators: In the order of the study; like the plant, any that fulfils ``harness.runner.contract``.

    Raises:
        UserError, ModelError: If a drive, model or estimator cannot be built.
    """

    def __init__(
        self, study: StudySpec, simulator: Simulator | None = None, filters: Mapping[str, Filter] | None = None
    ) -> None:
        self._study = study
        belief_model, plant_model = study.belief.model(), study.plant.model()
        self.signals = signals_of(study)
        published = set(plant_model.published)
        self.supplied = supplied_inputs(plant_model, belief_model)
        states = (s for s in belief_model.states if s in published)
        exact = [name for name in self.supplied if name not in plant_model.outputs]
        sliding = plant_model.largest_slip_angles
        watched = tuple(dict.fromkeys([*states, *exact, *(s for s in self.signals if s in published), *sliding]))
        self.drives = [self._drive(study, i) for i in range(len(study.drives))]
        self.watched = watched
        self.belief = _compile(study.belief, self.signals)
        self.truth_names = (*watched, *truth_names(study.belief))
        with placed(study.path, self.key_of_plant):
            self.simulator = simulator or plant_of(study.plant)
        needed = dict.fromkeys([*study.targets, *exact], LARGEST)
        self.recorded = Signals(watched, needed | sliding)
        self.measured_rows = [list(self.simulator.ports.outputs).index(name) for name in belief_model.outputs]
        uncertain = bool(study.belief.input_noise)
        given = filters or {}
        self.estimators: list[Filter] = []
        for i, e in enumerate(study.estimators):
            with placed(study.path, f"estimator[{i}] '{e.name}'"):
                made = estimator_of(e.kind, self.belief, e.settings, e.base, uncertain) if e.name not in given else None
            self.estimators.append(given[e.name] if made is None else made)

    @property
    def key_of_plant(self) -> str:
        """Key of a study that names its plant."""
        external = self._study.plant.external
        return "plant" if external is None else f"plant.{external.description.kind}"

    def _drive(self, study: StudySpec, index: int) -> DriveInputs:
        profile = profile_of(study.plant, study.drives[index])
        if study.score_after >= profile.time[-1]:
            raise UserError(
                f"{study.path}: score_after: {study.score_after:g} s leaves nothing of drive "
                f"'{study.drives[index].name}', which ends at {profile.time[-1]:g} s; score earlier or drive longer"
            )
        plant, belief = study.plant.model(), study.belief.model()
        with placed(study.path, f"{self.key_of_plant}: inputs"):
            driven = input_table(profile, plant)
        with placed(study.path, "belief"):
            held = input_table(profile, belief, self.supplied)
        return DriveInputs(profile, in_lanes(driven), in_lanes(held))

    @cached_property
    def plant(self) -> CompiledModel:
        """The compiled plant with the signals that are watched, for kernels other than the simulator's."""
        return _compile(self._study.plant, self.watched)

    def measured(self, measurements: Floats) -> Floats:
        """Return the measurements that the belief has outputs for, in their order, ``(..., samples, ny, LANES)``."""
        if self.measured_rows == list(range(len(self.simulator.ports.outputs))):
            return measurements
        return np.ascontiguousarray(measurements[..., self.measured_rows, :])

    def known(self, drive: int, batch: Batch) -> Floats:
        """Return the belief's inputs ``(samples, nu, LANES)``, those that the plant supplies filled in.

        Of several batches these have their axis in front; what all have in common has none.
        """
        inputs = self.drives[drive].belief[: batch.truth.shape[-3]]
        if not self.supplied:
            return inputs
        inputs = np.broadcast_to(inputs, (*batch.truth.shape[:-3], *inputs.shape)).copy()
        outputs = list(self.simulator.ports.outputs)
        for name in self.supplied:
            column = self.belief.model.inputs.index(name)
            if name in outputs:
                inputs[..., column, :] = batch.measurements[..., outputs.index(name), :]
            else:
                inputs[..., column, :] = batch.truth[..., self.recorded.names.index(name), :]
        return inputs

    def first_variance(self, process: Floats) -> Floats:
        """Return the first variances ``(..., nx, LANES)``; not stated, the process noise (Ziaukas 2023, 5.1, 6.1)."""
        first = process.copy()
        for state, variance in self.belief.model.start_variance.items():
            first[..., self.belief.model.states.index(state), :] = variance
        return first


def supplied_inputs(plant: StateSpaceModel, belief: StateSpaceModel) -> tuple[str, ...]:
    """Return the inputs of the belief that are no input of a drive but come from the vehicle itself.

    They are what its sensors measure, noise included, or where no sensor does, the plant's exact state or port.
    """
    published = {*plant.outputs, *plant.states, *plant.ports}
    driven = {*plant.inputs, *belief.rates, *DRIVE_INPUTS, *(set(belief.otherwise) - published), "time"}
    return tuple(name for name in belief.inputs if name not in driven)


def plant_of(spec: ModelSpec) -> Simulator:
    """Return the plant of a study as what runs it."""
    return CompiledSimulator.of(spec) if spec.external is None else ExternalPlant(spec)


def _compile(spec: ModelSpec, signals: tuple[str, ...]) -> CompiledModel:
    return compile_model(spec.model(), spec.step, spec.integrator, spec.substeps, signals)


GRAVITY = 9.81
FRICTION = "friction"
"""Parameter of a vehicle that is the largest friction of its tyres."""

_OF_THE_PLANT = {(FRICTION, "plant"), (FRICTION, "both")}


def asked_too_much(study: StudySpec, compiled: CompiledStudy) -> list[str]:
    """Return a sentence for each drive that asks for more than there is somewhere in the designs.

    A drive asks for the lateral acceleration of a vehicle that follows its wheels; friction times gravity is the most
    that tyres of equal friction give it. Nothing of a plant without such a parameter.
    """
    own = study.plant.values.get(FRICTION)
    if own is None:
        return []
    least = {
        design.name: min([min(f.lower) for f in design.factors if (f.parameter, f.of) in _OF_THE_PLANT] or [own])
        for design in study.designs
    }
    sentences = []
    for spec, drive in zip(study.drives, compiled.drives, strict=True):
        asked = float(np.abs(lateral_acceleration(drive.profile, context_of(study.plant, spec))).max())
        short = [f"{mu * GRAVITY:.2g} m/s^2 in design '{name}'" for name, mu in least.items() if mu * GRAVITY < asked]
        if short:
            sentences.append(
                f"drive '{spec.name}' asks for {asked:.2g} m/s^2 of lateral acceleration, more than friction gives: "
                f"{listed(short)}; runs in which the vehicle goes out of control are counted for no estimator"
            )
    return sentences


class ErrorWindows:
    """The windows in which a study wants errors kept over time.

    Args:
        study: The study.
        compiled: Its models and drives.
    """

    def __init__(self, study: StudySpec, compiled: CompiledStudy) -> None:
        self._study, self._wanted = study, study.over_time
        self._samples = [len(drive.profile.time) for drive in compiled.drives]
        self._rows = [compiled.truth_names.index(name) for name in study.targets] if self._wanted else []

    def count(self, design: int, drive: int) -> int | None:
        """Return the number of windows of a drive in a design; ``None`` where nobody asked for them."""
        wanted, study = self._wanted, self._study
        if wanted is None or (study.designs[design].name, study.drives[drive].name) != (wanted.design, wanted.drive):
            return None
        return max(1, self._samples[drive] // self._length)

    @property
    def _length(self) -> int:
        """Samples of a window."""
        assert self._wanted is not None
        return max(1, round(self._wanted.window / self._study.plant.step))

    def rmse(self, batch: Batch, scores: Scores, windows: int) -> NDArray[np.float32]:
        """Return the RMSE of each target by window ``(LANES, targets, windows)``; NaN from a divergence on."""
        assert scores.kept is not None
        error = scores.kept[:, 0, : len(self._rows)] - batch.truth[:, self._rows]
        ended = np.arange(len(error))[:, None] >= np.minimum(scores.diverged_at, batch.left_at)
        error = np.where(ended[:, None], np.nan, error)[: windows * self._length]
        squares = np.square(error).reshape(windows, -1, *error.shape[1:])
        return np.sqrt(squares.mean(axis=1)).transpose(2, 1, 0).astype(np.float32)
