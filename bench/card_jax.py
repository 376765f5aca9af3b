"""A UKF, an EKF and a simulation written for JAX, on the problem of ``bench.card``.

``python -m bench.card --jax`` measures them beside this project's. The equations are the source of the compiled models,
executed over JAX (``bench.peers.problem``). A step does less than this project's: of a filter sums of squared errors,
NIS and log-likelihood, but neither NEES nor bounds nor divergence; of a simulation not where it leaves its range.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from rich.table import Table

from bench.engine import tiled
from bench.peers.jax_numbers import JAX
from bench.peers.problem import Equations, equations_of
from harness.common.arrays import Floats
from harness.engine.compile import CompiledModel
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.study.compiled_study import in_a_row
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator

os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # this project's runs are on the same card

SIMULATED = 1024
"""Different runs; more are these again."""

SIMULATION = "simulation"

LONG = 5.0
"""Seconds after which no further round is begun."""


class Told(NamedTuple):
    """What a filter is told of runs; ``runs`` is the last axis.

    Attributes:
        constants: Of the belief ``(nc, runs)``.
        process: Variances per step ``(nx, runs)``.
        measurement: Variances per sample ``(ny, runs)``.
        mean: First mean ``(nx, runs)``.
        variance: Its variances ``(nx, runs)``.
    """

    constants: Any
    process: Any
    measurement: Any
    mean: Any
    variance: Any


class Seen(NamedTuple):
    """What a filter sees and is scored against: ``(samples, nu)``, and ``(samples, ny or targets, runs)``."""

    inputs: Any
    measured: Any
    truth: Any


class Sums(NamedTuple):
    """Sums over all samples but the first: squared errors ``(targets, runs)``, NIS and log-likelihood ``(runs,)``."""

    squares: Any
    nis: Any
    log_likelihood: Any


class Form(NamedTuple):
    """A way to write a filter, or the simulation.

    Attributes:
        kind: ``"ekf"``, ``"ukf"`` or ``SIMULATION``.
        name: In the table.
        predict: ``(equations, tuning, state, process, inputs)`` to the predicted state; none of the simulation.
        vmapped: Whether it is written for one run, for ``jax.vmap``, or for arrays whose last axis are the runs.
        entries: Whether mean and covariance are numbers by themselves, the covariance's of its lower triangle.
    """

    kind: str
    name: str
    predict: Callable[[Equations, Any, Any, Any, Any], Any] | None = None
    vmapped: bool = True
    entries: bool = False


def stacked(rows: Sequence[Any]) -> Any:
    """Return numbers, or arrays over runs, and rows of them as one array."""
    if isinstance(rows[0], np.ndarray):
        shape = np.broadcast_shapes(*(np.shape(each) for row in rows for each in row))
        return jnp.stack([jnp.stack([jnp.broadcast_to(each, shape) for each in row]) for row in rows])
    shape = np.broadcast_shapes(*map(np.shape, rows))
    return jnp.stack([jnp.broadcast_to(each, shape) for each in rows])


def diagonal(values: Any) -> Any:
    """Return the matrix with these on its diagonal, ``(n, n)`` or ``(n, n, runs)``."""
    n = len(values)
    return jnp.eye(n).reshape(n, n, *[1] * (values.ndim - 1)) * values


def summed(A: Any, B: Any) -> Any:
    """Return a product of matrices, ``(n, n)`` or ``(n, n, runs)``, as a sum that is compiled into its surroundings."""
    return sum(A[:, j, None] * B[None, j] for j in range(A.shape[1]))


def written_out(P: Any) -> list[list[Any]]:
    """Return the lower Cholesky factor, row by row, of what is indexed ``P[i][j]``."""
    rows: list[list[Any]] = []
    for i in range(len(P)):
        row: list[Any] = []
        for j in range(i):
            row.append((P[i][j] - sum(row[k] * rows[j][k] for k in range(j))) / rows[j][j])
        row.append(jnp.sqrt(P[i][i] - sum(each * each for each in row)))
        rows.append(row)
    return rows


def lower(P: Any) -> Any:
    """Return the same factor as a matrix."""
    rows = written_out(P)
    return jnp.stack([jnp.stack([*row, *[jnp.zeros_like(row[0])] * (len(P) - len(row))]) for row in rows])


def by_forward_differentiation(eqs: Equations, x: Any, u: Any) -> tuple[Any, Any]:
    """Return the next state and its slope by ``jax.jacfwd``."""

    def ahead(x: Any) -> Any:
        return stacked(eqs.ahead(x, u))

    return ahead(x), jax.jacfwd(ahead)(x)


def by_derivation(eqs: Equations, x: Any, u: Any) -> tuple[Any, Any]:
    """Return the next state and its slope from the derivatives that this project derives symbolically."""
    ahead, slope = eqs.ahead_and_slope(x, u)
    return stacked(ahead), stacked(slope)


def linearised(slope: Any, product: Any, eqs: Equations, _: Any, state: Any, process: Any, u: Any) -> Any:
    """Predict as an EKF does (Ziaukas 2.12, 2.13)."""
    ahead, A = slope(eqs, state[0], u)
    return ahead, product(product(A, state[1]), jnp.swapaxes(A, 0, 1)) + diagonal(process)


def unscented(factor: Any, product: Any, eqs: Equations, tuning: Any, state: Any, process: Any, u: Any) -> Any:
    """Predict with sigma points (Ziaukas 2.19 to 2.24)."""
    (x, P), (distance, w0m, w0c, wi) = state, tuning
    spread = distance * factor(P)
    points = jnp.concatenate([x[:, None], x[:, None] + spread, x[:, None] - spread], axis=1)
    images = stacked(eqs.ahead(points, u))
    mean = w0m * images[:, 0] + wi * images[:, 1:].sum(axis=1)
    apart = images - mean[:, None]
    weights = jnp.concatenate([jnp.array([w0c]), jnp.full(2 * len(x), wi)]).reshape(-1, *[1] * (x.ndim - 1))
    return mean, product(weights * apart, jnp.swapaxes(apart, 0, 1)) + diagonal(process)


def entries_linearised(eqs: Equations, _: Any, state: Any, process: Any, u: Any) -> Any:
    """Predict as an EKF does, number by number, over what of the slope differs from zero."""
    x, P = state
    ahead, A = eqs.ahead_and_slope(x, u)
    n = len(x)
    there = [[j for j in range(n) if not (isinstance(A[i, j], float) and A[i, j] == 0)] for i in range(n)]
    half = [[sum(A[i, j] * P[max(j, k)][min(j, k)] for j in there[i]) for k in range(n)] for i in range(n)]
    full = [[sum(half[i][k] * A[m, k] for k in there[m]) for m in range(i + 1)] for i in range(n)]
    return tuple(ahead), _enlarged(full, process)


def entries_unscented(eqs: Equations, tuning: Any, state: Any, process: Any, u: Any) -> Any:
    """Predict with sigma points, number by number."""
    (x, P), (distance, w0m, w0c, wi), n = state, tuning, len(state[0])
    factor = written_out(P)
    points = [list(x)]
    for step in (distance, -distance):
        points += [[x[i] + step * factor[i][k] if i >= k else x[i] for i in range(n)] for k in range(n)]
    first, *others = (eqs.ahead(point, u) for point in points)
    mean = tuple(w0m * first[i] + wi * sum(each[i] for each in others) for i in range(n))
    middle, *apart = ([each[i] - mean[i] for i in range(n)] for each in (first, *others))
    full = [
        [w0c * middle[i] * middle[j] + wi * sum(each[i] * each[j] for each in apart) for j in range(i + 1)]
        for i in range(n)
    ]
    return mean, _enlarged(full, process)


def _enlarged(P: Any, process: Any) -> Any:
    """Return the rows of a lower triangle with variances added to the diagonal."""
    return tuple((*row[:-1], row[-1] + process[i]) for i, row in enumerate(P))


FORMS = (
    Form("ekf", "matrices, vmap, jacfwd", partial(linearised, by_forward_differentiation, jnp.matmul)),
    Form("ekf", "matrices, vmap, derived slopes", partial(linearised, by_derivation, jnp.matmul)),
    Form("ekf", "sums, vmap, derived slopes", partial(linearised, by_derivation, summed)),
    Form("ekf", "sums, runs last, derived slopes", partial(linearised, by_derivation, summed), vmapped=False),
    Form("ekf", "numbers, vmap, derived slopes", entries_linearised, entries=True),
    Form("ukf", "matrices, vmap, jnp.linalg.cholesky", partial(unscented, jnp.linalg.cholesky, jnp.matmul)),
    Form("ukf", "matrices, vmap, factor written out", partial(unscented, lower, jnp.matmul)),
    Form("ukf", "sums, vmap, factor written out", partial(unscented, lower, summed)),
    Form("ukf", "sums, runs last, factor written out", partial(unscented, lower, summed), vmapped=False),
    Form("ukf", "numbers, vmap, factor written out", entries_unscented, entries=True),
    Form(SIMULATION, "arrays, vmap"),
    Form(SIMULATION, "arrays, runs last", vmapped=False),
    Form(SIMULATION, "numbers, vmap", entries=True),
)
"""From what a textbook suggests to what leaves the compiler nothing to decide."""


def correct(eqs: Equations, state: Any, u: Any, y: Any, variances: Any) -> tuple[Any, Any, Any]:
    """Correct a prediction with one measurement after the other; return the state, NIS and log-likelihood."""
    (prior, P), nis, log_likelihood = state, 0.0, 0.0
    entries, x = isinstance(P, tuple), prior
    predicted, H = eqs.output_and_slope(prior, u)
    for a in range(len(predicted)):
        there = [j for j in range(len(x)) if not (isinstance(H[a, j], float) and H[a, j] == 0)]
        if entries:
            slope: Any = [sum(P[max(i, j)][min(i, j)] * H[a, j] for j in there) for i in range(len(x))]
        else:
            slope = sum(P[:, j] * H[a, j] for j in there)
        s = variances[a] + sum(H[a, j] * slope[j] for j in there)
        rest = y[a] - predicted[a] - sum(H[a, j] * (x[j] - prior[j]) for j in there)
        if entries:
            gain = [each / s for each in slope]
            x = tuple(x[i] + gain[i] * rest for i in range(len(x)))
            P = tuple(tuple(P[i][j] - gain[i] * slope[j] for j in range(i + 1)) for i in range(len(x)))
        else:
            x, P = x + slope / s * rest, P - (slope / s)[:, None] * slope[None]
        nis = nis + rest * rest / s
        log_likelihood = log_likelihood - 0.5 * (rest * rest / s + jnp.log(2 * jnp.pi * s))
    return (x, P), nis, log_likelihood


def estimated(form: Form, compiled: CompiledModel, tuning: Floats, seen: Seen, belief: Told) -> Sums:
    """Run a filter over all samples, of one run or of all, and return what its scores are made of."""
    eqs = equations_of(compiled, belief.constants, JAX)
    assert form.predict is not None

    def sample(carried: Any, now: Any) -> tuple[Any, None]:
        state, sums = carried
        before, u, y, truth = now
        state = form.predict(eqs, tuning, state, belief.process, before)
        state, nis, log_likelihood = correct(eqs, state, u, y, belief.measurement)
        errors = stacked(eqs.signals(state[0], u)) - truth
        terms = Sums(errors * errors, nis, log_likelihood)
        return (state, jax.tree.map(jnp.add, sums, terms)), None

    first = belief.mean, diagonal(belief.variance)
    if form.entries:
        first = tuple(first[0]), tuple(tuple(row[: i + 1]) for i, row in enumerate(first[1]))
    nothing = jnp.zeros_like(belief.mean[0])
    begun = first, Sums(jnp.zeros_like(seen.truth[0]), nothing, nothing)
    (_, sums), _ = lax.scan(sample, begun, (seen.inputs[:-1], seen.inputs[1:], seen.measured[1:], seen.truth[1:]))
    return sums


def simulated(form: Form, compiled: CompiledModel, inputs: Any, noise: Any, belief: Told) -> Any:
    """Simulate one run or all; return signals and measurements of each sample, of a form of numbers row by row.

    Args:
        form: How it is written.
        compiled: The plant.
        inputs: ``(samples, nu)``.
        noise: Standard normal numbers ``(samples, nx + ny)`` or ``(samples, nx + ny, runs)``.
        belief: Of the plant; its variance is not read.
    """
    eqs, gathered = equations_of(compiled, belief.constants, JAX), tuple if form.entries else stacked
    spread = jnp.sqrt(jnp.concatenate([belief.process, belief.measurement]))

    def sample(x: Any, now: Any) -> tuple[Any, Any]:
        u, drawn = now
        moved = [*eqs.ahead(x, u), *eqs.output(x, u)]
        moved = [each + spread[i] * drawn[i] for i, each in enumerate(moved)]
        return gathered(moved[: compiled.nx]), (gathered(eqs.signals(x, u)), gathered(moved[compiled.nx :]))

    first, drawn = belief.mean, noise
    if form.entries:
        first, drawn = tuple(first), tuple(jnp.moveaxis(noise, 1, 0))
    return lax.scan(sample, first, (inputs, drawn))[1]


class Problem:
    """What the filters of a study are told of runs on one drive.

    Args:
        evaluator: The study, with an EKF and a UKF.
        drive: Index of the drive.
        samples: Of the drive that are run.
        runs: Different ones.
    """

    def __init__(self, evaluator: StudyEvaluator, drive: int, samples: int, runs: int = SIMULATED) -> None:
        self.evaluator, self.samples = evaluator, samples
        self.compiled = evaluator.compiled.belief
        self.unit = Unit(0, 0, drive, 0, runs)
        cases = evaluator.cases(self.unit)
        self.batch = evaluator.simulate(self.unit, cases, samples)
        self.believed = evaluator.held(self.unit, cases, "belief")
        self.places = {e.kind: i for i, e in enumerate(evaluator.study.estimators) if e.kind in ("ekf", "ukf")}
        self.holds = {k: evaluator.believed_by(i, self.unit, cases, self.believed) for k, i in self.places.items()}
        drives, names = evaluator.compiled.drives[drive], evaluator.compiled.truth_names
        self.seen = Seen(
            drives.belief[:samples, :, 0],
            in_a_row(evaluator.compiled.measured(self.batch.measurements), 3),
            in_a_row(self.batch.truth, 3)[:, [names.index(each) for each in self.compiled.signal_names]],
        )

    def _estimator(self, kind: str) -> CompiledEstimator:
        return cast(CompiledEstimator, self.evaluator.compiled.estimators[self.places[kind]])

    def belief(self, kind: str, runs: int) -> Told:
        """Return what an estimator is told of so many runs."""
        belief, state = self._estimator(kind).begin(self.holds[kind])
        variance = in_a_row(state.covariance, 3)[range(self.compiled.nx), range(self.compiled.nx)]
        rows = (belief.constants, belief.process_noise, belief.measurement_noise, state.mean)
        return Told(*(tiled(each, runs) for each in (*(in_a_row(row, 2) for row in rows), variance)))

    def filter(self, form: Form) -> Any:
        """Return a filter over a batch of runs, compiled when it is first called."""
        tuning = self._estimator(form.kind).tuning
        run = partial(estimated, form, self.compiled, tuple(map(float, tuning)))
        return jax.jit(jax.vmap(run, in_axes=(Seen(None, -1, -1), -1), out_axes=-1) if form.vmapped else run)

    def simulation(self, form: Form) -> Any:
        """Return the simulation of a batch of runs, ``(inputs, noise, told)``."""
        run = partial(simulated, form, self.evaluator.compiled.plant)
        return jax.vmap(run, in_axes=(None, -1, -1), out_axes=1) if form.vmapped else run

    def plant(self, runs: int) -> Told:
        """Return what the plant holds in so many runs."""
        held = self.evaluator.held(self.unit, self.evaluator.cases(self.unit), "plant")
        constants, noise = (
            self.evaluator.compiled.plant.constants(held.values),
            (held.process_noise, held.measurement_noise),
        )
        return Told(*(tiled(in_a_row(each, 2), runs) for each in (constants, *noise, held.first, held.first)))

    def wanted(self, kind: str) -> Sums:
        """Return the sums of this project's estimator, on the processor."""
        inputs = self.evaluator.inputs(self.places[kind], self.unit.drive, self.batch, self.believed)
        sums = self.evaluator.sums(self.places[kind], inputs, self.batch, self.holds[kind], keep=False)
        per_run = in_a_row(sums.per_run, 2)
        return Sums(in_a_row(sums.errors, 3)[0], per_run[4], per_run[7])

    def rate(self, form: Form, runs: int, rounds: int) -> tuple[float, float]:
        """Return steps per second, the best of some rounds, and how long it took to compile in s.

        Measurements and truth lie on the device, as this project's do; what a filter is told of its runs is sent in
        each round, and scores come back.
        """
        belief, repeated = self.belief(form.kind, runs), np.arange(runs) % SIMULATED
        seen = Seen(self.seen.inputs, *(jnp.take(jax.device_put(each), repeated, axis=-1) for each in self.seen[1:]))
        begin = time.perf_counter()
        run = self.filter(form).lower(seen, belief).compile()
        compiled = time.perf_counter() - begin
        return runs * self.samples / shortest(lambda: jax.tree.map(np.asarray, run(seen, belief)), rounds), compiled

    def rate_of_simulation(self, form: Form, runs: int, rounds: int) -> tuple[float, float]:
        """Return the same of the simulation, noise drawn; signals and measurements stay on the device."""
        plant, held = self.evaluator.compiled.plant, self.plant(runs)
        inputs = self.evaluator.compiled.drives[self.unit.drive].plant[: self.samples, :, 0]
        width = self.samples, plant.nx + plant.ny, runs

        def drawn_and_simulated(seed: Any, held: Told) -> Any:
            return self.simulation(form)(inputs, jax.random.normal(jax.random.key(seed), width), held)

        begin = time.perf_counter()
        run = jax.jit(drawn_and_simulated).lower(0, held).compile()
        compiled = time.perf_counter() - begin
        return runs * self.samples / shortest(lambda: jax.block_until_ready(run(0, held)), rounds), compiled


