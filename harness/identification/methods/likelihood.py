"""Prediction-error maximum likelihood: parameters and noise through the innovations of the extended Kalman filter.

The innovations of a filter with the right model are white and normal with the covariance it states, so their density is
the likelihood of the parameters (Kristensen, Madsen and Joergensen 2004, eqs 6 to 8; Ljung 1999, 7.4). Gradient and
Fisher information are exact (``harness.identification.innovations``). Process and measurement noise are estimated with
the parameters: too large a process noise hides the effect of a parameter, too small a one makes the model look wrong.
The search fits the parameters first with the error in the measurement noise, then the noise, then both; at last it
forces the process noise down and refits, for as long as that gains.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.stats import qmc

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.engine.simd.lanes import LANES
from harness.identification.contract import Fit, Problem
from harness.identification.coordinates import Coordinates
from harness.identification.fisher_scoring import Maximum, maximise
from harness.identification.objective import Driveable, LogPosterior
from harness.identification.signal_noise import signal_noise, white_noise
from harness.identification.uncertainty import Colour, Summit, estimates_of, limits_of_knowledge
from harness.identification.whiteness import block_sums, colour_of, coloured_outputs, factors

_ROUGH = 5
"""Iterations of a stage that only prepares the next one."""

_COOLING = np.log(100.0)
"""How far the logarithm of every process-noise variance is forced down at once."""

_SILENT = 1e-8
"""Factor on the process noise of a fit without any."""

_REACH = np.log(2.0)
"""Other starts lie within this of the first one in each logarithm, or within that share of the range."""


class Settings(BaseModel):
    """Settings of the search."""

    model_config = ConfigDict(extra="forbid")

    starts: int = Field(1, ge=1, le=64, description="number of starting points; the first is the given one")
    iterations: int = Field(60, ge=1, description="largest number of filter runs with derivatives per stage")
    annealings: int = Field(3, ge=0, description="how often the process noise is forced down, while that gains")
    profiles: bool = Field(True, description="whether the likelihood along each parameter is computed")
    process_noise: bool = Field(True, description="whether the process noise is estimated; false holds it as stated")
    stated_priors: bool = Field(
        True,
        description="whether values have priors: the std of the parameter set, else a tenth",
    )
    priors: dict[str, float] = Field(
        default_factory=dict,
        description="standard deviation of a prior about the first value by parameter; of the logarithm if positive",
    )


def identify(problem: Problem, settings: Settings, say: Callable[[str], None] = lambda _: None) -> Fit:
    """Return the parameters and variances that make the recordings most likely.

    Raises:
        UserError: If nothing is free or the filter diverges at the initial values and all other starts.
    """
    if not problem.free:
        raise UserError("free: no parameter is free; name at least one")
    search = Search(problem, settings)
    say("first values")
    before = float(search.objective.values(search.coordinates.centre[:, None])[0])
    best: Maximum | None = None
    for number, start in enumerate(search.starts(settings.starts, problem.seed), 1):
        say(f"start {number} of {settings.starts}")
        maximum = search.climb(start)
        if best is None or maximum.value > best.value:
            best = maximum
    assert best is not None
    best = search.anneal(best, settings.annealings, say)
    say("certainty")
    return search.report(best, before, settings.profiles, say)


class Search:
    """The likelihood of a problem as a function of its coordinates, and the stages of the search.

    Args:
        problem: Model and recordings.
        settings: Of the method.
    """

    def __init__(self, problem: Problem, settings: Settings) -> None:
        self.problem, self.iterations = problem, settings.iterations
        self.coordinates = Coordinates.of(
            problem.spec,
            problem.free,
            first_noise(problem),
            settings.priors,
            settings.process_noise,
            signal_noise(problem.drives),
            settings.stated_priors,
        )
        self.objective = LogPosterior(problem.innovations, problem.drives, self.coordinates)
        driveable = Driveable(problem.innovations, problem.drives)
        if driveable.admits([self.coordinates.candidates(self.coordinates.centre).values[:, 0]] * len(problem.drives)):
            self.objective.driveable = driveable  # from a model that can be driven no fit leads to one that cannot

    def starts(self, count: int, seed: int) -> list[Floats]:
        """Return first points: the given one, then the likeliest of many spread about it.

        Raises:
            UserError: If the filter diverges at all of them.
        """
        space, parameters = self.coordinates, self.coordinates.kind("parameter")
        points = [space.centre]
        if count > 1:
            tried = max(LANES, 2 ** int(np.ceil(np.log2(8 * count))))
            cube = 2.0 * qmc.Sobol(int(parameters.sum()), rng=seed).random(tried) - 1.0
            reach = np.array([_REACH if c.logarithmic else 0.5 * (c.upper - c.lower) for c in space.coordinates])
            spread = np.repeat(space.centre[:, None], tried, axis=1)
            spread[parameters] += (cube * reach[parameters]).T
            spread = np.clip(spread, space.lower[:, None], space.upper[:, None])
            order = np.argsort(-self.objective.values(spread), kind="stable")
            points += [spread[:, k] for k in order[: count - 1]]
        finite = [p for p in points if np.isfinite(self.objective.values(p[:, None])[0])]
        if not finite:
            raise UserError(
                "the filter diverges on these recordings at the initial values; check units, signs and spikes of the "
                "recorded signals (harness check), start from other values, or ask for more starts"
            )
        return finite

    def climb(self, start: Floats) -> Maximum:
        """Fit the parameters with all of the error in the measurement noise, then the noise, then everything.

        Process noise that is free from the beginning would grow until it explains the error of the first values, and
        then hide what the parameters do.
        """
        rough = self.rough(self.wide(start))
        noise = maximise(self.objective, rough.z, ~self.coordinates.kind("parameter"), _ROUGH)
        return self.together(noise.z)

    def wide(self, start: Floats) -> Floats:
        """Return a point with all of its error in the measurement noise."""
        point = start.copy()
        point[self.coordinates.kind("measurement")] = np.log(self._innovation_variances(start))
        return point

    def rough(self, wide: Floats) -> Maximum:
        """Fit parameters and measurement noise."""
        moved = self.coordinates.kind("parameter", "measurement")
        return maximise(self.objective, wide, moved, self.iterations, enough=1.0)

    def _innovation_variances(self, z: Floats) -> Floats:
        """Return the mean square of each output's innovations ``(ny,)``, at least its variance at the point."""
        held = self.coordinates.candidates(z)
        runs = self.problem.innovations.runs(self.problem.drives, held)
        squares = np.nanmean(np.concatenate([r.innovation for r in runs]) ** 2, axis=0)
        return np.maximum(squares, held.measurement[:, 0])

    def together(self, start: Floats) -> Maximum:
        """Move everything."""
        return maximise(self.objective, start, np.ones(len(self.coordinates), dtype=bool), self.iterations)

    def anneal(self, best: Maximum, times: int, say: Callable[[str], None]) -> Maximum:
        """Force the process noise down and refit, for as long as that gains."""
        process, parameters = self.coordinates.kind("process"), self.coordinates.kind("parameter")
        for turn in range(times if process.any() else 0):
            say(f"annealing {turn + 1}")
            cold = best.z.copy()
            cold[process] = np.maximum(cold[process] - _COOLING, self.coordinates.lower[process])
            refitted = maximise(self.objective, cold, parameters, _ROUGH)
            maximum = self.together(refitted.z) if np.isfinite(refitted.value) else refitted
            gained = maximum.value - best.value
            if gained > 0:
                best = maximum
            if gained < 0.1:
                break
        return best

    def summit(self, z: Floats) -> Summit:
        """Return the maximum at a point, with what is known there."""
        value, _, information = self.objective.slopes(z, np.ones(len(self.coordinates), dtype=bool))
        knowledge = limits_of_knowledge(self.coordinates, z, information)
        return Summit(self.coordinates, self.objective, z, value, information, knowledge)

    def colour(self, summit: Summit, say: Callable[[str], None]) -> Colour | None:
        """Return what the colour of the innovations does to the estimates; ``None`` if they are white or almost."""
        innovations, drives = self.problem.innovations, self.problem.drives
        runs = innovations.runs(drives, self.coordinates.candidates(summit.z))
        outputs = coloured_outputs(runs, list(innovations.model.outputs))
        factor = factors(summit, self.block_sums(summit.z)) if outputs else None
        if factor is None:
            return None
        say("coloured innovations: without process noise")
        kept = ~self.coordinates.kind("process")
        silent = self._without_process_noise(summit.z, kept)
        wide = silent.wide(self.coordinates.centre[kept])  # where the fit began: it may have ended far off
        if not np.isfinite(silent.objective.values(wide[:, None])[0]):
            return colour_of(outputs, factor, summit)
        silent_summit = silent.summit(silent.rough(wide).z)
        return colour_of(outputs, factor, summit, silent_summit, silent.block_sums(silent_summit.z))

    def _without_process_noise(self, z: Floats, kept: Mask) -> Search:
        """Return the search of the other coordinates that are ``kept``, about a point."""
        search, space, held = copy(self), self.coordinates, self.coordinates.candidates(z)
        moved = [c for c, stays in zip(space.coordinates, kept, strict=True) if stays]
        base = replace(held, process=_SILENT * held.process)
        search.coordinates = Coordinates(space.spec, space.names, moved, [base])
        search.objective = LogPosterior(
            self.problem.innovations, self.problem.drives, search.coordinates, self.objective.driveable
        )
        return search

    def block_sums(self, z: Floats) -> Floats:
        """Return the sums of the scores at a point over blocks of the recordings ``(blocks, n)``."""
        space, drives = self.coordinates, self.problem.drives
        return block_sums(self.problem.innovations.scores(drives, space.candidates(z), space.directions(z)), drives)

    def report(self, best: Maximum, before: float, profiles: bool, say: Callable[[str], None]) -> Fit:
        """Return what was found with its uncertainty."""
        history = tuple(self.objective.history)
        summit = self.summit(best.z)
        colour = self.colour(summit, say)
        estimates = estimates_of(summit, ("parameter",) if profiles else (), say, colour)
        notes = []
        if not best.converged:
            notes.append(
                f"The search stopped early: a further step still predicts a gain of {best.predicted:.2g} units of "
                "log-likelihood. More iterations or another start may do better."
            )
        diverged = self.objective.diverged
        if diverged:
            notes.append(f"{diverged} candidates diverged and were discarded.")
        return Fit(
            method="likelihood",
            spec=self.coordinates.fitted(best.z),
            estimates=estimates,
            correlation=summit.knowledge.correlation,
            objective="log-likelihood",
            before=before,
            after=summit.value,
            history=history,
            converged=best.converged,
            coloured=() if colour is None else colour.outputs,
            notes=tuple(notes),
            further={"diverged_candidates": diverged, "last_predicted_gain": best.predicted},
        )


def first_noise(problem: Problem) -> Floats:
    """Return first measurement variances ``(ny,)``, from fourth differences.

    Where a signal is too coarsely resolved to show its noise, the variance of the model at hand stays.
    """
    given = np.array([problem.spec.measurement_noise[n] for n in problem.spec.model().outputs])
    variances = np.array([white_noise(problem.drives, a) for a in range(len(given))])
    return np.where(variances > 1e-12 * given, variances, given)
