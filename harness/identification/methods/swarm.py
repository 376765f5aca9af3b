"""Particle swarm optimisation of the free-running error (Kennedy and Eberhart 1995; Ziaukas 2023, 4.25 to 4.28).

Weights, particles and iterations default to those of the thesis (table 4.5). It does not state the inertia ``gamma_0``;
0.7298 is that of Clerc and Kennedy (2002), whose other two weights are the thesis's 1.49. The method needs no noise and
no derivatives, and states no uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.identification.contract import Estimate, Fit, Problem
from harness.identification.simulation_error import Free, Misfit


class Settings(BaseModel):
    """Size and weights of the swarm (table 4.5), and where it searches."""

    model_config = ConfigDict(extra="forbid")

    particles: int = Field(default=240, ge=2, le=100_000, description="candidates per iteration")
    iterations: int = Field(default=200, ge=1, le=100_000, description="moves of the swarm, after its first positions")
    inertia: float = Field(default=0.7298, ge=0, lt=1.2, description="weight of a particle's velocity, gamma_0")
    cognitive: float = Field(default=1.49, ge=0, le=4, description="pull to the particle's own best position, gamma_1")
    social: float = Field(default=1.49, ge=0, le=4, description="pull to the best position of all, gamma_2")
    bounds: dict[str, tuple[float, float]] = Field(
        default_factory=dict, description="search range by parameter, SI; by default the model's bounds"
    )


@dataclass(frozen=True)
class SwarmResult:
    """Result of a global optimiser.

    Attributes:
        values: The best candidate ``(free,)``; NaN if every candidate diverged.
        history: Least cost after each generation of candidates, ``(generations,)``; infinite while there is none.
        evaluated: Candidates tried.
        diverged: How many of them had no finite cost.
    """

    values: Floats
    history: Floats
    evaluated: int
    diverged: int

    @property
    def cost(self) -> float:
        """Cost of the best candidate."""
        return float(self.history[-1])


def optimise(
    cost: Callable[[Floats], Floats], lower: Floats, upper: Floats, seed: int, settings: Settings | None = None
) -> SwarmResult:
    """Minimise a cost over a box.

    First positions are uniform over the box, first velocities uniform within its width. A particle that would leave the
    box stops at its wall and loses the velocity across it. A candidate of infinite cost is never a best position.

    Args:
        cost: Costs ``(candidates,)`` of candidates ``(candidates, free)``; infinite where there is none.
        lower: Smallest values ``(free,)``.
        upper: Largest values ``(free,)``.
        seed: Of the random numbers.
        settings: Size and weights; by default the thesis's.
    """
    chosen = settings or Settings()
    rng, width = np.random.default_rng(np.random.SeedSequence(seed)), upper - lower
    shape = (chosen.particles, len(lower))
    place = lower + width * rng.random(shape)
    velocity = width * rng.uniform(-1.0, 1.0, shape)
    own, own_cost = place.copy(), np.full(chosen.particles, np.inf)
    history, diverged = np.empty(chosen.iterations + 1), 0
    for j in range(chosen.iterations + 1):
        costs = cost(place)
        diverged += int(np.sum(~np.isfinite(costs)))
        better = costs < own_cost
        own[better], own_cost[better] = place[better], costs[better]
        leader = int(np.argmin(own_cost))
        history[j] = own_cost[leader]
        pulls = rng.random((2, *shape))
        velocity = (
            chosen.inertia * velocity
            + chosen.cognitive * pulls[0] * (own - place)
            + chosen.social * pulls[1] * (own[leader] - place)
        )
        moved = place + velocity
        place = np.clip(moved, lower, upper)
        velocity[place != moved] = 0.0
    best = own[leader] if np.isfinite(history[-1]) else np.full(len(lower), np.nan)
    return SwarmResult(best, history, chosen.particles * len(history), diverged)


def identify(problem: Problem, settings: Settings, say: Callable[[str], None] = lambda _: None) -> Fit:
    """Return the parameters of the least simulation error.

    Raises:
        UserError: If a search range is of no free parameter, or every candidate diverges.
    """
    spec = problem.spec
    declared = {p.name: p for p in spec.model().parameters}
    for name in settings.bounds:
        if name not in problem.free:
            raise UserError(f"bounds: '{name}' is no free parameter{closest(name, problem.free)}")
    for name in problem.free:
        if name not in declared:
            raise UserError(f"model '{spec.model().name}' has no parameter '{name}'{closest(name, list(declared))}")
    ranges = {n: settings.bounds.get(n, (declared[n].lower, declared[n].upper)) for n in problem.free}
    free = [Free(n, *ranges[n]) for n in problem.free]
    misfit = Misfit(problem.innovations.compiled, spec.values, free, problem.drives, jobs=problem.innovations.jobs)
    say(f"{settings.particles} particles move {settings.iterations} times over {len(problem.drives)} recordings")
    result = optimise(misfit, misfit.lower, misfit.upper, problem.seed, settings)
    if not np.isfinite(result.cost):
        raise UserError(
            f"all {result.evaluated} candidates diverged on the recordings; narrow the search with 'bounds'"
        )
    values = dict(zip(problem.free, map(float, result.values), strict=True))
    estimates = tuple(
        _estimate(declared[n].unit, spec.values[n], values[n], f) for n, f in zip(values, free, strict=True)
    )
    before = misfit(np.array([[spec.values[n] for n in problem.free]]))[0]
    return Fit(
        method="swarm",
        spec=replace(spec, values={**spec.values, **values}),
        estimates=estimates,
        correlation=np.empty((0, 0)),
        objective="sum of normalised errors of the free run",
        before=float(before),
        after=result.cost,
        history=tuple(map(float, result.history)),
        converged=True,
        notes=(
            f"{result.diverged} of {result.evaluated} candidates left the range in which the equations hold.",
            "A swarm states no uncertainty; repeat it with other seeds to see how far its results scatter.",
        ),
        further={"evaluated": result.evaluated, "diverged": result.diverged},
    )


def _estimate(unit: str, start: float, value: float, free: Free) -> Estimate:
    end = free.end_at(value)
    if not end:
        return Estimate(free.parameter, unit, start, value)
    reason = f"the search ended at its {end} bound, {getattr(free, end):g} {unit}"
    return Estimate(free.parameter, unit, start, value, verdict="at its bound", reason=reason)
