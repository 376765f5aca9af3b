"""What holds for every estimator: small models whose answers are known."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from harness.common.errors import UserError
from harness.config.model import resolve_single
from harness.config.roles import ESTIMATORS
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.kernel_names import Info
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import load_estimator
from harness.runner.contract import Held, InputSeries
from harness.runner.scores import Scoring
from harness.simulation.simulate import in_lanes, variances
from harness.testing.parts import named, require
from harness.testing.small_models import P0, STEP, Q, R, compiled_linear, curved, drive_linear, textbook

SETTINGS: Mapping[str, Any] = {}


def check_estimator(estimator: str | ModuleType, settings: Mapping[str, Any] = SETTINGS) -> None:
    """Check an estimator on small models.

    That it changes no argument, states a symmetric positive definite covariance, survives missing measurements, and
    gives a run the same bits alone and in a batch; that without measurements it only predicts; and, of one that says it
    is of the Kalman type (``KALMAN_TYPE``), that it equals the textbook's filter on a linear model to 1e-10 and follows
    a nonlinear one.

    Args:
        estimator: Its name, or a module that keeps the contract (``harness/estimation/contract.py``).
        settings: Its settings as in a study.

    Raises:
        AssertionError: If something does not hold; the message says what.
        UserError: If a setting does not fit, or the estimator none of the models.
    """
    with named(ESTIMATORS, estimator) as name:
        require(
            ESTIMATORS.load(name).__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows"
        )
        file = load_estimator(name)
        scatters, fitted = bool(file.MONTE_CARLO), hasattr(file, "fit")
        ground = _ground(name, settings)
        _check_arguments(name, ground)
        if file.HAS_COVARIANCE:
            _check_covariance(name, ground)
        _check_missing(name, ground)
        _check_batches(name, ground)
        if not (fitted or scatters):
            _check_only_predicts(name, settings)
        if file.KALMAN_TYPE:
            for missing in (False, True):
                _check_textbook(name, settings, missing)
            if not file.LINEAR:
                _check_follows(name, settings)


class Ground(NamedTuple):
    """An estimator on a model that it fits, with what it believes and data to run on."""

    estimator: CompiledEstimator
    compiled: CompiledModel
    parameters: np.ndarray
    q: np.ndarray
    r: np.ndarray
    p0: np.ndarray
    u: np.ndarray
    y: np.ndarray


def _ground(name: str, settings: Mapping[str, Any], samples: int = 200) -> Ground:
    """Return the small linear model, or the semitrailer for an estimator made for its signals."""
    small = compiled_linear()
    try:
        estimator = CompiledEstimator(name, small, dict(settings))
        u, y, *_ = drive_linear(samples)
        return Ground(estimator, small, np.array([1.5]), Q, R, P0, u, y)
    except UserError:
        if not hasattr(load_estimator(name), "fit"):
            raise
    table = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "series"}
    spec = resolve_single(table, "test")
    truck = compile_model(spec.model(), spec.step, signals=("articulation_angle",))
    q, r = (
        variances(spec.process_noise, truck.model.states),
        variances(spec.measurement_noise, list(truck.model.outputs)),
    )
    rng = np.random.default_rng(3)
    base = np.array([10.0 if i == "speed" else 0.0 for i in truck.model.inputs])
    u, y = base + 0.1 * rng.normal(size=(samples, truck.nu)), 0.05 * rng.normal(size=(samples, truck.ny))
    estimator = CompiledEstimator(name, truck, dict(settings))
    return Ground(estimator, truck, truck.parameter_vector(spec.values), q, r, q, u, y)


def step_through(g: Ground, samples: int | None = None) -> tuple[np.ndarray, np.ndarray, list[Info]]:
    """Step by hand; return means, covariances and infos of lane 0."""
    belief = g.estimator.belief(g.compiled.constants(in_lanes(g.parameters)), in_lanes(g.q), in_lanes(g.r))
    state = g.estimator.init(np.zeros(g.compiled.nx), g.p0)
    means, covariances, infos = [state.mean[:, 0]], [state.covariance[:, :, 0]], []
    for k in range(1, len(g.y) if samples is None else samples):
        state, info = g.estimator.step(state, in_lanes(g.u[k - 1]), in_lanes(g.u[k]), in_lanes(g.y[k]), belief)
        means.append(state.mean[:, 0])
        covariances.append(state.covariance[:, :, 0])
        infos.append(info)
    return np.array(means), np.array(covariances), infos


def _check_textbook(name: str, settings: Mapping[str, Any], missing: bool) -> None:
    u, y, A, B, C = drive_linear()
    if missing:
        y[5, 0] = y[9] = y[20:30, 1] = np.nan
    compiled = compiled_linear()
    g = Ground(CompiledEstimator(name, compiled, dict(settings)), compiled, np.array([1.5]), Q, R, P0, u, y)
    means, covariances, infos = step_through(g)
    computed = means, covariances, np.array([i.log_likelihood[0, 0] for i in infos])
    for what, got, right in zip(("mean", "covariance", "likelihood"), computed, textbook(u, y, A, B, C), strict=True):
        off = float(np.abs(got - np.array(right)).max())
        where = " with missing measurements" if missing else ""
        require(off <= 1e-10, f"{name}: its {what} is {off:.1e} off the textbook's on a linear model{where}")
    require(sum(i.repairs.sum() for i in infos) == 0, f"{name}: it repairs covariances of a harmless model")


def _check_covariance(name: str, g: Ground) -> None:
    _, covariances, _ = step_through(g, 80)
    symmetric = np.array_equal(covariances, covariances.transpose(0, 2, 1))
    require(symmetric, f"{name}: its covariance is not symmetric to the bit")
    require(np.linalg.eigvalsh(covariances).min() > 0, f"{name}: its covariance is not positive definite")


def _check_arguments(name: str, g: Ground) -> None:
    belief = g.estimator.belief(g.compiled.constants(in_lanes(g.parameters)), in_lanes(g.q), in_lanes(g.r))
    state = g.estimator.init(np.zeros(g.compiled.nx), g.p0)
    arguments = (state, in_lanes(g.u[0]), in_lanes(g.u[1]), in_lanes(g.y[1]), belief)

    def flat() -> list[np.ndarray]:
        parts = (a for part in arguments for a in (part if isinstance(part, tuple) else (part,)))
        return [np.copy(a) for a in parts if a is not None]

    before = flat()
    first, _ = g.estimator.step(*arguments)
    same = all(np.array_equal(old, new, equal_nan=True) for old, new in zip(before, flat(), strict=True))
    require(same, f"{name}: a step changes its arguments; write into 'after' and 'info' only")
    again, _ = g.estimator.step(*arguments)
    same = all(np.array_equal(getattr(first, n), getattr(again, n), equal_nan=True) for n in ("mean", "covariance"))
    require(same, f"{name}: the same step gives two results; everything it carries must be in the state")


def _check_only_predicts(name: str, settings: Mapping[str, Any]) -> None:
    u, y, A, B, _ = drive_linear(12)
    y[:] = np.nan
    compiled = compiled_linear()
    g = Ground(CompiledEstimator(name, compiled, dict(settings)), compiled, np.array([1.5]), Q, R, P0, u, y)
    means, covariances, infos = step_through(g)
    x = np.zeros(3)
    for k in range(1, len(y)):
        x = A @ x + B @ u[k - 1]
        close = np.allclose(means[k], x, rtol=0, atol=1e-9)
        require(close, f"{name}: without a measurement it must only predict: {means[k]} instead of {x} at sample {k}")
    silent = all(i.seen.sum() == 0 and i.log_likelihood.sum() == 0 for i in infos)
    require(silent, f"{name}: 'seen' and 'log_likelihood' must be 0 without a measurement")
    stated = not load_estimator(name).HAS_COVARIANCE or np.isfinite(covariances).all()
    require(stated, f"{name}: its covariance is not finite without measurements")


def _check_missing(name: str, g: Ground) -> None:
    for missing in (slice(0, None), slice(20, 40), slice(0, 20)):
        y = g.y[:80].copy()
        y[missing] = np.nan
        means, _, infos = step_through(g._replace(y=y))
        require(np.isfinite(means).all(), f"{name}: an estimate is not finite where measurements are missing")
        seen = [i.seen[0, 0] for i in infos]
        require(seen == list((~np.isnan(y[1:])).sum(axis=1)), f"{name}: 'seen' must count the measurements of a sample")


def _check_batches(name: str, g: Ground) -> None:
    """One run in lane 0 next to others equals the same run next to itself, scores included."""
    rng = np.random.default_rng(8)
    samples, names = len(g.y), (*g.compiled.model.states, *g.compiled.signal_names)
    truth, scatter = (rng.normal(size=(samples, n, LANES)) for n in (len(names), g.compiled.ny))
    y = g.y[:, :, None] * (1.0 + scatter)
    u = g.u[:, :, None] * rng.uniform(0.5, 1.5, (samples, g.compiled.nu, LANES))
    parameters = g.parameters[:, None] * np.linspace(0.9, 1.1, LANES)

    def run(pick: np.ndarray) -> Any:
        def of(a: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(a[..., pick])

        held = Held(of(parameters), in_lanes(g.q), in_lanes(g.r), np.zeros((g.compiled.nx, LANES)), g.p0)
        record = Scoring(of(truth), names, np.full(LANES, float(samples)), keep=True)
        return g.estimator.run(InputSeries(of(u)), of(y), held, record).scores()

    batch = run(np.arange(LANES))
    require(not np.array_equal(batch.rmse[:, 0], batch.rmse[:, 5]), f"{name}: every run has the same error")
    for lane in (0, 5):
        alone = run(np.full(LANES, lane))
        for field in ("rmse", "bias", "max_error", "nees", "nis", "log_likelihood", "kept"):
            in_batch, by_itself = getattr(batch, field)[..., lane], getattr(alone, field)[..., 0]
            same = np.array_equal(in_batch, by_itself, equal_nan=True)
            require(same, f"{name}: a run's {field} depends on the runs next to it")


def _check_follows(name: str, settings: Mapping[str, Any]) -> None:
    """The truth stays inside the stated uncertainty as often as it should, within wide limits."""
    compiled = compile_model(curved(), STEP)
    rng = np.random.default_rng(11)
    samples, q, r = 400, np.array([1e-6, 1e-4]), np.array([1e-3])
    x, y, truth = np.array([0.2, 0.0]), np.empty((samples, 1)), np.empty((samples, 2))
    u = np.sin(0.5 * STEP * np.arange(samples))[:, None]
    for k in range(samples):
        truth[k] = x
        y[k] = np.exp(0.3 * x[0]) + x[0] * x[1] + rng.normal() * r[0] ** 0.5
        x = x + STEP * np.array([x[1], -2.0 * np.sin(x[0]) - 0.2 * x[1] * abs(x[1]) + u[k, 0]])
        x = x + rng.normal(size=2) * np.sqrt(q)
    estimator = CompiledEstimator(name, compiled, dict(settings))
    g = Ground(estimator, compiled, np.array([2.0]), q, r, np.array([0.1, 0.1]), u, y)
    means, covariances, _ = step_through(g)
    error = truth - means
    nees = float(np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariances), error)[50:].mean())
    require(1.0 < nees < 3.5, f"{name}: on a nonlinear model its NEES is {nees:.2f}, it should be near 2")
    share = np.sqrt(np.mean(error[50:, 0] ** 2)) / np.std(truth[50:, 0])
    require(share < 0.5, f"{name}: on a nonlinear model its error is {share:.0%} of the signal")
