"""A plant and a filter that are no kernels, in the same study: NumPy objects that fulfil the runner's contracts."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from harness.config import build_study
from harness.engine.simd.lanes import LANES
from harness.runner.contract import Batch, Filter, History, Ports, Simulator
from harness.runner.history import EverySample
from harness.runner.simulation_loop import LARGEST
from harness.study.compiled_study import CompiledStudy
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case
from harness.study.score_names import ESTIMATOR_DIVERGED, OK, PLANT_DIVERGED, STATUS
from support.largest_nis import LargestNis

CONTENT = {
    "name": "foreign",
    "seed": 3,
    "targets": ["lateral_velocity", "yaw_rate"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
    "design": [{"name": "mass", "repeats": 11, "factor": [{"parameter": "mass", "levels": [1000.0, 1600.0]}]}],
}


class Equations:
    """Equations of a model in NumPy, for arrays ``(..., n, LANES)``; Euler's steps."""

    def __init__(self, spec, signals):
        model, self.step = spec.model(), spec.step
        self.ports = Ports.of(model)
        self.limits = model.limits[:, None]
        given = [sp.Symbol(n, real=True) for n in (*model.states, *model.inputs, *model.parameter_names)]
        states = sp.Matrix(given[: len(model.states)])
        rates = sp.Matrix([model.expand(e) for e in model.derivatives])
        outputs = sp.Matrix([model.expand(e) for e in model.outputs.values()])
        published = sp.Matrix([model.expand(model.resolve(n)) for n in signals])
        parts = rates, outputs, published, rates.jacobian(states), outputs.jacobian(states), published.jacobian(states)
        self._functions = [sp.lambdify(given, list(part), "numpy") for part in parts]
        self._shapes = [part.shape for part in parts]

    def _value(self, which, x, u, values):
        rows = [*np.moveaxis(x, -2, 0), *u, *np.moveaxis(values, -2, 0)]
        shape, like = self._shapes[which], np.zeros(x.shape[:-2] + x.shape[-1:])
        entries = np.stack([like + each for each in self._functions[which](*rows)], axis=-2)
        return entries if shape[1] == 1 else entries.reshape(*like.shape[:-1], *shape, like.shape[-1])

    def ahead(self, x, u, values):
        return x + self.step * self._value(0, x, u, values)

    def outputs(self, x, u, values):
        return self._value(1, x, u, values)

    def published(self, x, u, values):
        return self._value(2, x, u, values)

    def slopes(self, x, u, values):
        eye = np.eye(x.shape[-2])[:, :, None]
        return (
            eye + self.step * self._value(3, x, u, values),
            self._value(4, x, u, values),
            self._value(5, x, u, values),
        )

    def outside(self, x):
        return ~(np.abs(x) <= self.limits).all(axis=-2)


class NumpyPlant:
    """A plant without a kernel."""

    def __init__(self, spec, signals, lost=()):
        self._equations, self._signals, self._lost = Equations(spec, signals), signals, lost
        self.ports = self._equations.ports

    def run(self, inputs, held, noise, record):
        assert record.names == self._signals
        samples, nx, e = len(inputs.at), len(self.ports.states), self._equations
        largest = np.array([record.largest.get(n, np.inf) for n in record.names])[:, None]
        deviations = np.sqrt(np.concatenate([held.process_noise, held.measurement_noise], axis=-2))
        truth, measured, x = [], [], held.first
        left_at = np.full((*noise.shape[:-3], LANES), 1.0 * samples)
        for k in range(samples):
            scattered = deviations * noise[..., k, :, :]
            truth.append(e.published(x, inputs.at[k], held.values))
            measured.append(e.outputs(x, inputs.at[k], held.values) + scattered[..., nx:, :])
            bad = e.outside(x) | ~(np.abs(truth[-1]) <= largest).all(axis=-2)
            left_at = np.where(bad & (left_at > k), k, left_at)
            x = e.ahead(x, inputs.at[k], held.values) + scattered[..., :nx, :]
        for lane in self._lost:  # as if an instance had crashed
            left_at[..., lane] = 100.0
        return Batch(np.stack(truth, axis=-3), np.stack(measured, axis=-3), left_at)