def shortest(work: Callable[[], object], rounds: int) -> float:
    """Return how long work takes, the quickest of some rounds; of fewer where it takes long."""
    times: list[float] = []
    while len(times) < rounds and sum(times) < LONG:
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def table_of(
    problem: Problem,
    runs: Sequence[int],
    rounds: int,
    ours: Mapping[str, Sequence[float]],
    forms: Sequence[Form] = FORMS,
) -> Table:
    """Return steps per second of each form, printed as they come, and of this project, as a table.

    Args:
        problem: The problem.
        runs: At once.
        rounds: Of which the quickest counts.
        ours: Steps per second of this project, by kind.
        forms: Those that are measured.
    """
    table = Table(title=f"million steps per second, JAX {jax.__version__} on {jax.devices()[0].device_kind}, float64")
    for name in ("what", "written with", *(f"{n:,} runs" for n in runs), "compiled in s"):
        table.add_column(name, justify="left" if name in ("what", "written with") else "right")
    for kind in dict.fromkeys(form.kind for form in forms):
        best = [0.0] * len(runs)
        for form in (each for each in forms if each.kind == kind):
            measure = problem.rate_of_simulation if kind == SIMULATION else problem.rate
            rates = [measure(form, n, rounds) for n in runs]
            best = [max(rate, most) for (rate, _), most in zip(rates, best, strict=True)]
            row = [f"{rate / 1e6:,.2f}" for rate, _ in rates]
            print("measured:", kind, form.name, *row, flush=True)
            table.add_row(kind, form.name, *row, f"{max(seconds for _, seconds in rates):.0f}")
        table.add_row(kind, "this project", *(f"{rate / 1e6:,.1f}" for rate in ours[kind]))
        times = [f"{rate / most:.2f}" for rate, most in zip(ours[kind], best, strict=True)]
        table.add_row(kind, "this project, times JAX's best", *times, end_section=True)
    return table
