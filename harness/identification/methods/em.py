"""Expectation maximisation with particles (Schön, Wills and Ninness 2011; Sun 2015, 2.28 to 2.39, 2.76 to 3.13).

E-step: the bootstrap filter and the marginal smoother give pairs of particles at neighbouring samples with weights
``W = p(x(t), x(t+1) | y)`` under the parameters at hand, ``theta_m``. M-step: the parameters that maximise

    Q(theta, theta_m) = sum W log N(x(t+1); f_theta(x(t), u(t)), Xi) + sum w log N(y(t); h_theta(x(t), u(t)), R)

(2.77 and 2.78; 2.76 does not depend on them). The exponents in Sun's (3.8) to (3.12) lack their minus sign. The sum
over pairs is quadratic in ``x(t+1)``, so the mean of ``x(t+1)`` per particle at ``t`` is all it takes
(``harness.estimation.particle_smoother.transitions``): N terms per sample in place of N^2. The derivatives are exact
(``harness.engine.simd.dual``).

Sun sets ``Xi`` beforehand and names that as open. Here it maximises Q together with the parameters: for any parameters
the best variance of a state is the mean of its squared residuals, which is put into Q. The particles make the iterates
scatter, so the result is their mean over a window, and the search ends when two windows agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.optimize import minimize

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_state, output, put, splat
from harness.engine.simd.lanes import LANES as WIDTH
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.particle_smoother import Transitions, run_filter, transitions
from harness.identification.candidates import Candidates
from harness.identification.contract import Estimate, Fit, Problem
from harness.identification.data import DriveData, started_by
from harness.simulation.simulate import in_lanes, variances


@dataclass(frozen=True)
class EMPoint:
    """The estimates of EM at an iteration.

    Attributes:
        free: Free parameters, SI ``(free,)``.
        process: Variances per step ``(nx,)``.
        measurement: Variances per sample ``(ny,)``.
    """

    free: Floats
    process: Floats
    measurement: Floats


def squared_residuals(u, y, particles, weights, targets, c, states, outputs):
    """Add up weighted squares of what the model leaves of next states and measurements; over dual numbers only.

    Args:
        u: Inputs from the particles' first sample on ``(samples, nu)``.
        y: Measurements ``(samples, ny)``; NaN where missing.
        particles: ``(samples, N, nx)``.
        weights: ``(samples, N)``.
        targets: ``(samples - 1, N, nx)``.
        c: Constants ``(nc, LANES)``.
        states: Sums per state, written ``(nx, LANES)``.
        outputs: Sums per output, written ``(ny, LANES)``.
    """
    x, ahead, w = np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NW, LANES))
    now, seen = np.empty((u.shape[1], LANES)), np.empty((NY, LANES))
    for i in range(NX):
        put(splat(0.0), states, i)
    for a in range(NY):
        put(splat(0.0), outputs, a)
    for t in range(u.shape[0]):
        for i in range(u.shape[1]):
            put(splat(u[t, i]), now, i)
        for n in range(particles.shape[1]):
            weight = weights[t, n]
            if weight <= 0.0:
                continue
            for i in range(NX):
                put(splat(particles[t, n, i]), x, i)
            output(x, now, c, seen)
            for a in range(NY):
                if not np.isnan(y[t, a]):
                    rest = y[t, a] - get(seen, a)
                    put(get(outputs, a) + weight * (rest * rest), outputs, a)
            if t < targets.shape[0]:
                next_state(x, now, c, ahead, w)
                for i in range(NX):
                    rest = targets[t, n, i] - get(ahead, i)
                    put(get(states, i) + weight * (rest * rest), states, i)


@dataclass(frozen=True)
class Expectation:
    """An E-step: per drive the inputs, measurements and particles from the second sample on, and their transitions."""

    inputs: tuple[Floats, ...]
    measurements: tuple[Floats, ...]
    particles: tuple[Floats, ...]
    moves: tuple[Transitions, ...]

    @property
    def steps(self) -> int:
        """Number of transitions."""
        return sum(len(m.targets) for m in self.moves)

    @property
    def seen(self) -> Floats:
        """Number of measurements of each output ``(ny,)``."""
        return np.asarray(sum(np.sum(np.isfinite(y), axis=0) for y in self.measurements), dtype=float)


class Expecter:
    """Filter, smoother and residuals of one model over its recordings.

    Args:
        spec: The model; parameters that are not free keep its values.
        free: Names of the free parameters.
        drives: Recordings.
        particles: Of the filter.
        smoothed: Whether all measurements count (the smoother) or only past ones (the filter).
    """

    def __init__(
        self, spec: ModelSpec, free: Sequence[str], drives: Sequence[DriveData], particles: int, smoothed: bool
    ) -> None:
        self.drives, self.smoothed = tuple(drives), smoothed
        shape = (spec.model(), spec.step, spec.integrator, spec.substeps)
        self.compiled, self._duals = compile_model(*shape), compile_model(*shape, duals=True)
        settings = {"particles": particles, "resampling": "stratified", "threshold": 1.0}
        self._filter = CompiledEstimator("particle", self.compiled, settings)
        source = paste(self._duals, "expectation", [squared_residuals])
        self._kernel = load_source("expectation", source).squared_residuals
        self._values = self.compiled.parameter_vector(spec.values)
        self._rows = [spec.model().parameter_names.index(name) for name in free]
        self._starts = started_by(spec.model())

    def expect(self, point: EMPoint, seed: np.random.SeedSequence) -> Expectation:
        """Run filter and smoother at a point (the E-step).

        Raises:
            UserError: If a state has no process noise or the filter diverges.
        """
        values = self._values.copy()
        values[self._rows] = point.free
        constants = self.compiled.constants(in_lanes(values))
        belief = self._filter.belief(constants, in_lanes(point.process), in_lanes(point.measurement))
        particles, moves = [], []
        for drive, own in zip(self.drives, seed.spawn(len(self.drives)), strict=True):
            mean = drive.first_mean.copy()
            mean[list(self._starts)] = values[list(self._starts.values())]
            first = self._filter.init(mean, drive.first_variance, [own] * WIDTH)
            (clouds,) = run_filter(self._filter, in_lanes(drive.inputs), in_lanes(drive.measurements), belief, first)
            particles.append(clouds.particles)
            moves.append(transitions(clouds, self.smoothed))
        inputs = tuple(np.ascontiguousarray(d.inputs[1:]) for d in self.drives)
        measurements = tuple(np.ascontiguousarray(d.measurements[1:]) for d in self.drives)
        return Expectation(inputs, measurements, tuple(particles), tuple(moves))

    def residuals(self, expectation: Expectation, free: Floats) -> tuple[Floats, Floats]:
        """Return the expected squared residuals and their derivatives.

        Args:
            expectation: From ``expect``.
            free: Free parameters, SI ``(free,)``.

        Returns:
            Sums per state and then per output ``(nx + ny,)``, and their derivatives ``(nx + ny, free)``.
        """
        nx, ny, count = self.compiled.nx, self.compiled.ny, len(free)
        sums, slopes = np.empty(nx + ny), np.empty((nx + ny, count))
        for begin in range(0, count, WIDTH):
            chunk = range(begin, min(begin + WIDTH, count))
            held = np.zeros((len(self._values), 2 * WIDTH))
            held[:, :WIDTH] = self._values[:, None]
            held[self._rows, :WIDTH] = free[:, None]
            for lane, i in enumerate(chunk):
                held[self._rows[i], WIDTH + lane] = 1.0
            constants = self._duals.constants(held)
            total = np.zeros((nx + ny, 2 * WIDTH))
            for u, y, x, move in zip(*vars(expectation).values(), strict=True):
                states, outputs = np.empty((nx, 2 * WIDTH)), np.empty((ny, 2 * WIDTH))
                self._kernel(u, y, x, move.weights, move.targets, constants, states, outputs)
                total[:nx] += states
                total[:nx, :WIDTH] += move.spread[:, None]
                total[nx:] += outputs
            sums = total[:, 0]
            slopes[:, chunk] = total[:, WIDTH : WIDTH + len(chunk)]
        return sums, slopes


class Settings(BaseModel):
    """Settings of EM; the number of particles is Sun's."""

    model_config = ConfigDict(extra="forbid")

    particles: int = Field(default=50, ge=2, le=100_000, description="of filter and smoother")
    e_step: Literal["smoother", "filter"] = Field(
        default="smoother", description="whether all measurements are used or only those up to the next sample"
    )
    search: Literal["gradient", "coordinate"] = Field(
        default="gradient",
        description="all parameters at once, or one after the other with an E-step after each, as Sun",
    )
    process_noise: bool = Field(default=True, description="whether the process covariance is estimated")
    measurement_noise: bool = Field(default=False, description="whether the measurement covariance is estimated")
    window: int = Field(default=10, ge=2, le=10_000, description="iterations whose mean is the result")
    iterations: int = Field(default=200, ge=1, le=100_000, description="largest number of E-steps")
    bounds: dict[str, tuple[float, float]] = Field(
        default_factory=dict, description="search range by parameter, SI; by default the model's bounds"
    )


