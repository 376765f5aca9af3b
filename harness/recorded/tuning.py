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
from harness.identification.contract import Estimate, Verdict
from harness.identification.coordinates import (
    NOISE_RANGE,
    Coordinate,
    Coordinates,
    measurement_coordinates,
    process_coordinates,
)
from harness.identification.data import Drive
from harness.identification.filtered_model import Candidates
from harness.identification.fisher_scoring import Maximum, maximise
from harness.identification.methods.likelihood import white_noise
from harness.identification.objective import LogPosterior
from harness.identification.uncertainty import NORMAL, Summit, estimates_of, limits_of_knowledge
from harness.models.quantities import words
from harness.models.signals import SIGNALS
from harness.recorded.consistency import Consistency, consistency
from harness.recorded.run import RecordedModel, name_of

By = Literal["state", "unit"]

CONTRADICTED = 0.5 * NORMAL**2
"""Log-likelihood that a value in the 95 % interval may lie below the largest, everything else refitted."""

_ITERATIONS = 60
_REFITTING = 12
_HALVINGS = 7


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
        of = " and ".join(words(n) for n in self.names)
        return f"{'process' if self.kind == 'process' else 'measurement'} noise of {of}"


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
    drives: tuple[Drive, ...]
    variances: tuple[Variance, ...]
    log_likelihood: tuple[float, float]
    before: tuple[Consistency, ...]
    after: tuple[Consistency, ...]
    converged: bool
    notes: tuple[str, ...]


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
    search = _Search(model, drives, by)
    stated = search.value(search.space.centre)
    best = search.climb(say)
    say("how certain")
    estimates = search.estimates(best, say)
    free = np.array([e.verdict in ("determined", "weakly determined") for e in estimates])
    z, contradicted = search.with_stated(best, free, say)
    spec = search.space.fitted(z)
    found = search.variances(estimates, z, free, contradicted)
    notes = (
        [] if best.converged else [f"The search stopped early: a further step predicts a gain of {best.predicted:.2g}."]
    )
    say("innovations before and after")
    runs = [model.filtered.runs(drives, Candidates.of(s)) for s in (model.spec, spec)]
    before, after = (
        tuple(consistency(d, r, model.spec.model().outputs) for d, r in zip(drives, each, strict=True)) for each in runs
    )
    return NoiseTuning(
        model, spec, drives, found, (stated, search.value(z)), before, after, best.converged, tuple(notes)
    )


