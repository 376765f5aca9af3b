"""The estimators of a trace are compiled before the first of them runs, some of them in further processes."""

import pickle

import pytest

from harness.config import resolve_single
from harness.diagnosis.result import estimator_gain
from harness.diagnosis.result.estimator_gain import EstimatorKernels, compile_estimators
from harness.engine.compile import is_on_disk
from support.driven_car import CAR, driven


@pytest.fixture(scope="module")
def models():
    return tuple(resolve_single({**CAR, "effects": list(e), "step": "10 ms"}, "test") for e in ((), ("road_grade",)))


@pytest.fixture(scope="module")
def recording():
    return driven(7, duration=5.0)


def test_each_estimator_is_compiled_with_each_model_here_or_in_a_further_process(models, recording, monkeypatch):
    asked = []
    monkeypatch.setattr(estimator_gain, "compile_all", lambda *given: asked.append(given))
    compile_estimators(models, ("ekf", "ukf"), recording, 3, print)
    kernels, again, further, _ = asked[0]
    made = pickle.loads(pickle.dumps(again))()
    assert [len(set(map(id, k.loops))) for k in (kernels, made)] == [4, 4]
    assert [further(missing) for missing in (0, 1, 2, 3, 4)] == [-1, 0, 1, 2, 2]
    assert [made.warm_up(i) for i in range(made.kernels)] == ["ekf", "ekf", "ukf", "ukf"]
    assert all(is_on_disk(loop) and loop.signatures for loop in made.loops)
    assert [loop.__module__ for loop in made.loops] == [loop.__module__ for loop in kernels.loops]


def test_what_cannot_be_compiled_is_told_where_it_runs(models, recording):
    kernels = EstimatorKernels(models, ("ekf",), recording.drop_vars("yaw_rate"))
    assert kernels.warm_up(1) == "ekf"