@dataclass(frozen=True)
class EmResult:
    """What EM found.

    Attributes:
        point: Mean over the last window.
        history: The point after each M-step, the start first.
        converged: Whether two windows agreed within the scatter of the particles before the iterations ran out.
    """

    point: EMPoint
    history: tuple[EMPoint, ...]
    converged: bool


class Maximisation:
    """EM for one model and its recordings.

    Args:
        spec: The model; its values and variances are where EM begins. Every state needs process noise.
        free: Names of the parameters to be found.
        drives: Recordings.
        settings: Of the method.

    Raises:
        UserError: If nothing is free or recorded, a name is unknown, or a parameter starts outside its search range.
    """

    def __init__(
        self, spec: ModelSpec, free: Sequence[str], drives: Sequence[DriveData], settings: Settings | None = None
    ) -> None:
        self.spec, self.free, self.settings = spec, tuple(free), settings or Settings()
        self._bounds = _search_ranges(spec, self.free, self.settings.bounds)
        if not drives:
            raise UserError("no recording is given; identification needs at least one")
        smoothed = self.settings.e_step == "smoother"
        self.expecter = Expecter(spec, self.free, drives, self.settings.particles, smoothed)

    def start(self) -> EMPoint:
        """Return the point EM begins with."""
        return EMPoint(
            np.array([self.spec.values[name] for name in self.free]),
            variances(self.spec.process_noise, self.spec.model().states),
            variances(self.spec.measurement_noise, list(self.spec.model().outputs)),
        )

    def negative_q(self, expectation: Expectation, point: EMPoint) -> Callable[[Floats], tuple[float, Floats]]:
        """Return ``-Q(theta, theta_m)`` but for a constant, with its gradient, as a function of the free parameters.

        Variances that are estimated are at their best for the parameters at hand, the others at the point's.
        """
        nx, ny = len(point.process), len(point.measurement)
        counts = np.concatenate([np.full(nx, float(expectation.steps)), expectation.seen])
        held = np.concatenate([point.process, point.measurement])
        best = np.repeat([self.settings.process_noise, self.settings.measurement_noise], [nx, ny])

        def evaluate(free: Floats) -> tuple[float, Floats]:
            sums, slopes = self.expecter.residuals(expectation, free)
            variance = np.where(best, sums / counts, held)
            value = 0.5 * np.sum(np.where(best, counts * np.log(variance), sums / variance))
            return float(value), 0.5 * (slopes / variance[:, None]).sum(axis=0)

        return evaluate

    def maximise(self, expectation: Expectation, point: EMPoint, turn: int) -> EMPoint:
        """Return the point of the largest Q (the M-step); of the coordinate search, along parameter ``turn``."""
        cost = self.negative_q(expectation, point)
        free = self._climb(cost, point.free) if self.settings.search == "gradient" else self._along(cost, point, turn)
        sums, _ = self.expecter.residuals(expectation, free)
        process, measurement = np.split(sums, [len(point.process)])
        return EMPoint(
            free,
            process / expectation.steps if self.settings.process_noise else point.process,
            measurement / expectation.seen if self.settings.measurement_noise else point.measurement,
        )

    def _climb(self, cost: Callable[[Floats], tuple[float, Floats]], start: Floats) -> Floats:
        scale = np.where(start == 0, self._bounds[:, 1] - self._bounds[:, 0], np.abs(start))

        def scaled(z: Floats) -> tuple[float, Floats]:
            value, slope = cost(z * scale)
            return value, slope * scale

        bounds = list(zip(self._bounds[:, 0] / scale, self._bounds[:, 1] / scale, strict=True))
        minimum = minimize(scaled, start / scale, jac=True, method="L-BFGS-B", bounds=bounds)
        return np.asarray(minimum.x * scale)

    def _along(self, cost: Callable[[Floats], tuple[float, Floats]], point: EMPoint, turn: int) -> Floats:
        own = np.arange(len(self.free)) == turn % len(self.free)
        minimum = minimize(
            lambda v: cost(np.where(own, v, point.free))[0],
            point.free[own],
            method="Nelder-Mead",
            bounds=self._bounds[own],
        )  # as Sun's fminsearch
        return np.where(own, minimum.x, point.free)

    def run(self, seed: int, say: Callable[[str], None] = lambda _: None) -> EmResult:
        """Iterate until the mean over a window changes by no more than the scatter of the particles.

        A window of the coordinate search counts rounds in which every parameter had its turn.

        Args:
            seed: Of the particles.
            say: Takes a line on what is being done.

        Raises:
            UserError: If a state has no process noise or the filter diverges.
        """
        root, turns = np.random.SeedSequence(seed), len(self.free) if self.settings.search == "coordinate" else 1
        window = self.settings.window * turns
        history, converged = [self.start()], False
        while len(history) <= self.settings.iterations and not converged:
            point = history[-1]
            expectation = self.expecter.expect(point, root.spawn(1)[0])
            history.append(self.maximise(expectation, point, len(history) - 1))
            recent = history[-2 * window :: turns]
            converged = len(history) > 2 * window and settled(np.array([p.free for p in recent]))
            if (len(history) - 1) % window == 0:
                values = zip(self.free, history[-1].free, strict=True)
                say(f"iteration {len(history) - 1}: " + ", ".join(f"{name} {value:.4g}" for name, value in values))
        return EmResult(_mean(history[-window:]), tuple(history), converged)


