"""A nominal model together with every effect of the library that fits it: one filter for all hypotheses.

A hypothesis (which effect is there, how large, which parameters are wrong) is a vector of parameter values of the
*augmented* model, in which all effects act and are neutral unless stated. So every hypothesis is a point of one space,
its likelihood one run of one compiled filter, and trying an effect compiles nothing.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import ModelError, UserError
from harness.config import InputSignal, ModelSpec
from harness.config.bounds import broken_relations
from harness.config.parameter_set import set_std
from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.model import time_loops
from harness.diagnosis.model.noise_slopes import NoiseSlopes
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.identification.candidates import Candidates, Each, for_each
from harness.identification.coordinates import Coordinate
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilteredModel, FilterRun, Slopes
from harness.identification.measured_inputs import Between
from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, parameter_at, split, suffix
from harness.models.assembly.plan import planner
from harness.models.roles import VEHICLES
from harness.models.signals import SIGNALS
from harness.runner.contract import Held

_HALVINGS = 30
"""Of the way to a value that is impossible together with others."""

UNMODELLED = "unmodelled_force"
"""Effect that stands for what no equation of a model holds; no hypothesis, but a part of every model."""

MEMORY = "unmodelled_memory"
"""Its correlation time."""


@dataclass(frozen=True)
class HeldParameters:
    """What other drives of the vehicle say of its parameters.

    Attributes:
        names: Of the parameters.
        covariance: Of their estimates, in SI units ``(n, n)``.
    """

    names: tuple[str, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def precision(self, chosen: Sequence[str]) -> Floats:
        """Return the inverse covariance of some of them, whatever the others are ``(chosen, chosen)``."""
        rows = [self.names.index(n) for n in chosen]
        own = self.covariance[np.ix_(rows, rows)]
        scale = np.sqrt(np.diagonal(own))
        return np.asarray(np.linalg.pinv(own / np.outer(scale, scale), 1e-12, hermitian=True) / np.outer(scale, scale))


class AugmentedModel(FilteredModel):
    """The compiled filter of a nominal model and everything it may lack.

    Covariance and gains are those of the nominal model's extended Kalman filter, the mean is that of all effects too.
    What is absent costs nothing: the kernels skip the effects that are neutral. The bias of a gyroscope may drift, and
    the bank of the road may vary: if a candidate says so of any, the state of the filter holds all of these processes,
    behind that of the nominal model; and if it allows for a discrepancy of the model, those of that behind them.

    Args:
        spec: The nominal model.
        available: Signals that the recordings hold; effects that need others are left out.
        jobs: Threads; all cores by default.
        excluded: Effects (files) that are left out.

    Attributes:
        placements: Every effect at every place that may be lacking.
        processes: The random processes among them, which are in none of the placements.
        discrepancy: The random processes that stand for the discrepancy of the model, which are in neither.
        ranges: From where to where parameters are possible by what was measured besides, see ``gain_ranges``; others
            are possible where they are declared to be.
        held: What other drives say of parameters; a fit moves them about that. Nothing by default.
    """

    def __init__(
        self, spec: ModelSpec, available: Iterable[str], jobs: int | None = None, excluded: Iterable[str] = ()
    ) -> None:
        self.excluded = frozenset(excluded)
        addable = addable_effects(spec, set(available), self.excluded)
        self.placements = tuple(name for name in addable if not _is_random(name))
        self.discrepancy = tuple(name for name in addable if split(name)[0] == UNMODELLED)
        self.processes = tuple(name for name in addable if _is_random(name) and name not in self.discrepancy)
        files = tuple(dict.fromkeys(split(name)[0] for name in self.placements))
        random = (*self.processes, *self.discrepancy)
        moving, disturbed = (
            assembled(spec.vehicle, spec.tyre, (*spec.effects, *names), spec.sensors)
            for names in (self.processes, random)
        )
        moving = _first(moving, spec.model().states)  # an effect of the model may have states behind those of processes
        disturbed = _first(disturbed, moving.states)
        super().__init__(spec, _first(_assembled(spec, (*random, *files)), disturbed.states), jobs, jacobians=False)
        self.ranges: Mapping[str, tuple[float, float]] = {}
        self.held = HeldParameters()
        self._restated: Floats | None = None
        self._stated_std = set_std(spec)
        self._limited = np.flatnonzero(np.isfinite(self._limits))
        scales = {s: i for name in random for s, i in zip(_states(name, disturbed), intensities(name), strict=True)}
        self._intensities = {self.row(scales[s]): s for s in disturbed.states[len(self.nominal.states) :]}
        self._filtered = (self.nominal, moving, disturbed)
        self._filters = {0: _Filter(self, self.nominal)}
        self._compiling = Lock()  # candidates are fitted in threads

    def within(self, ranges: Mapping[str, tuple[float, float]]) -> AugmentedModel:
        """Return the same model, compiled already, with parameters held to ranges."""
        held = copy.copy(self)
        held.ranges = dict(ranges)
        return held

    def restated(self, spec: ModelSpec, values: Floats, held: HeldParameters) -> AugmentedModel:
        """Return the same model, compiled already, as other drives of the vehicle showed it.

        What happens in a drive and stays, and did not in those, is there from the first sample on as soon as its size
        is: it happened in between.

        Args:
            spec: The nominal model with its values and noise there.
            values: All parameters ``(np,)``, with the effects that were there.
            held: What is known of them.
        """
        other = copy.copy(self)
        other.spec, other._restated, other.held = spec, values.copy(), held
        for name in (n for n in self.placements if stays(n) and n not in spec.effects):
            for p in (parameter_at(p, split(name)[1] or "") for p in load_effect(name).PARAMETERS if p.per_drive):
                other._restated[self.row(p.name)] = p.lower
        return other

    def joint_prior(self, coordinates: Sequence[Coordinate]) -> Floats | None:
        """Return the inverse covariance of the prior of coordinates that other drives showed together ``(n, n)``."""
        rows = [i for i, c in enumerate(coordinates) if c.held]
        if not rows:
            return None
        chosen, stated = [coordinates[i] for i in rows], self.stated()
        slopes = np.array([c.slope(c.coordinate(float(stated[c.rows[0]]))) for c in chosen])
        joint = np.zeros((len(coordinates), len(coordinates)))
        joint[np.ix_(rows, rows)] = self.held.precision([c.name for c in chosen]) * np.outer(slopes, slopes)
        return joint

    def bounds(self, name: str) -> tuple[float, float]:
        """Return from where to where a parameter is possible by itself; what the model states always is."""
        p = self.model.parameters[self.row(name)]
        if name not in self.ranges:
            return p.lower, p.upper
        (lower, upper), stated = self.ranges[name], float(self.stated()[self.row(name)])
        return max(min(lower, stated), p.lower), min(max(upper, stated), p.upper)

    @property
    def nx(self) -> int:
        """Number of states that the filter corrects where there is a random process."""
        return len(self._filtered[-1].states)

    def corrected(self, values: Floats) -> int:
        """Return the number of states that the filter corrects with parameters ``(np, ...)``."""
        return len(self._filtered[self._level(values)].states)

    def wander(self, drive: DriveData, values: Floats) -> Floats:
        """Return the variance that random processes give the outputs of a free run ``(samples, ny)``.

        It is that of a filter that sees no measurement and knows of nothing else that is uncertain.
        """
        if not self._level(values):
            return np.zeros(drive.measurements.shape)
        nominal = len(self.nominal.states)
        stated = Candidates.of(self.spec)
        unseen = replace(
            drive,
            measurements=np.full_like(drive.measurements, np.nan),
            first_variance=np.where(np.arange(self.nx) < nominal, 0.0, drive.first_variance),
            effects=drive.effects[:, :, :0],
        )
        run = self.run(unseen, replace(stated, values=values[:, None], process=np.zeros_like(stated.process)))
        variance = np.maximum(run.deviation**2 - stated.measurement[:, 0], 0.0)
        variance[0] = variance[1]
        return variance

    def is_disturbed(self, values: Floats) -> bool:
        """Whether parameters ``(np, ...)`` allow for a discrepancy of the model."""
        return any(np.any(values[self.row(n)] != 0) for name in self.discrepancy for n in intensities(name))

    def _level(self, values: Floats) -> int:
        """Return which filter candidates need: of the nominal model, with processes, or with its discrepancy too."""
        states = [s for row, s in self._intensities.items() if np.any(values[row] != 0)]
        return next(i for i, model in enumerate(self._filtered) if set(states) <= set(model.states))

    def _filter_of(self, values: Floats) -> _Filter:
        """Return the filter for candidates; that of random processes is compiled for the first one."""
        level = self._level(values)
        with self._compiling:
            if level not in self._filters:
                self._filters[level] = _Filter(self, self._filtered[level])
            return self._filters[level]

    def _start_variance(self) -> Floats:
        first = [self._filtered[-1].start_variance[state] for state in self._intensities.values()]
        return np.concatenate([super()._start_variance(), first])

    def stated(self) -> Floats:
        """Return the parameters with which it is the nominal model ``(np,)``; those of absent effects as they start."""
        if self._restated is not None:
            return self._restated.copy()
        values = np.empty(len(self.names))
        for i, p in enumerate(self.model.parameters):
            if p.name in self.spec.values:
                values[i] = self.spec.values[p.name]
            elif p.neutral is not None:
                values[i] = p.neutral
            else:
                values[i] = p.grid[0] if p.grid else p.upper if p.per_drive else p.lower
        return values

    def possible(self, values: Floats) -> bool:
        """Whether all parameters ``(np,)`` are possible together, as the vehicle file says."""
        return not broken_relations(self.spec.vehicle, dict(zip(self.names, map(float, values), strict=True)))

    def possible_range(self, name: str, values: Floats) -> tuple[float, float]:
        """Return from where to where a parameter is possible with the others as they are.

        Args:
            name: Of the parameter.
            values: All parameters ``(np,)``, possible together.
        """
        row = self.row(name)

        def possible(value: float) -> bool:
            return self.possible(np.where(np.arange(len(values)) == row, value, values))

        def farthest(bound: float) -> float:
            if possible(bound):
                return bound
            inside, outside = float(values[row]), bound
            for _ in range(_HALVINGS):
                middle = 0.5 * (inside + outside)
                inside, outside = (middle, outside) if possible(middle) else (inside, middle)
            return inside

        lower, upper = self.bounds(name)
        return farthest(lower), farthest(upper)

    def stated_std(self, name: str) -> float:
        """Return the standard deviation by which a stated value may be off where it is in question, in its unit.

        It is the one that the parameter set states; else the share ``PRIORS.stated`` of a value that is positive by
        nature, and ``PRIORS.length`` of one that says where something is on the vehicle. Infinite for what is not
        stated.
        """
        if name not in self.spec.values:
            return math.inf
        share = PRIORS.length if name in self._lengths else PRIORS.stated
        value = self.spec.values[name]
        usual = share * value if value > 0 and self.model.parameters[self.row(name)].lower >= 0 else math.inf
        return self._stated_std.get(name, usual)

    @functools.cached_property
    def _lengths(self) -> frozenset[str]:
        return planner(self.nominal, VEHICLES.load(self.spec.vehicle)).lengths

    def drive(
        self, recording: xr.Dataset, name: str, between: Between = "joined", signal: InputSignal | None = None
    ) -> DriveData:
        """Return a recording in terms of this model; its inputs run straight between samples."""
        return super().drive(recording, name, between, signal)

    def _filter(self, drive: DriveData, held: Held, notes: tuple[Floats, ...]) -> Floats:
        filter_, total = self._filter_of(held.values), np.empty((2, LANES))
        nx = len(filter_.model.states)
        filter_.loop(
            drive.inputs,
            drive.between,
            filter_.inputs,
            drive.measurements,
            _of_states(drive.effects, nx, self.nx),
            self.compiled.constants(held.values),
            filter_.compiled.constants(np.ascontiguousarray(held.values[filter_.rows])),
            self._process(held.process_noise, filter_.model),
            held.measurement_noise,
            held.first,
            np.asarray(held.first_variance)[:nx],
            (self._limited, self._limits[self._limited]),
            total,
            notes,
        )
        return total

    @np.errstate(over="ignore", invalid="ignore")  # of a filter that diverges
    def slopes(self, drives: Sequence[DriveData], points: Each, directions: Each) -> Slopes:
        """Return the log-likelihood of all recordings at a point, with gradient and Fisher information.

        Directions of the noise and of intensities move gains and covariances (``NoiseSlopes``); along
        others these are held. In expectation the two kinds tell nothing of each other, and that is taken as it is.

        Args:
            drives: The recordings.
            points: One candidate, or one for each recording.
            directions: Derivatives of what is held, one column per direction.
        """
        at, along = for_each(points, drives), for_each(directions, drives)
        moves = np.any([np.delete(d.values, [*self._intensities], axis=0).any(axis=0) for d in along], axis=0)
        of_mean, of_noise = [*np.flatnonzero(moves)], [*np.flatnonzero(~moves)]
        of_mean_slopes = super().slopes(drives, at, [d.take(of_mean) for d in along])
        if not of_noise:
            return of_mean_slopes
        kept = self.runs(drives, at)
        parts = self.share(
            lambda i: self._noise_slopes(drives[i], at[i], along[i].take(of_noise), kept[i]), range(len(drives))
        )
        gradient, information = np.zeros(len(moves)), np.zeros((len(moves), len(moves)))
        gradient[of_mean], information[np.ix_(of_mean, of_mean)] = of_mean_slopes.gradient, of_mean_slopes.information
        gradient[of_noise] = np.sum([g for g, _ in parts], axis=0)
        information[np.ix_(of_noise, of_noise)] = np.sum([i for _, i in parts], axis=0)
        return Slopes(of_mean_slopes.log_likelihood, gradient, information)

    def _noise_slopes(
        self, drive: DriveData, point: Candidates, directions: Candidates, kept: FilterRun
    ) -> tuple[Floats, Floats]:
        """Return gradient and information of one recording along directions of the noise.

        An intensity scales its state: as to the innovations that is a variance of the state, and of its first value.
        """
        state = kept.state.copy()
        state[0] = self.first_state(drive, point.values[:, 0])
        drive, values = self.read_ahead(drive, point.values)
        filter_ = self._filter_of(values)
        vehicle, states = len(self.nominal.states), filter_.model.states
        process, first = (np.zeros((len(states), directions.count)) for _ in range(2))
        process[:vehicle] = directions.process
        for row, name in self._intensities.items():
            if name in states and values[row, 0] != 0:
                share, i = 2.0 * directions.values[row] / values[row, 0], states.index(name)
                process[i] = share * filter_.model.noise[name] * self.spec.step
                first[i] = share * drive.first_variance[i]
        constants = filter_.compiled.constants(np.repeat(values[filter_.rows], LANES, axis=1))
        moved = replace(directions, process=process)
        return filter_.noise_slopes.along(drive, constants, replace(kept, state=state), moved, first)

    def process_variances(self, point: Candidates) -> Floats:
        """Return the process-noise variances per step of the states that the filter corrects ``(corrected,)``."""
        return self._process(point.process, self._filtered[self._level(point.values)])[:, 0]

    def _process(self, noise: Floats, model: StateSpaceModel) -> Floats:
        walks = [model.noise[s] * self.spec.step for s in model.states[len(self.nominal.states) :]]
        return np.concatenate([noise, *(np.full((1, noise.shape[1]), v) for v in walks)])


class _Filter:
    """The filter of a model around the mean of an augmented one.

    Args:
        augmented: Whose first states are those of the model.
        model: What the filter knows.
    """

    def __init__(self, augmented: AugmentedModel, model: StateSpaceModel) -> None:
        self.model, whole = model, augmented.compiled
        self.rows = [augmented.row(n) for n in model.parameter_names]
        self.inputs = np.array([augmented.model.inputs.index(name) for name in model.inputs])
        self.compiled = compile_model(model, augmented.spec.step, substeps=augmented.spec.substeps)
        given = {
            time_loops.next_state_whole: whole.kernels.next_state,
            time_loops.output_whole: whole.kernels.output,
            time_loops.NX_WHOLE: whole.nx,
            time_loops.NW_WHOLE: whole.nw,
        }
        source = paste(self.compiled, "filter_whole", [time_loops.filter_whole], given)
        self.loop = load_source("filter_whole", source).filter_whole
        self.noise_slopes = NoiseSlopes(self.compiled, self.inputs)


def _of_states(effects: Floats, nx: int, count: int) -> Floats:
    """Return what the errors of the inputs do to the first ``nx`` of ``count`` states and to the outputs."""
    return effects if nx == count else np.concatenate([effects[:, :nx], effects[:, count:]], axis=1)


def _first(model: StateSpaceModel, states: Sequence[str]) -> StateSpaceModel:
    """Return a model with some states in front of the others."""
    order = [*states, *(s for s in model.states if s not in states)]
    if tuple(order) == model.states:
        return model
    rates = dict(zip(model.states, model.derivatives, strict=True))
    return replace(model, states=tuple(order), derivatives=type(model.derivatives)(rates[s] for s in order))


def addable_effects(spec: ModelSpec, available: set[str], excluded: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Return the effects of the library that a model may lack, place by place.

    Left out are effects whose inputs the recordings do not hold, those that the model has or the user excludes, and
    the random processes of a part of the vehicle or of a sensor that is no gyroscope: every gyroscope has a bias that
    wanders, and every road a bank; what else may be one is looked for behind the search (``random_process``).
    """
    effects, without = [], excluded | {split(e)[0] for e in spec.effects}
    for name in placements(spec.vehicle, spec.tyre, spec.sensors):
        file, place = split(name)
        gyroscope = place is None or (place in SIGNALS and SIGNALS[place].unit == "rad/s")
        seldom = _is_random(name) and not gyroscope and file != UNMODELLED
        if file in without or seldom:
            continue
        model = assembled(spec.vehicle, spec.tyre, (*spec.effects, name), spec.sensors)
        needed = {model.rates.get(i, i) for i in model.inputs} - {"time"}
        if needed <= available:
            effects.append(name)
    return tuple(effects)


