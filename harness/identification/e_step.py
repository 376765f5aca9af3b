"""The expectation step of EM: particles of filter and smoother, and what a candidate leaves of how they moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_state, output, put, splat
from harness.engine.simd.lanes import LANES as WIDTH
from harness.estimation.contract import Estimator
from harness.estimation.particle_smoother import Transitions, run_filter, transitions
from harness.identification.data import Drive, started_by
from harness.simulation.simulate import in_lanes


@dataclass(frozen=True)
class Point:
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
        self, spec: ModelSpec, free: Sequence[str], drives: Sequence[Drive], particles: int, smoothed: bool
    ) -> None:
        self.drives, self.smoothed = tuple(drives), smoothed
        shape = (spec.model(), spec.step, spec.integrator, spec.substeps)
        self.compiled, self._duals = compile_model(*shape), compile_model(*shape, duals=True)
        settings = {"particles": particles, "resampling": "stratified", "threshold": 1.0}
        self._filter = Estimator("particle", self.compiled, settings)
        source = paste(self._duals, "expectation", [squared_residuals])
        self._kernel = load_source("expectation", source).squared_residuals
        self._values = self.compiled.parameter_vector(spec.values)
        self._rows = [spec.model().parameter_names.index(name) for name in free]
        self._starts = started_by(spec.model())

    def expect(self, point: Point, seed: np.random.SeedSequence) -> Expectation:
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