class NumpyFilter:
    """An extended Kalman filter without a kernel."""

    has_covariance, is_random = True, False

    def __init__(self, spec, signals, broken=False):
        self._equations, self.signals, self._broken = Equations(spec, signals), signals, broken
        self.ports, self.gives = self._equations.ports, np.ones(len(signals), dtype=bool)

    def run(self, inputs, measurements, held, record):
        e, kept = self._equations, []
        (samples, ny), nx, u, values = measurements.shape[-3:-1], len(self.ports.states), inputs.at, held.values
        shape = np.zeros((*measurements.shape[:-3], 1, LANES))
        x, P = held.first + shape, np.eye(nx)[:, :, None] * held.first_variance[..., None, :, :]
        Q, R = (
            np.eye(n)[:, :, None] * v[..., None, :, :]
            for n, v in ((nx, held.process_noise), (ny, held.measurement_noise))
        )
        for k in range(samples):
            innovation, S, facts = (
                np.full((*shape.shape[:-2], ny, LANES), np.nan),
                R * np.nan,
                np.zeros((*shape.shape[:-2], 5, LANES)),
            )
            facts[..., 0, :] = np.nan
            if k:
                A, _, _ = e.slopes(x, u[k - 1], values)
                P = np.einsum("...ijl,...jkl,...mkl->...iml", A, P, A) + Q
                x = e.ahead(x, u[k - 1], values)
                _, H, _ = e.slopes(x, u[k], values)
                innovation = measurements[..., k, :, :] - e.outputs(x, u[k], values)
                S = np.einsum("...ijl,...jkl,...mkl->...iml", H, P, H) + R
                inverse = np.moveaxis(np.linalg.inv(np.moveaxis(S, -1, -3)), -3, -1)
                K = np.einsum("...ijl,...kjl,...kml->...iml", P, H, inverse)
                x = x + np.einsum("...ijl,...jl->...il", K, innovation)
                P = P - np.einsum("...ijl,...jkl,...mkl->...iml", K, S, K)
                nis = np.einsum("...il,...ijl,...jl->...l", innovation, inverse, innovation)
                logarithm = np.linalg.slogdet(np.moveaxis(S, -1, -3))[1]
                likelihood = -0.5 * (nis + logarithm + ny * np.log(2 * np.pi))
                outside = e.outside(x) | (self._broken and k >= 200)
                facts = np.stack([nis, nis * 0 + ny, likelihood, nis * 0, outside], axis=-2)
            _, _, J = e.slopes(x, u[k], values)
            spread = np.einsum("...ijl,...jkl,...ikl->...il", J, P, J)
            published = e.published(x, u[k], values)
            kept.append((x, P, published, np.sqrt(spread), P[..., :0, :0, :], innovation, S, facts))
        columns = zip(*kept, strict=True)
        ranks = 2, 3, 2, 2, 3, 2, 3, 2
        history = (np.stack(each, axis=-rank - 1) for each, rank in zip(columns, ranks, strict=True))
        return record.of(History(*history), self)


@pytest.fixture(scope="module")
def study():
    return build_study(CONTENT, "foreign.toml")


@pytest.fixture(scope="module")
def evaluator(study):
    return StudyEvaluator(study)


def with_foreign(study, lost=(), broken=False):
    """Return the study with a plant in NumPy and its first filter in NumPy."""
    compiled = CompiledStudy(study)
    plant: Simulator = NumpyPlant(study.plant, compiled.recorded.names, lost)
    filter_: Filter = NumpyFilter(study.belief, compiled.signals, broken)
    return StudyEvaluator(study, plant, {"EKF": filter_})


@pytest.mark.parametrize("at_once", [1, 2**30])
def test_a_foreign_plant_and_filter_score_as_kernels_do(study, evaluator, at_once, monkeypatch):
    """One batch at a time, and several with their axis in front."""
    monkeypatch.setattr("harness.study.evaluate._SIMULATED_AT_ONCE", at_once)
    foreign = with_foreign(study)
    for unit in units(study, study.designs[0]):
        wanted, got = evaluator.evaluate(unit), foreign.evaluate(unit)
        assert (got[STATUS] == OK).all()
        for name, values in wanted.items():
            np.testing.assert_allclose(got[name], values, rtol=1e-12, atol=1e-14, err_msg=name)