class _Search:
    """The likelihood of recordings as a function of the logarithms of the variances."""

    def __init__(self, model: RecordedModel, drives: Sequence[Drive], by: By) -> None:
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

    def climb(self, say: Callable[[str], None]) -> Maximum:
        """Return the largest likelihood that is found from the stated noise and from what the signals show."""
        shown = self.space.centre.copy()
        for i in np.flatnonzero(self.space.kind("measurement")):
            seen = white_noise(self.drives, self.space.coordinates[i].rows[0])
            if seen > 0:
                shown[i] = np.clip(math.log(seen), self.space.lower[i], self.space.upper[i])
        everything = np.ones(len(self.space), dtype=bool)
        found: list[Maximum] = []
        for number, start in enumerate((self.space.centre, shown), 1):
            say(f"search {number} of 2")
            if np.isfinite(self.value(start)):
                found.append(maximise(self.objective, start, everything, _ITERATIONS))
        if not found:
            raise UserError(
                "the filter diverges on these recordings with the stated noise; check units and signs of the recorded "
                "signals (harness check), or state other first variances"
            )
        return max(found, key=lambda m: m.value)

    def estimates(self, best: Maximum, say: Callable[[str], None]) -> tuple[Estimate, ...]:
        """Return every coordinate with its profile-likelihood interval and verdict."""
        everything = np.ones(len(self.space), dtype=bool)
        value, _, information = self.objective.slopes(best.z, everything)
        knowledge = limits_of_knowledge(self.space, best.z, information)
        summit = Summit(self.space, self.objective, best.z, value, information, knowledge)
        return estimates_of(summit, ("process", "measurement"), say)

    def with_stated(self, best: Maximum, free: Mask, say: Callable[[str], None]) -> tuple[Floats, Mask]:
        """Return the point with what is not determined as stated, and which stated values are contradicted.

        What is determined is fitted again around what is held.
        """
        contradicted = np.zeros(len(free), dtype=bool)
        if free.all():
            return best.z, contradicted
        stated = np.where(free, best.z, self.space.centre)
        z = self._refitted(stated, free)
        if best.value - self.value(z) <= CONTRADICTED:
            return z, contradicted
        held = best.z.copy()
        for i in np.flatnonzero(~free):
            say(f"how far {self.space.coordinates[i].name.replace('_', ' ')} may be as stated")
            held[i], contradicted[i] = self._nearest(best, i)
        return self._refitted(np.where(free, best.z, held), free), contradicted

    def _nearest(self, best: Maximum, i: int) -> tuple[float, bool]:
        """Return the value nearest to the stated one that the recordings do not contradict, and whether it differs."""
        others = np.ones(len(best.z), dtype=bool)
        others[i] = False

        def refused(at: float) -> bool:
            z = best.z.copy()
            z[i] = at
            return best.value - self.value(self._refitted(z, others)) > CONTRADICTED

        stated, good = float(self.space.centre[i]), float(best.z[i])
        if not refused(stated):
            return stated, False
        bad = stated
        for _ in range(_HALVINGS):
            middle = 0.5 * (good + bad)
            good, bad = (good, middle) if refused(middle) else (middle, bad)
        return good, True

    def _refitted(self, z: Floats, moved: Mask) -> Floats:
        """Return the point with some coordinates fitted again; as it is where the filter diverges there."""
        return maximise(self.objective, z, moved, _REFITTING).z if moved.any() and np.isfinite(self.value(z)) else z

    def variances(
        self, estimates: Sequence[Estimate], z: Floats, free: Mask, contradicted: Mask
    ) -> tuple[Variance, ...]:
        """Return the coordinates as variances."""
        spec = self.space.spec
        model, found = spec.model(), []
        held = self.space.candidates(z)
        for i, (c, e) in enumerate(zip(self.space.coordinates, estimates, strict=True)):
            kind: Literal["process", "measurement"] = "process" if c.kind == "process" else "measurement"
            of = model.states if kind == "process" else tuple(model.outputs)
            names = tuple(of[row] for row in c.rows)
            now = (held.process if kind == "process" else held.measurement)[list(c.rows), 0]
            before = np.array([(spec.process_noise if kind == "process" else spec.measurement_noise)[n] for n in names])
            known = math.isfinite(e.error)
            scale = now / c.value(float(z[i]))  # of a shared factor; else 1
            found.append(
                Variance(
                    kind,
                    names,
                    variance_unit_of(names[0]),
                    before,
                    now,
                    scale * e.lower if known else np.zeros(len(names)),
                    scale * e.upper if known else np.full(len(names), np.inf),
                    e.error / e.value if known else math.inf,
                    e.verdict or "not determined",
                    e.reason,
                    not free[i],
                    bool(contradicted[i]),
                )
            )
        return tuple(found)


def _each_state(spec: ModelSpec) -> list[Coordinate]:
    """Return a coordinate per noisy state; a random effect states its noise itself, which is a parameter."""
    bound, model, found = math.log(NOISE_RANGE), spec.model(), []
    for i, state in enumerate(model.states):
        if spec.process_noise[state] > 0 and state not in model.noise:
            start = math.log(spec.process_noise[state])
            name = f"process_noise {state}"
            unit = variance_unit_of(state)
            found.append(Coordinate(name, "process", (i,), start, start - bound, start + bound, True, unit))
    return found


def variance_unit_of(signal: str) -> str:
    """Return the SI unit of a signal's variance."""
    unit = SIGNALS[signal].unit if signal in SIGNALS else ""
    return f"({unit})^2" if unit not in ("", "dimensionless") else ""