def settled(iterates: Floats) -> bool:
    """Whether the means of both halves agree within twice their standard error, column by column ``(2 n, free)``."""
    before, after = np.split(iterates, 2)
    error = np.sqrt((before.var(axis=0, ddof=1) + after.var(axis=0, ddof=1)) / len(after))
    return bool(np.all(np.abs(after.mean(axis=0) - before.mean(axis=0)) <= 2.0 * error))


def _mean(points: Sequence[EMPoint]) -> EMPoint:
    fields = ("free", "process", "measurement")
    return EMPoint(*(np.mean([getattr(p, name) for p in points], axis=0) for name in fields))


def _search_ranges(spec: ModelSpec, free: Sequence[str], given: Mapping[str, tuple[float, float]]) -> Floats:
    """Return lower and upper bound of each free parameter ``(free, 2)``."""
    declared = {p.name: p for p in spec.model().parameters}
    if not free:
        raise UserError("no parameter is free; name at least one")
    for name in given:
        if name not in free:
            raise UserError(f"bounds: '{name}' is no free parameter{closest(name, list(free))}")
    ranges = []
    for name in free:
        if name not in declared:
            raise UserError(f"model '{spec.model().name}' has no parameter '{name}'{closest(name, list(declared))}")
        lower, upper = given.get(name, (declared[name].lower, declared[name].upper))
        if not lower <= spec.values[name] <= upper or lower == upper:
            raise UserError(f"'{name}' starts at {spec.values[name]:g}, its search range is {lower:g} to {upper:g}")
        ranges.append((lower, upper))
    return np.array(ranges)