def stays(name: str) -> bool:
    """Whether an effect happens in a drive and stays, so that it may have happened before one as well."""
    return bool(getattr(load_effect(name), "STAYS", False))


def _is_random(name: str) -> bool:
    return bool(getattr(load_effect(name), "NOISE", None))


def _states(name: str, model: StateSpaceModel) -> tuple[str, ...]:
    """Return the states of a random process in a model, in the order of its intensities; all places may share one."""
    stems, place = load_effect(name).STATES, suffix(split(name)[1] or "")
    return tuple(stem + place if stem + place in model.states else stem for stem in stems)


def intensities(name: str) -> tuple[str, ...]:
    """Return the parameters that scale the states of a random process, which are neutral where there is none."""
    declared = (p for p in load_effect(name).PARAMETERS if p.neutral is not None)
    return tuple(parameter_at(p, split(name)[1] or "").name for p in declared)


def _assembled(spec: ModelSpec, files: tuple[str, ...]) -> StateSpaceModel:
    """Return the nominal model with all of these effects; an incompatible one is refused by name."""
    VEHICLES.load(spec.vehicle)
    try:
        return assemble(spec.vehicle, spec.tyre, (*spec.effects, *files), spec.sensors, optional=True)
    except ModelError as error:
        raise UserError(f"effects of the library are incompatible: {error}") from None
