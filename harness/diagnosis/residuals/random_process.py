"""An effect of the library that is a random process: no simulation predicts it, but a filter with it as a state can.

Such an effect has no response to test and does not lower the simulation error, so it is no candidate of the forward
selection, but for the drifts of gyroscopes, which every recording may have. Where an unknown disturbance at the ports
that the effect changes explains as much as one at any other input, its parameters are fitted by the likelihood of a
filter that holds it as a state. It is accepted if the likelihood of both the fitted and the held-out drives rises and
the innovations on the latter become white, or almost: a random process that replaces another effect leaves them
coloured.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.diagnosis.criteria import BIC_NEEDED, EXCESS, FARTHER
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.validation import colour_left
from harness.identification.candidates import Candidates
from harness.identification.coordinates import (
    Coordinates,
    intensity_coordinate,
    measurement_coordinates,
    process_coordinates,
)
from harness.identification.data import DriveData
from harness.identification.fisher_scoring import maximise
from harness.identification.innovations import Innovations
from harness.identification.objective import LogPosterior
from harness.identification.result import DriveJudgement, judged_on
from harness.identification.signal_noise import signal_noise
from harness.identification.uncertainty import covariance_of
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, parameter_at, split
from harness.models.contracts import Parameter

_CLIMB = 12
"""Most steps of a fit; from the likeliest value of a grid."""

_ENOUGH = 1.0
"""Gain in log-likelihood of a step at which it ends; what is accepted gains dozens."""


@dataclass(frozen=True)
class RandomProcess:
    """What a model lacks and no simulation predicts: one random process, or several.

    Attributes:
        hypotheses: The effects, in the order in which they were found.
        spec: The final model with all of them.
        errors: Standard error of each of their parameters.
        gain: In log-likelihood of the fitted drives.
        held_out_gain: In that of the held-out drives, of which nothing was fitted.
        white: Whether they leave white innovations there; otherwise almost white ones.
    """

    hypotheses: tuple[Hypothesis, ...]
    spec: ModelSpec
    errors: dict[str, float]
    gain: float
    held_out_gain: float
    white: bool


@dataclass(frozen=True)
class _Grown:
    """A model with one random process more than another.

    Attributes:
        hypothesis: The process.
        spec: The model with it.
        errors: Standard errors of the parameters of all its processes.
        gain: In log-likelihood of the fitted drives over the other model.
        held_out_gain: Likewise of the held-out ones.
        before: The other one on those.
        after: It itself there.
        expected: Excess of the simulation error that all its processes cause.
    """

    hypothesis: Hypothesis
    spec: ModelSpec
    errors: dict[str, float]
    gain: float
    held_out_gain: float
    before: tuple[DriveJudgement, ...]
    after: tuple[DriveJudgement, ...]
    expected: float


def find_random_process(trace: Trace, final: ModelSpec, ranking: DisturbanceRanking) -> RandomProcess | None:
    """Return the random processes that explain what a model lacks; ``None`` if none does.

    The first one acts where a disturbance explains as much as anywhere. While innovations stay coloured, another one is
    added where a disturbance explains anything: two gyroscopes drift, each by itself. Where the noise is held as stated
    none is sought: like process noise, it would absorb what is missing.

    Args:
        trace: What was found.
        final: The final model.
        ranking: Of it.
    """
    if trace.fitting.noise_held or not ranking.ranked_inputs:
        return None
    most = ranking.ranked_inputs[0].gain
    processes: list[_Grown] = []
    spec, needed = final, max(most - 0.5 * BIC_NEEDED, 0.5 * BIC_NEEDED)
    while not processes or _all_left(processes) > 0:
        suspected = [set(s.disturbance_input.ports) for s in ranking.ranked_inputs if s.gain >= needed]
        tried = (_grown(trace, spec, name) for name in _processes(spec, trace.fitting.augmented, suspected))
        grown = next((g for g in tried if g is not None), None)
        if grown is None:
            break
        processes.append(grown)
        spec, needed = grown.spec, 0.5 * BIC_NEEDED
    return _accepted(trace, processes) if processes else None


def _processes(spec: ModelSpec, augmented: AugmentedModel, suspected: list[set[str]]) -> list[str]:
    """Return the random processes of the library that a model may lack, those at the most suspected ports first.

    Left out is what the model has, what the user excludes, and what the search has tried.
    """
    out = {*augmented.excluded, *augmented.processes, *augmented.discrepancy, *spec.effects}
    ranked = []
    for name in placements(spec.vehicle, spec.tyre, spec.sensors):
        if getattr(load_effect(name), "NOISE", None) and not {name, split(name)[0]} & out:
            changed = _changed(spec, name)
            if changed in suspected:
                ranked.append((suspected.index(changed), name))
    return [name for _, name in sorted(ranked)]


def _changed(spec: ModelSpec, name: str) -> set[str]:
    """Return the ports that an effect changes."""
    before, after = spec.model().ports, assembled(spec.vehicle, spec.tyre, (*spec.effects, name), spec.sensors).ports
    return {port for port in before if before[port] != after[port]}


def _grown(trace: Trace, spec: ModelSpec, name: str) -> _Grown | None:
    """Return a model with a process more if it becomes likelier; the processes are fitted with all noise variances.

    The vehicle's parameters stay as they are: what wanders slowly hardly moves them, and a filter with every delay and
    every process as states is slow to differentiate.
    """
    parameters = _parameters(name)
    larger = _with(trace, spec, name)
    processes = [n for n in larger.effects if getattr(load_effect(n), "NOISE", None)]
    filters = Innovations(larger, jobs=trace.fitting.augmented.jobs)
    here, there = (
        tuple(_own(d, trace.fitting.augmented, filters) for d in drives)
        for drives in (trace.fitting.drives, trace.held_out.drives)
    )
    filters.spec = _first(filters, here, parameters)
    fitted, errors = _fitted(filters, here, [p for n in processes for p in _parameters(n)])
    absent = {p.name: p.neutral for p in parameters if p.neutral is not None}
    without = replace(
        filters.spec,
        values={**filters.spec.values, **spec.values, **absent},
        process_noise={**filters.spec.process_noise, **spec.process_noise},
        measurement_noise=spec.measurement_noise,
    )
    with_it, without_it = Candidates.of(fitted), Candidates.of(without)
    before, after = (judged_on(filters, there, held) for held in (without_it, with_it))
    gain = float((filters.log_likelihoods(here, with_it) - filters.log_likelihoods(here, without_it))[0])
    held_out_gain = sum(d.log_likelihood for d in after) - sum(d.log_likelihood for d in before)
    if 2 * gain - len(parameters) * math.log(trace.fitting.samples) < BIC_NEEDED or held_out_gain <= 0:
        return None
    own = tuple(p.name for p in parameters)
    return _Grown(
        Hypothesis(name, "effect", tuple(absent), tuple(n for n in own if n not in absent)),
        fitted,
        errors,
        gain,
        held_out_gain,
        before,
        after,
        expected_excess(filters, there, with_it, trace.held_out.variances),
    )


def _fitted(
    filters: Innovations, drives: Sequence[DriveData], parameters: Sequence[Parameter]
) -> tuple[ModelSpec, dict[str, float]]:
    """Return the model with the likeliest parameters of its processes and noise, and standard errors of the former."""
    spec = filters.spec
    names = spec.model().parameter_names
    variances = np.array([spec.measurement_noise[n] for n in spec.model().outputs])
    moved = (
        *(intensity_coordinate(p, names.index(p.name), spec.values[p.name]) for p in parameters),
        *process_coordinates(spec),
        *measurement_coordinates(spec, variances, signal_noise(drives)),
    )
    space = Coordinates(spec, names, moved, [Candidates.of(spec)])
    objective = LogPosterior(filters, drives, space)
    maximum = maximise(objective, space.centre, np.ones(len(space), dtype=bool), _CLIMB, _ENOUGH, _ENOUGH)
    shares = covariance_of(maximum.information).errors[: len(parameters)]
    fitted_spec = space.fitted(maximum.z)
    return fitted_spec, {p.name: float(fitted_spec.values[p.name] * e) for p, e in zip(parameters, shares, strict=True)}


def _parameters(name: str) -> tuple[Parameter, ...]:
    """Return the parameters of an effect at its place."""
    return tuple(parameter_at(p, split(name)[1] or "") for p in load_effect(name).PARAMETERS)


def _accepted(trace: Trace, processes: Sequence[_Grown]) -> RandomProcess | None:
    """Return processes if they leave white innovations, or almost, and the simulation strays as far as they make it."""
    colour, last = _all_left(processes), processes[-1]
    if colour > EXCESS or trace.after.normalised_excess_mse > max(EXCESS, FARTHER * last.expected):
        return None
    return RandomProcess(
        tuple(g.hypothesis for g in processes),
        last.spec,
        last.errors,
        sum(g.gain for g in processes),
        sum(g.held_out_gain for g in processes),
        white=colour == 0,
    )


def _all_left(processes: Sequence[_Grown]) -> float:
    """Return the share of their squared correlations that the innovations keep; see ``colour_left``."""
    return colour_left(processes[0].before, processes[-1].after)


def expected_excess(filters: Innovations, drives: Sequence[DriveData], held: Candidates, variances: Floats) -> float:
    """Return the ``normalised_excess_mse`` of a simulation that the random processes of a model cause.

    A filter without measurements and without other noise states the variances of the outputs.

    Args:
        filters: Of the model with the processes.
        drives: The recordings.
        held: The model and its noise.
        variances: Of the sensors' noise ``(ny,)``.
    """
    states = filters.model.states
    process = np.where([[s in filters.model.noise] for s in states], held.process, 0.0)
    alone = replace(held, process=process)
    spreads = []
    for drive in drives:
        unseen = replace(
            drive,
            measurements=np.full_like(drive.measurements, np.nan),
            first_variance=np.where([s in filters.model.noise for s in states], _starts(filters), 0.0),
            effects=drive.effects[:, :, :0],
        )
        spreads.append(filters.run(unseen, alone).deviation[1:] ** 2 - held.measurement[:, 0])
    return float(np.sum(np.concatenate(spreads).mean(axis=0) / variances))


def _first(filters: Innovations, drives: Sequence[DriveData], parameters: Sequence[Parameter]) -> ModelSpec:
    """Return the model with the likeliest of the grids' values."""
    rows = [filters.model.parameter_names.index(p.name) for p in parameters]
    tried = np.array(list(itertools.product(*(p.grid for p in parameters)))).T
    held = Candidates.of(filters.spec).take([0] * tried.shape[1])
    held.values[rows] = tried
    best = tried[:, int(np.argmax(filters.log_likelihoods(drives, held)))]
    likeliest = dict(zip((p.name for p in parameters), map(float, best), strict=True))
    return replace(filters.spec, values={**filters.spec.values, **likeliest})


