"""Process and measurement noise from the innovations of recordings: what is likely, how certain, what stays open.

The innovations of a filter that believes the right noise are white, normal and of the covariance it states, so their
density is the likelihood of the variances (Mehra 1970; Ljung 1999, 7.4). It is maximised over the logarithms of all
variances at once by the machinery of ``harness.identification``: exact derivatives, Fisher scoring, profile likelihood.
A variance that the recordings determine is taken; another one stays as it was stated, unless the recordings contradict
that value: then it is the nearest one that they do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import xarray as xr

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.config import ModelSpec
from harness.identification.candidates import Candidates
from harness.identification.contract import Estimate, Verdict
from harness.identification.coordinates import (
    NOISE_RANGE,
    Coordinate,
    Coordinates,
    measurement_coordinates,
    process_coordinates,
)
from harness.identification.data import DriveData
from harness.identification.fisher_scoring import Maximum, maximise
from harness.identification.objective import LogPosterior
from harness.identification.signal_noise import white_noise
from harness.identification.uncertainty import NORMAL, Summit, estimates_of, limits_of_knowledge
from harness.models.quantities import listed, words
from harness.models.signals import SIGNALS
from harness.recorded.run import RecordedModel, name_of
from harness.recorded.summary import Consistency, consistency, is_coloured
from harness.reporting.style import percent

By = Literal["state", "unit"]

CONTRADICTED = 0.5 * NORMAL**2
"""Log-likelihood that a value in the 95 % interval may lie below the largest, everything else refitted."""

_DETERMINED: tuple[Verdict, ...] = ("determined", "weakly determined")

_ELSEWHERE = math.log(3.0)
"""How far below its interval a process noise is tried, with all others free to take its place."""

_ITERATIONS = 60
_REFITTING = 12
_ROUGHLY = 0.02
"""Predicted gain below which a refit ends."""

_PRIOR = math.log(10.0)
"""Standard deviation of the prior about a stated value that the recordings contradict."""

_AS_STATED = 0.05
"""Logarithm by which a variance may move and still count as stated."""


@dataclass(frozen=True)
class Variance:
    """One variance, or several that share a factor, as found.

    Attributes:
        kind: Whether it drives states or disturbs measurements.
        names: States, or the output.
        unit: Of the variances, SI; process noise is per step.
        stated: Before ``(names,)``.
        value: Now believed ``(names,)``.
        lower: Lower end of the 95 % interval of each ``(names,)``; 0 if there is none.
        upper: Upper end ``(names,)``; infinite if there is none.
        error: Standard error of the logarithm; infinite if the recordings say nothing.
        verdict: Whether the recordings determine it.
        reason: The verdict in a sentence.
        held: Whether it was left as stated or near it, because the recordings do not determine it.
        contradicted: Of a held one, whether the recordings contradict the stated value.
    """

    kind: Literal["process", "measurement"]
    names: tuple[str, ...]
    unit: str
    stated: Floats
    value: Floats
    lower: Floats
    upper: Floats
    error: float
    verdict: Verdict
    reason: str
    held: bool
    contradicted: bool = False

    @property
    def label(self) -> str:
        """What it is the noise of, in words."""
        labels = " and ".join(words(n) for n in self.names)
        return f"{'process' if self.kind == 'process' else 'measurement'} noise of {labels}"


@dataclass(frozen=True)
class NoiseTuning:
    """What recordings say of the noise.

    Attributes:
        model: What was tuned, as stated.
        spec: The model with the variances now believed.
        drives: The recordings.
        variances: All that could be found, process noise first.
        log_likelihood: Of the recordings before and after ``(2,)``.
        before: The innovations with the stated noise, recording by recording.
        after: The same with that now believed.
        converged: Whether the search reached the maximum.
        notes: Sentences for the report.
    """

    model: RecordedModel
    spec: ModelSpec
    drives: tuple[DriveData, ...]
    variances: tuple[Variance, ...]
    log_likelihood: tuple[float, float]
    before: tuple[Consistency, ...]
    after: tuple[Consistency, ...]
    converged: bool
    notes: tuple[str, ...]

    @property
    def coloured(self) -> list[str]:
        """The outputs whose innovations are not white with the tuned noise, in words."""
        return [f"{words(n)} of {c.name}" for c in self.after for n, w in c.outputs.items() if is_coloured(w)]

    @property
    def answer(self) -> str:
        """The result in sentences."""
        held = [v.label for v in self.variances if v.held]
        text = f"Of {len(self.variances)} variances the recordings determine {len(self.variances) - len(held)}"
        if held:
            text += f"; not determined, and left as stated or as near as the recordings allow: {listed(held)}"
        before, after = (np.mean([c.inside for c in each]) for each in (self.before, self.after))
        text += f". NIS in its 95 % band: {percent(float(before))} before, {percent(float(after))} after."
        if self.coloured:
            text += (
                f" The innovations of {listed(self.coloured)} stay coloured: the variances make up for what the model "
                "lacks, and their intervals are too narrow. Try harness trace."
            )
        return text


def tune_noise(
    model: RecordedModel,
    recordings: Sequence[xr.Dataset],
    by: By = "state",
    say: Callable[[str], None] = lambda _: None,
) -> NoiseTuning:
    """Return the noise that makes the innovations of recordings most likely.

    Args:
        model: The model; its variances are where the search begins. One of zero stays zero.
        recordings: As ``harness.recorded.run.RecordedEstimator.run`` takes them, all of the step of the model.
        by: ``state``: each state has a variance of its own; ``unit``: those of states that share a unit keep their
            ratios, and only a common factor is found.
        say: Takes a line on what is being done.

    Raises:
        UserError: If a recording does not fit the model, there is no variance to find, or the filter diverges.
    """
    say("reading")
    drives = tuple(model.drive(r, name_of(r)) for r in recordings)
    search = _NoiseSearch(model, drives, by)
    stated = search.value(search.space.centre)
    say("searching")
    best = search.climb()
    say("how certain")
    estimates = search.estimates(best, say)
    estimates = search.without_mimicked(best, estimates, say)
    free = np.array([e.verdict in _DETERMINED for e in estimates])
    z, contradicted = search.with_stated(best, free)
    spec = search.space.fitted(z)
    variances = search.variances(estimates, z, free, contradicted)
    notes = (
        [] if best.converged else [f"The search stopped early: a further step predicts a gain of {best.predicted:.2g}."]
    )
    say("innovations before and after")
    runs = [model.filtered.runs(drives, Candidates.of(s)) for s in (model.spec, spec)]
    before, after = (
        tuple(consistency(d, r, model.spec.model().outputs) for d, r in zip(drives, each, strict=True)) for each in runs
    )
    return NoiseTuning(
        model, spec, drives, variances, (stated, search.value(z)), before, after, best.converged, tuple(notes)
    )


class _NoiseSearch:
    """The likelihood of recordings as a function of the logarithms of the variances."""

    def __init__(self, model: RecordedModel, drives: Sequence[DriveData], by: By) -> None:
        spec, self.model = model.spec, model
        outputs = list(spec.model().outputs)
        variances = np.array([spec.measurement_noise[n] for n in outputs])
        if not np.all(variances > 0):
            lacking = ", ".join(n for n, v in zip(outputs, variances, strict=True) if not v > 0)
            raise UserError(f"the measurement noise of {lacking} is stated as zero; state a first value above zero")
        process = (
            _each_state(spec) if by == "state" else [replace(c, prior=math.inf) for c in process_coordinates(spec)]
        )
        base = replace(Candidates.of(spec), measurement=variances.reshape(-1, 1))
        if by == "state":  # then a factor is the variance itself
            base.process[[c.rows[0] for c in process]] = 1.0
        self.space = Coordinates(
            spec, spec.model().parameter_names, [*process, *measurement_coordinates(spec, variances)], [base]
        )
        self.drives, self.objective = drives, LogPosterior(model.filtered, drives, self.space)

    def value(self, z: Floats) -> float:
        """Return the log-likelihood at a point."""
        return float(self.objective.values(z[:, None])[0])

    def climb(self) -> Maximum:
        """Return the largest likelihood, from the likelier of the stated noise and what the signals show of theirs.

        Raises:
            UserError: If the filter diverges at both.
        """
        shown = self.space.centre.copy()
        for i in np.flatnonzero(self.space.kind("measurement")):
            seen = white_noise(self.drives, self.space.coordinates[i].rows[0])
            if seen > 0:
                shown[i] = np.clip(math.log(seen), self.space.lower[i], self.space.upper[i])
        starts = np.column_stack([self.space.centre, shown])
        values = self.objective.values(starts)
        if not np.isfinite(values).any():
            raise UserError(
                "the filter diverges on these recordings with the stated noise; check units, signs and spikes of the "
                "recorded signals (harness check), or state other first variances"
            )
        everything = np.ones(len(self.space), dtype=bool)
        return maximise(self.objective, starts[:, int(np.argmax(values))], everything, _ITERATIONS)

    def estimates(self, best: Maximum, say: Callable[[str], None]) -> tuple[Estimate, ...]:
        """Return every coordinate with its profile-likelihood interval and verdict."""
        everything = np.ones(len(self.space), dtype=bool)
        value, _, information = self.objective.slopes(best.z, everything)
        knowledge = limits_of_knowledge(self.space, best.z, information)
        summit = Summit(self.space, self.objective, best.z, value, information, knowledge)
        return estimates_of(summit, ("process", "measurement"), say)

    def without_mimicked(
        self, best: Maximum, estimates: Sequence[Estimate], say: Callable[[str], None]
    ) -> tuple[Estimate, ...]:
        """Return the estimates, process noise that others can take the place of as not determined.

        Where the likelihood is largest some variances are practically zero, and one of several that act alike stands
        for all. The slope of the likelihood to the logarithm of a variance near zero vanishes, so neither the
        information nor a profile that is followed from there shows this; a refit that begins with all of them does.
        """
        judged, process = list(estimates), self.space.kind("process")
        determined = np.array([e.verdict in _DETERMINED for e in estimates])
        for i in np.flatnonzero(process & determined).tolist() if np.any(process & ~determined) else ():
            c, others = self.space.coordinates[i], np.ones(len(self.space), dtype=bool)
            others[i] = False
            say(f"whether others can take the place of {c.name.replace('_', ' ')}")
            z = best.z.copy()
            z[i] = max(c.coordinate(estimates[i].lower) - _ELSEWHERE, c.lower)
            if best.value - self.value(self._refitted(z, others)) <= CONTRADICTED:
                reason = "the process noise of other states explains these recordings as well"
                judged[i] = replace(estimates[i], verdict="not determined", reason=reason, error=math.inf)
        return tuple(judged)

    def with_stated(self, best: Maximum, free: Mask) -> tuple[Floats, Mask]:
        """Return the point with what is not determined as stated, and which stated values are contradicted.

        What is determined is fitted again around what is held. Where that is less likely than the 95 % interval allows,
        what is held moves too, away from its stated value against a prior: as far as the recordings ask.
        """
        if free.all():
            return best.z, ~free
        stated = self._refitted(np.where(free, best.z, self.space.centre), free)
        if best.value - self.value(stated) <= CONTRADICTED:
            return stated, np.zeros(len(free), dtype=bool)
        pulled = [
            replace(c, prior=math.inf if f else _PRIOR) for c, f in zip(self.space.coordinates, free, strict=True)
        ]
        objective = LogPosterior(self.model.filtered, self.drives, self.space.with_coordinates(pulled))
        moved = maximise(objective, stated, np.ones(len(free), dtype=bool), _ITERATIONS, enough=_ROUGHLY).z
        contradicted = ~free & (np.abs(moved - self.space.centre) > _AS_STATED)
        return self._refitted(np.where(free | contradicted, moved, self.space.centre), free), contradicted

    def _refitted(self, z: Floats, moved: Mask) -> Floats:
        """Return the likeliest point with some coordinates fitted again.

        A variance near zero has no slope to come back by, so the refit begins with the stated process noise as well.
        Where the filter diverges it stays as it is.
        """
        revived = np.where(moved & self.space.kind("process"), np.maximum(z, self.space.centre), z)
        starts = [z] if np.array_equal(revived, z) else [z, revived]
        maxima = [
            maximise(self.objective, s, moved, _REFITTING, enough=_ROUGHLY)
            for s in starts
            if moved.any() and np.isfinite(self.value(s))
        ]
        return max(maxima, key=lambda m: m.value).z if maxima else z

    def variances(
        self, estimates: Sequence[Estimate], z: Floats, free: Mask, contradicted: Mask
    ) -> tuple[Variance, ...]:
        """Return the coordinates as variances."""
        spec = self.space.spec
        model, variances = spec.model(), []
        held = self.space.candidates(z)
        for i, (c, e) in enumerate(zip(self.space.coordinates, estimates, strict=True)):
            kind: Literal["process", "measurement"] = "process" if c.kind == "process" else "measurement"
            labels = model.states if kind == "process" else tuple(model.outputs)
            names = tuple(labels[row] for row in c.rows)
            now = (held.process if kind == "process" else held.measurement)[list(c.rows), 0]
            before = np.array([(spec.process_noise if kind == "process" else spec.measurement_noise)[n] for n in names])
            finite = math.isfinite(e.error)
            scale = now / c.value(float(z[i]))  # of a shared factor; else 1
            variances.append(
                Variance(
                    kind,
                    names,
                    variance_unit_of(names[0]),
                    before,
                    now,
                    scale * e.lower if finite else np.zeros(len(names)),
                    scale * e.upper if finite else np.full(len(names), np.inf),
                    e.error / e.value if finite else math.inf,
                    e.verdict or "not determined",
                    e.reason,
                    not free[i],
                    bool(contradicted[i]),
                )
            )
        return tuple(variances)


def _each_state(spec: ModelSpec) -> list[Coordinate]:
    """Return a coordinate per noisy state; a random effect states its noise itself, which is a parameter."""
    bound, model, coordinates = math.log(NOISE_RANGE), spec.model(), []
    for i, state in enumerate(model.states):
        if spec.process_noise[state] > 0 and state not in model.noise:
            start = math.log(spec.process_noise[state])
            name = f"process_noise {state}"
            unit = variance_unit_of(state)
            coordinates.append(Coordinate(name, "process", (i,), start, start - bound, start + bound, True, unit))
    return coordinates


def variance_unit_of(signal: str) -> str:
    """Return the SI unit of a signal's variance."""
    unit = SIGNALS[signal].unit if signal in SIGNALS else ""
    return f"({unit})^2" if unit not in ("", "dimensionless") else ""
