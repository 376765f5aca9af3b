"""Contracts of what runs over time: a plant and a filter, as compiled kernels or as anybody's objects.

A study gives every plant the same points, inputs and noise and every filter the same measurements, and scores what
comes back. ``harness.study.evaluate.StudyEvaluator`` takes an object that fulfils ``Simulator`` or ``Filter`` in place
of a compiled one; what a study file names runs in worker processes (``harness.external``) behind such an object.

**Arrays** are in SI units and end with the runs, of which there are ``LANES`` in a batch: ``(samples, n, LANES)``. Of
several batches all arrays have their axis in front, but for what all batches have in common; what is written ``...`` in
a shape is that axis, or none. Lanes without a run of their own repeat the last one. A run must not depend on the runs
next to it, nor on what was run before.

**Runs that fail** do not raise: a plant says from which sample on nothing of a run counts (``Batch.left_at``), a filter
where its state is outside its limits (``History.facts``); what they write from there on is not looked at. An exception
ends the study.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.engine.kernel_names import Belief, State
from harness.engine.simd.lanes import LANES
from harness.models.assembly.model import StateSpaceModel
from harness.models.signals import signal_attributes

Kept_co = TypeVar("Kept_co", covariant=True)
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class Ports:
    """What goes into a plant or the model of a filter and what comes out: SI unit by name, in the order of the arrays.

    A study reads the names of a plant's outputs and of a filter's states, and the numbers of states and outputs of
    both. Inputs, parameters and process noise come in the order of the study's own models.

    Attributes:
        inputs: Signals that drive it.
        outputs: What its sensors measure, without noise.
        states: What process noise is added to and what an estimated state is compared with; a plant that keeps its
            state to itself has none.
        parameters: What the factors of a design may vary.
        limits: Largest magnitude of a state beyond which a run is lost; of a state that is not named, any.
    """

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    states: Mapping[str, str]
    parameters: Mapping[str, str]
    limits: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, model: StateSpaceModel) -> Ports:
        """Return those of a set of equations."""
        inputs, outputs, states = (
            {name: signal_attributes(name)["units"] for name in names}
            for names in (model.inputs, model.outputs, model.states)
        )
        return cls(inputs, outputs, states, {p.name: p.unit for p in model.parameters}, model.valid)


class InputSeries(NamedTuple):
    """Inputs over time, as a plant gets or a filter knows them.

    Of a recording that all lanes share none has the axis of lanes.

    Attributes:
        at: At the samples ``(..., samples, nu, LANES)``.
        between: During the step behind each sample, of the same shape; by default those of the sample.
        errors_between: What ``m`` independent errors of unit variance do to the latter ``(samples, nu, m, LANES)``;
            ``None`` where inputs are exact.
        errors_at: What the same errors do to the inputs at the next sample ``(samples, nu, m, LANES)``.
        effects: Of a recording, what the errors do to state and outputs ``(samples, nx + ny, m)``.
    """

    at: Floats
    between: Floats | None = None
    errors_between: Floats | None = None
    errors_at: Floats | None = None
    effects: Floats | None = None


@dataclass(frozen=True)
class Held:
    """What a plant, or a filter that believes in one, holds in each run.

    Attributes:
        values: Parameters ``(..., np, LANES)``.
        process_noise: Variances per step, by state ``(..., nx, LANES)``.
        measurement_noise: Variances per sample, by output ``(..., ny, LANES)``.
        first: First state, of a filter its mean ``(..., nx, LANES)``.
        first_variance: Of a filter's first state ``(..., nx, LANES)``, or a covariance that all runs share
            ``(nx, nx)``; by default the process noise (Ziaukas 2023, 5.1).
        input_noise: Variances per sample of the inputs that are measured with noise ``(..., noisy inputs, LANES)``.
        seeds: Of the random numbers of a filter that draws any, one for each run.
    """

    values: Floats
    process_noise: Floats
    measurement_noise: Floats
    first: Floats
    first_variance: Floats | None = None
    input_noise: Floats | None = None
    seeds: Sequence[np.random.SeedSequence] | None = None

    def of(self, runs: slice) -> Held:
        """Return those of some runs, whole batches of them."""
        if self.first.ndim == 2:
            return self
        batches = slice(runs.start // LANES, runs.stop // LANES)
        chosen: dict[str, Any] = {}
        for each in fields(self):
            values = getattr(self, each.name)
            if isinstance(values, np.ndarray):
                chosen[each.name] = values[batches] if len(values[batches]) > 1 else values[batches][0]
            elif values is not None:
                chosen[each.name] = values[runs]
        return Held(**chosen)


@dataclass(frozen=True)
class Signals:
    """What is recorded of a plant.

    Attributes:
        names: Signals.
        largest: Largest magnitude of some of them, beyond which, or where it is no number, a run is lost.
    """

    names: tuple[str, ...]
    largest: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Batch:
    """Simulated runs of one drive.

    Attributes:
        truth: Signals asked for, ``(..., samples, ns, LANES)``.
        measurements: Noisy outputs, ``(..., samples, ny, LANES)``.
        left_at: First sample at which the plant is outside its range of validity or out of control, or a signal that is
            needed is no number, ``(..., LANES)``; ``samples`` if there is none.
        input_errors: By which inputs are off as filters get them, by signal ``(..., samples, LANES)``.
        lost: Runs that ended because the code of the plant failed, not the vehicle, ``(..., LANES)``.
    """

    truth: Floats
    measurements: Floats
    left_at: Floats
    input_errors: dict[str, Floats] = field(default_factory=dict)
    lost: NDArray[np.bool_] | None = None


class Simulator(Protocol):
    """A plant that can be run over time."""

    @property
    def ports(self) -> Ports:
        """What goes in and comes out."""

    def run(self, inputs: InputSeries, held: Held, noise: Floats, record: Signals) -> Batch:
        """Run over a drive.

        Args:
            inputs: In the order of ``ports.inputs``, ``(samples, nu, LANES)``.
            held: In each run.
            noise: Standard normal numbers ``(..., samples, nx + ny, LANES)``: times their standard deviation those of a
                sample are added to the state that follows and to the outputs.
            record: What is recorded.
        """


@dataclass(frozen=True)
class History:
    """What a filter held sample by sample: of a single run as below, of runs side by side with their axis behind.

    Arrays of no samples were not asked for.

    Attributes:
        mean, state_covariance: Of the state ``(samples, nx)``, ``(samples, nx, nx)``.
        estimate, deviation: Of the signals ``(samples, ns)``.
        covariance: Of some of them ``(samples, m, m)``.
        innovation, spread: The innovation ``(samples, ny)`` and its covariance ``(samples, ny, ny)``; NaN at the first
            sample.
        facts: NIS (NaN at the first sample), measurements used, log-likelihood, repairs, and whether the state is
            outside its limits ``(samples, 5)``.
    """

    mean: Floats
    state_covariance: Floats
    estimate: Floats
    deviation: Floats
    covariance: Floats
    innovation: Floats
    spread: Floats
    facts: Floats


class Filter(Protocol):
    """An estimator that can be run over time; it gets at each sample what a control unit gets."""

    @property
    def ports(self) -> Ports:
        """What goes into the model that it believes in and comes out."""

    @property
    def signals(self) -> tuple[str, ...]:
        """What it may be asked for, in the order of ``History.estimate``."""

    @property
    def gives(self) -> np.ndarray:
        """Which of the signals it estimates ``(ns,)``; the others have no score."""

    @property
    def has_covariance(self) -> bool:
        """Whether it states standard deviations and the NIS."""

    @property
    def is_random(self) -> bool:
        """Whether it draws random numbers, and so needs seeds."""

    def run(self, inputs: InputSeries, measurements: Floats, held: Held, record: Record[Kept]) -> Kept:
        """Run over what was measured.

        An object that is no kernel computes a whole ``History`` of runs side by side and returns
        ``record.of(history, self)``; kernels record while they run (``record.run``), in the same numbers.

        Args:
            inputs: What it knows of them, in the order of ``ports.inputs``.
            measurements: ``(..., samples, ny, LANES)``, NaN where missing; those of the first sample are not used.
            held: What it believes in each run.
            record: What is recorded.
        """


class Recorder(NamedTuple):
    """Kernels of a record.

    Attributes:
        loop: Runs a filter and records, by ``harness.runner.filter_loop.run_filter``.
        kernels: What records, by the stand-in of ``harness.runner.filter_loop`` that it takes the place of.
    """

    loop: Callable[..., None]
    kernels: Mapping[Any, Any]


class Record(Protocol[Kept_co]):
    """What is recorded of a filter: ``harness.runner.scores.Scoring``, ``harness.runner.history.EverySample``.

    A new one is a class with these three, in a file with its kernels.
    """

    @property
    def recorder(self) -> Recorder:
        """Its kernels."""

    def run(
        self,
        loop: Callable[..., None],
        source: tuple[Any, ...],
        belief: Belief,
        first: State,
        limits: Floats,
        filter_: Filter,
    ) -> Kept_co:
        """Run the compiled loop and return what it recorded.

        Args:
            loop: ``recorder.loop``, compiled with the kernels of the filter and of a reader.
            source: What the reader reads from (``harness.runner.filter_loop``).
            belief: What the filter believes.
            first: State before the first step.
            limits: Largest magnitude of each state ``(nx,)``.
            filter_: The filter.
        """

    def of(self, history: History, filter_: Filter) -> Kept_co:
        """Return what is recorded of runs side by side."""
