"""An effect of the library that is a random process: no simulation predicts it, but a filter with it as a state can.

Such an effect has no response to test and does not lower the simulation error, so it is no candidate of the forward
selection. Where an unknown disturbance at the ports that the effect changes explains as much as one at any other input,
its parameters are fitted by the likelihood of a filter that holds it as a state. It is accepted if the likelihood of
both the fitted and the held-out drives rises and the innovations on the latter become white, or almost: a random
process that replaces another effect leaves them coloured.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.diagnosis.criteria import BIC_NEEDED, EXCESS, FARTHER, WHITE
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.selection.forward_selection import Trace
from harness.identification.contract import Problem
from harness.identification.data import Drive
from harness.identification.filtered_model import Candidates
from harness.identification.innovations import Innovations
from harness.identification.judgement import judged_on
from harness.identification.methods.likelihood import Settings, identify
from harness.identification.whiteness import Whiteness
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, split
from harness.models.contracts import Parameter

_SEARCH = {"profiles": False, "iterations": 15, "annealings": 1}
"""The model was fitted before, so the search with the process starts near the maximum."""


@dataclass(frozen=True)
class RandomProcess:
    """A random process that a model lacks.

    Attributes:
        hypothesis: The effect.
        spec: The final model with it.
        errors: Standard error of each of its parameters.
        gain: In log-likelihood of the fitted drives.
        held_out_gain: In that of the held-out drives, of which nothing was fitted.
        white: Whether it leaves white innovations there; otherwise almost white ones.
    """

    hypothesis: Hypothesis
    spec: ModelSpec
    errors: dict[str, float]
    gain: float
    held_out_gain: float
    white: bool


def find_random_process(trace: Trace, final: ModelSpec, ranking: DisturbanceRanking) -> RandomProcess | None:
    """Return the random process that explains what a model lacks; ``None`` if none does.

    Where the noise is held as stated none is sought: like process noise, it would absorb what is missing.

    Args:
        trace: What was found.
        final: The final model.
        ranking: Of it.
    """
    if trace.fitting.noise_held or not ranking.ranked_inputs or 2 * ranking.ranked_inputs[0].gain < BIC_NEEDED:
        return None
    most = ranking.ranked_inputs[0].gain
    suspected = [set(s.disturbance_input.ports) for s in ranking.ranked_inputs if 2 * (most - s.gain) < BIC_NEEDED]
    for name in _processes(final, trace.fitting.augmented):
        found = _fitted(trace, final, name) if _changed(final, name) in suspected else None
        if found is not None:
            return found
    return None


def _processes(spec: ModelSpec, augmented: AugmentedModel) -> list[str]:
    """Return the random processes of the library that a model may lack, without those that the user excludes."""
    out = augmented.excluded | {split(e)[0] for e in spec.effects}
    every = placements(spec.vehicle, spec.tyre, spec.sensors)
    return [n for n in every if getattr(load_effect(n), "NOISE", None) and split(n)[0] not in out]


def _changed(spec: ModelSpec, name: str) -> set[str]:
    """Return the ports that an effect changes."""
    before, after = spec.model().ports, assembled(spec.vehicle, spec.tyre, (*spec.effects, name), spec.sensors).ports
    return {port for port in before if before[port] != after[port]}


def _fitted(trace: Trace, final: ModelSpec, name: str) -> RandomProcess | None:
    """Return a process, fitted with the free parameters and all noise variances, if it is accepted."""
    parameters = load_effect(name).PARAMETERS
    names = tuple(p.name for p in parameters)
    filters = Innovations(_with(trace, final, name), jobs=trace.fitting.augmented.jobs)
    here, there = (
        tuple(_own(d, trace.fitting.augmented, filters) for d in drives)
        for drives in (trace.fitting.drives, trace.held_out.drives)
    )
    filters.spec = _first(filters, here, parameters)
    fit = identify(Problem(filters, here, (*trace.free, *names)), Settings.model_validate(_SEARCH))
    absent = {p.name: p.neutral for p in parameters if p.neutral is not None}
    without = replace(
        filters.spec,
        values={**filters.spec.values, **final.values, **absent},
        process_noise={**filters.spec.process_noise, **final.process_noise},
        measurement_noise=final.measurement_noise,
    )
    with_it, without_it = Candidates.of(fit.spec), Candidates.of(without)
    before, after = (judged_on(filters, there, held) for held in (without_it, with_it))
    gain = float((filters.log_likelihoods(here, with_it) - filters.log_likelihoods(here, without_it))[0])
    held_out_gain = sum(d.log_likelihood for d in after) - sum(d.log_likelihood for d in before)
    if 2 * gain - len(names) * math.log(trace.fitting.samples) < BIC_NEEDED or held_out_gain <= 0:
        return None
    tests = ([w for d in judged for w in d.whiteness] for judged in (before, after))
    left = [_left(b, a) for b, a in zip(*tests, strict=True)]
    if max(left) > EXCESS:
        return None
    if trace.after.normalised_excess_mse > max(
        EXCESS, FARTHER * expected_excess(filters, there, with_it, trace.held_out.variances)
    ):
        return None
    hypothesis = Hypothesis(name, "effect", tuple(absent), tuple(n for n in names if n not in absent))
    errors = {n: fit.estimate(n).error for n in names}
    return RandomProcess(hypothesis, fit.spec, errors, gain, held_out_gain, white=max(left) == 0)


def _left(before: Whiteness, after: Whiteness) -> float:
    """Return how much of its squared correlations a series of innovations keeps; nothing if it is not coloured.

    A series that is too short, or missing, is not tested (NaN) and is no evidence against a process.
    """
    if not min(after.ljung_box, after.periodogram) < WHITE:
        return 0.0
    return after.correlation / before.correlation


def expected_excess(filters: Innovations, drives: Sequence[Drive], held: Candidates, variances: Floats) -> float:
    """Return the ``normalised_excess_mse`` of a simulation that the random processes of a model cause.

    A filter without measurements and without other noise states the variances of the outputs.

    Args:
        filters: Of the model with the processes.
        drives: The recordings.
        held: The model and its noise.
        variances: Of the sensors' noise ``(ny,)``.
    """
    process = np.where([[s in filters.model.noise] for s in filters.model.states], held.process, 0.0)
    alone = replace(held, process=process)
    found = []
    for drive in drives:
        unseen = replace(
            drive,
            measurements=np.full_like(drive.measurements, np.nan),
            first_variance=np.zeros(len(process)),
            effects=drive.effects[:, :, :0],
        )
        found.append(filters.run(unseen, alone).deviation[1:] ** 2 - held.measurement[:, 0])
    return float(np.sum(np.concatenate(found).mean(axis=0) / variances))


def _first(filters: Innovations, drives: Sequence[Drive], parameters: Sequence[Parameter]) -> ModelSpec:
    """Return the model with the likeliest of the grids' values."""
    rows = [filters.model.parameter_names.index(p.name) for p in parameters]
    tried = np.array(list(itertools.product(*(p.grid for p in parameters)))).T
    held = Candidates.of(filters.spec).take([0] * tried.shape[1])
    held.values[rows] = tried
    best = tried[:, int(np.argmax(filters.log_likelihoods(drives, held)))]
    found = dict(zip((p.name for p in parameters), map(float, best), strict=True))
    return replace(filters.spec, values={**filters.spec.values, **found})