def test_lost_runs_are_counted_and_all_others_keep_their_bits(study):
    (unit, *_) = units(study, study.designs[0])
    whole = with_foreign(study).evaluate(unit)
    crashed = with_foreign(study, lost=(3,)).evaluate(unit)
    gone = np.zeros(whole[STATUS].shape[:2], dtype=bool)
    gone.reshape(-1)[3::LANES] = True
    assert (crashed[STATUS][gone] == PLANT_DIVERGED).all()
    assert (crashed["time_of_divergence"][gone] == 100 * study.plant.step).all()
    for name, values in whole.items():
        assert crashed[name][~gone].tobytes() == values[~gone].tobytes(), name
    broken = with_foreign(study, broken=True).evaluate(unit)
    assert (broken[STATUS][:, :, 0] == ESTIMATOR_DIVERGED).all()
    assert (broken[STATUS][:, :, 1] == OK).all()
    assert broken["rmse"][:, :, 1].tobytes() == whole["rmse"][:, :, 1].tobytes()


def test_every_sample_of_a_foreign_filter_is_that_of_the_kernel(study, evaluator):
    unit, case = units(study, study.designs[0])[0], [Case(0, 0)]
    batch, believed = evaluator.simulate(unit, case), evaluator.held(unit, case, "belief")
    held, inputs = evaluator.believed_by(0, unit, case, believed), evaluator.inputs(0, 0, batch, believed)
    record, measured = EverySample(of_signals=True), evaluator.compiled.measured(batch.measurements)
    wanted = evaluator.compiled.estimators[0].run(inputs, measured, held, record)
    got = with_foreign(study).compiled.estimators[0].run(inputs, measured, held, record)
    for name, values in vars(wanted).items():
        np.testing.assert_allclose(getattr(got, name), values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_a_recorder_of_somebody_else_goes_with_kernels_and_with_other_filters(study, evaluator):
    unit = units(study, study.designs[0])[0]
    cases = evaluator.cases(unit)[:LANES]
    batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
    held, inputs = evaluator.believed_by(0, unit, cases, believed), evaluator.inputs(0, 0, batch, believed)
    measured = evaluator.compiled.measured(batch.measurements)
    filters = evaluator.compiled.estimators[0], with_foreign(study).compiled.estimators[0]
    by_kernel, by_history = (each.run(inputs, measured, held, LargestNis()) for each in filters)
    np.testing.assert_allclose(by_kernel, by_history, rtol=1e-9)
    assert len(set(by_kernel)) == LANES
    assert (by_kernel > 0).all()


def test_scores_of_a_history_are_those_that_the_kernel_sums_up(study, evaluator):
    """Where scoring begins late, a target is not given and a number is too large to score."""
    unit = units(study, study.designs[0])[0]
    cases = evaluator.cases(unit)[:LANES]
    batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
    held, inputs = evaluator.believed_by(0, unit, cases, believed), evaluator.inputs(0, 0, batch, believed)
    late = with_foreign(replace(study, score_after=1.0))
    late.compiled.estimators[0].gives[1] = False
    late_kernel = StudyEvaluator(replace(study, score_after=1.0))
    late_kernel.compiled.estimators[0].gives[1] = False
    wanted, got = (each.sums(0, inputs, batch, held, True).scores() for each in (late_kernel, late))
    assert np.isnan(got.rmse[1]).all()
    for name in ("rmse", "bias", "max_error", "nees", "nees_inside", "nis", "nis_inside", "log_likelihood", "updates"):
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-12, err_msg=name)
    large = replace(batch, measurements=batch.measurements.copy())
    large.measurements[300, 0, 2] = 10 * LARGEST
    wanted, got = (each.sums(0, inputs, large, held, False).scores() for each in (late_kernel, late))
    np.testing.assert_array_equal(got.diverged_at, wanted.diverged_at)
    assert got.diverged_at[2] == 300
