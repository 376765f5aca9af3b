"""An FMU as the belief of a filter: the same estimates as the harness's own filter of the same equations."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import build_study, resolve_single
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.external.fmu import belief
from harness.runner.contract import Held, InputSeries
from harness.runner.history import EverySample
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from support import fmus

pytestmark = fmus.needs_compiler

CAR = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"}
OUTPUTS = ("lateral_velocity", "yaw_rate", "lateral_acceleration")
Q, R, STEP = {"lateral_velocity": 4e-6, "yaw_rate": 2e-6}, {"yaw_rate": 3e-6, "lateral_acceleration": 0.01}, 0.01


@pytest.fixture(scope="module")
def car():
    shape = {"shape_factor_front": 1.4, "shape_factor_rear": 1.4}
    return resolve_single({**CAR, "values": shape}, "car", "belief")


@pytest.fixture(scope="module", params=[2, 3])
def fmu(request, car, tmp_path_factory):
    equations = fmus.of_model(car.model(), car.values, OUTPUTS)
    return fmus.make(tmp_path_factory.mktemp("fmu"), equations, request.param, "me")


@pytest.fixture(scope="module")
def drive():
    """Steering, speed and what a car with noise measures, some of it missing."""
    rng, k = np.random.default_rng(5), np.arange(400)
    inputs = np.column_stack([0.9 * np.sin(0.03 * k), 14.0 + 0.004 * k])
    measured = np.column_stack([0.1 * np.sin(0.03 * k - 0.2), 1.9 * np.sin(0.03 * k - 0.1)])
    measured += rng.standard_normal(measured.shape) * np.sqrt(list(R.values()))
    measured[rng.random(measured.shape) < 0.2] = np.nan
    measured[:30, 1] = np.nan
    measured[0] = np.nan
    return inputs, measured


def loader(fmu, filter="ukf", **settings):
    return {
        "file": str(fmu),
        "filter": filter,
        "measurements": list(R),
        "estimates": ["lateral_velocity", "yaw_rate"],
        "settings": {
            "process_noise": {f"x.{n}": q for n, q in Q.items()},
            "measurement_noise": R,
            **settings,
        },
    }


def own(car, drive, kind="ukf", settings=None):
    inputs, measured = drive
    compiled = compile_model(car.model(), STEP, signals=("lateral_velocity", "yaw_rate"))
    believed = (np.array(list(v))[:, None] * np.ones(LANES) for v in (car.values.values(), Q.values(), R.values()))
    held = Held(*believed, first=np.zeros((2, LANES)))
    table, seen = (np.repeat(each[..., None], LANES, axis=-1) for each in (inputs, measured))
    return CompiledEstimator(kind, compiled, settings).run(InputSeries(table), seen, held, EverySample(of_signals=True))


def test_an_unscented_filter_over_an_fmu_is_that_of_the_equations(car, fmu, drive):
    inputs, measured = drive
    got = belief.load(loader(fmu)).estimate(STEP, inputs, measured, np.empty(0), 0)
    wanted = own(car, drive)
    assert got.reached == len(inputs)
    np.testing.assert_allclose(got.estimates, wanted.mean, rtol=1e-9, atol=1e-12)
    seen = ~np.isnan(measured).all(axis=1)
    np.testing.assert_allclose(got.nis[seen], wanted.facts[seen, 0], rtol=1e-7)
    variances = np.einsum("kii->ki", wanted.state_covariance)
    np.testing.assert_allclose(got.variances[1:], variances[1:], rtol=1e-7)


def test_an_ensemble_over_an_fmu_scatters_around_the_unscented_filter(fmu, drive):
    """By a share of the standard deviation that falls with the root of its members."""
    inputs, measured = drive
    unscented = belief.load(loader(fmu)).estimate(STEP, inputs, measured, np.empty(0), 0)
    share = {}
    for members in (100, 1600):
        filter_ = belief.load(loader(fmu, filter="enkf", members=members))
        first, again = (filter_.estimate(STEP, inputs, measured, np.empty(0), 7) for _ in range(2))
        assert again.estimates.tobytes() == first.estimates.tobytes()
        distance = np.abs(first.estimates - unscented.estimates)[50:] / np.sqrt(unscented.variances[50:])
        share[members] = distance.mean()
    assert 0.0 < share[1600] < 0.2
    assert 0.15 < share[1600] / share[100] < 0.4
    np.testing.assert_allclose(first.variances[50:].mean(axis=0), unscented.variances[50:].mean(axis=0), rtol=0.1)


def test_runs_that_follow_each_other_do_not_know_of_each_other(fmu, drive):
    inputs, measured = drive
    filter_ = belief.load(loader(fmu, parameters={"mass": 2500.0}))
    first = filter_.estimate(STEP, inputs, measured, np.empty(0), 0)
    filter_.estimate(STEP, -inputs, measured, np.empty(0), 0)
    assert filter_.estimate(STEP, inputs, measured, np.empty(0), 0).estimates.tobytes() == first.estimates.tobytes()
    nominal = belief.load(loader(fmu)).estimate(STEP, inputs, measured, np.empty(0), 0)
    assert np.abs(nominal.estimates - first.estimates).max() > 1e-3


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"filter": "ekf"}, "there are: ukf, enkf"),
        ({"process_noise": {"yaw": 1.0}}, r"no continuous state; there are: x\.lateral_velocity, x\.yaw_rate"),
        ({"proces_noise": {}}, "unknown key 'proces_noise'"),
        ({"parameters": {"mas": 1.0}}, "mas"),
    ],
)
def test_settings_that_do_not_fit_are_refused(fmu, settings, words):
    with pytest.raises(UserError, match=words):
        belief.load(loader(fmu, **settings))


def test_a_filter_over_an_fmu_is_an_estimator_of_a_study(car, fmu, tmp_path):
    """It scores as the filter of the equations, also where its parameters and its noise are varied."""
    values = {**car.values}
    noise = {"process": Q, "measurement": R}
    model = {"vehicle": "car", "tyre": "magic_formula", "sensors": "car_series", "values": values, "noise": noise}
    over_fmu = {
        "kind": "external",
        "fmu": str(fmu),
        "filter": "ukf",
        "estimates": ["lateral_velocity", "yaw_rate"],
        "values": ["mass", "measurement_noise.yaw_rate", "measurement_noise.lateral_acceleration"],
        "settings": {"process_noise": {f"x.{n}": q for n, q in Q.items()}},
    }
    masses = [{"parameter": "mass", "of": "belief", "levels": [1800.0, 2300.0]}]
    study = build_study(
        {
            "name": "belief",
            "targets": ["lateral_velocity", "yaw_rate"],
            "plant": model,
            "drive": [{"name": "sine", "kind": "sine", "duration": "2 s", "lead_in": "0 s", "amplitude": "30 deg"}],
            "estimator": [{"kind": "ukf", "name": "own"}, {**over_fmu, "name": "over the FMU"}],
            "design": [{"name": "mass", "repeats": 2, "factor": masses}],
        },
        tmp_path / "study.toml",
    )
    evaluator = StudyEvaluator(study)
    for unit in units(study, study.designs[0]):
        result = evaluator.evaluate(unit)
        assert (result["status"] == 0).all()
        for name in ("rmse", "nis"):
            np.testing.assert_allclose(result[name][:, :, 1], result[name][:, :, 0], rtol=1e-7, err_msg=name)
    assert evaluator.lost() == []