def _with(trace: Trace, final: ModelSpec, name: str) -> ModelSpec:
    """Return the final model with a random process and the initial noise, which nothing missing has enlarged yet."""
    larger, first = replace(final, effects=(*final.effects, name)), trace.fitting.augmented.spec.process_noise
    model = larger.model()
    process = {s: first.get(s, model.noise.get(s, 0.0) * final.step) for s in model.states}
    values = {**final.values, **{p.name: p.grid[0] for p in load_effect(name).PARAMETERS}}
    return replace(larger, values={n: values[n] for n in model.parameter_names}, process_noise=process)


def _own(drive: Drive, augmented: AugmentedModel, filters: Innovations) -> Drive:
    """Return a drive of the augmented model in terms of a filter's; what has noise alone starts at its mean."""
    columns = [augmented.model.inputs.index(n) for n in filters.model.inputs]
    states = filters.model.states
    known = {s: i for i, s in enumerate(augmented.model.states)}
    mean = np.array([drive.first_mean[known[s]] if s in known else 0.0 for s in states])
    nominal = {s: i for i, s in enumerate(augmented.nominal.states)}
    variance = [drive.first_variance[nominal[s]] if s in nominal else filters.spec.process_noise[s] for s in states]
    inputs, between = drive.inputs[:, columns], drive.between[:, columns]
    seen = len(filters.model.outputs)
    effects = np.zeros((len(inputs), len(states) + seen, drive.effects.shape[2]))
    effects[:, [states.index(s) for s in nominal]] = drive.effects[:, : len(nominal)]
    effects[:, len(states) :] = drive.effects[:, -seen:]
    return replace(
        drive, inputs=inputs, between=between, first_mean=mean, first_variance=np.array(variance), effects=effects
    )