def identify(problem: Problem, settings: Settings, say: Callable[[str], None] = lambda _: None) -> Fit:
    """Return the parameters and variances to which EM converges.

    Raises:
        UserError: As ``Maximisation``; if a state has no process noise or the filter diverges.
    """
    spec, model = problem.spec, problem.spec.model()
    search = Maximisation(spec, problem.free, problem.drives, settings)
    result = search.run(problem.seed, say)
    units = {p.name: p.unit for p in model.parameters}
    point, path = result.point, np.array([p.free for p in result.history])
    values = dict(zip(problem.free, map(float, point.free), strict=True))
    fitted = replace(
        spec,
        values={**spec.values, **values},
        process_noise=dict(zip(model.states, map(float, point.process), strict=True)),
        measurement_noise=dict(zip(model.outputs, map(float, point.measurement), strict=True)),
    )
    inner = problem.innovations
    before, after = (float(inner.log_likelihoods(problem.drives, Candidates.of(s))[0]) for s in (spec, fitted))
    return Fit(
        method="em",
        spec=fitted,
        estimates=tuple(Estimate(n, units[n], spec.values[n], values[n]) for n in problem.free),
        correlation=np.empty((0, 0)),
        objective="log-likelihood of the Kalman filter's innovations",
        before=before,
        after=after,
        history=(before, after),
        converged=result.converged,
        notes=(
            f"{len(path) - 1} iterations of {settings.particles} particles; the values are means over the last "
            f"{settings.window}. EM states no uncertainty; method 'likelihood' does.",
        ),
        further={"iterates": {n: path[:, i].tolist() for i, n in enumerate(problem.free)}},
    )