def _with(trace: Trace, final: ModelSpec, name: str) -> ModelSpec:
    """Return the final model with a random process and the initial noise, which nothing missing has enlarged yet."""
    larger, first = replace(final, effects=(*final.effects, name)), trace.fitting.augmented.spec.process_noise
    model = larger.model()
    process = {s: first.get(s, model.noise.get(s, 0.0) * final.step) for s in model.states}
    values = {**final.values, **{p.name: p.grid[0] for p in _parameters(name)}}
    return replace(larger, values={n: values[n] for n in model.parameter_names}, process_noise=process)


def _starts(filters: Innovations) -> list[float]:
    """Return the first variance of every state: its own, or what a step makes."""
    model, stated = filters.model, filters.spec.process_noise
    return [model.start_variance.get(s, stated[s]) for s in model.states]


def _own(drive: DriveData, augmented: AugmentedModel, filters: Innovations) -> DriveData:
    """Return a drive of the augmented model in terms of a filter's; what has noise alone starts at its mean."""
    columns = [augmented.model.inputs.index(n) for n in filters.model.inputs]
    states = filters.model.states
    index = {s: i for i, s in enumerate(augmented.model.states)}
    mean = np.array([drive.first_mean[index[s]] if s in index else 0.0 for s in states])
    nominal = {s: i for i, s in enumerate(augmented.nominal.states)}
    variance = [
        drive.first_variance[nominal[s]] if s in nominal else v for s, v in zip(states, _starts(filters), strict=True)
    ]
    inputs, between = drive.inputs[:, columns], drive.between[:, columns]
    seen = len(filters.model.outputs)
    effects = np.zeros((len(inputs), len(states) + seen, drive.effects.shape[2]))
    effects[:, [states.index(s) for s in nominal]] = drive.effects[:, : len(nominal)]
    effects[:, len(states) :] = drive.effects[:, -seen:]
    return replace(
        drive, inputs=inputs, between=between, first_mean=mean, first_variance=np.array(variance), effects=effects
    )
