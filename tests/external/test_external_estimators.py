"""Estimators of somebody else in a study: in C and Python beside our own, on equal runs."""

import numpy as np
import pytest

from harness.config import build_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import ESTIMATOR_DIVERGED, OK, STATUS
from support.observers import CONTENT, MASS, OF_THE_LIBRARY, compiled, needs_compiler, source


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "observer.py").write_text(source("observer.py"))
    return folder


def external(name, **settings):
    return {"name": name, "kind": "external", **settings}


def study_of(folder, *estimators, **changes):
    return build_study({**CONTENT, "estimator": list(estimators), **changes}, folder / "study.toml")


def scores(study):
    evaluator = StudyEvaluator(study)
    for index in range(evaluator.kernels):
        evaluator.warm_up(index)
    results = [evaluator.evaluate(unit) for design in study.designs for unit in units(study, design)]
    joined = {name: np.concatenate([r[name] for r in results]) for name in results[0]}
    return joined, evaluator.lost()


@needs_compiler
def test_the_same_observer_in_c_and_in_python_beside_our_filter(folder):
    compiled(folder, source("observer.c"))
    estimators = (
        {"name": "EKF", "kind": "ekf"},
        external("Python", python="observer:Observer"),
        external("C", library="libobserver.so", **OF_THE_LIBRARY),
    )
    result, losses = scores(study_of(folder, *estimators))
    alone, _ = scores(study_of(folder, estimators[0]))
    assert (result[STATUS] == OK).all()
    assert losses == []
    for name in ("rmse", "bias", "max_error"):
        ekf, python, c = np.moveaxis(result[name], 2, 0)
        np.testing.assert_allclose(c, python, rtol=1e-12, atol=1e-15)
        assert ekf.tobytes() == alone[name][:, :, 0].tobytes()
    assert (result["rmse"][..., 0] < 0.01).all()  # m/s


# --- faults: what is lost is the run itself

FAULTY = """
import os, sys, time

class Faulty:
    inputs, measurements, estimates = (), ("yaw_rate",), ("yaw_rate",)

    def __init__(self, how):
        self.how, self.hangs = how, 30.0

    def reset(self, values, step):
        self.k, self.bad = 0, values["mass"] > 1200.0
        if self.how == "reset" and self.bad:
            raise ValueError("no")

    def step(self, inputs, measurements, dt):
        self.k += 1
        if self.bad and self.k == 51:
            return getattr(self, self.how, self.good)(measurements)
        return self.good(measurements)

    def good(self, y): return 0.0 if self.k == 1 else y[0]
    def crash(self, y): os.kill(os.getpid(), 11)
    def leave(self, y): os._exit(3)
    def exit(self, y): sys.exit(2)
    def hang(self, y): time.sleep(self.hangs)
    def error(self, y): raise KeyError("gain")
    def nothing(self, y): return float("nan")
    def infinite(self, y): return float("inf")
    def shape(self, y): return [1.0, 2.0]
    def words(self, y): return "much"
    def interrupt(self, y): raise KeyboardInterrupt
    def shout(self, y):
        for _ in range(50): os.write(1, b"x" * 100_000); os.write(2, b"y" * 100_000)
        return y[0]
"""

AT_50 = 50 * 0.01


@pytest.fixture(scope="module")
def unharmed(folder):
    (folder / "faulty.py").write_text(FAULTY)
    return scores(study_of(folder, {"name": "EKF", "kind": "ekf"}, faulty("good")))[0]


def faulty(how):
    return external("faulty", python="faulty:Faulty", settings={"how": how}, timeout="2 s")


@pytest.mark.parametrize(
    ("how", "since", "words"),
    [
        ("reset", 0.01, "ValueError: no (faulty.py, line 13)"),
        ("crash", 0.01, "its process was ended by SIGSEGV"),
        ("leave", 0.01, "its process ended with status 3"),
        ("exit", AT_50, "it called sys.exit(2)"),
        ("error", AT_50, "KeyError: 'gain' (faulty.py, line 26)"),
        ("nothing", AT_50, "its estimate of 'yaw_rate' is no number"),
        ("infinite", AT_50, "its estimate of 'yaw_rate' is no number"),
        ("shape", AT_50, "ValueError: setting an array element with a sequence."),
        ("words", AT_50, "ValueError: could not convert string to float: 'much'"),
        ("interrupt", AT_50, "it raised KeyboardInterrupt"),
        ("shout", None, ""),
    ],
)
def test_a_fault_loses_its_run_and_all_others_keep_their_bits(folder, unharmed, how, since, words):
    study = study_of(folder, {"name": "EKF", "kind": "ekf"}, faulty(how))
    result, losses = scores(study)
    lost = np.zeros(result[STATUS].shape, dtype=bool)
    lost[1:, :, 1] = since is not None  # the level of 1600 kg
    assert (result[STATUS] == np.where(lost, ESTIMATOR_DIVERGED, OK)).all()
    if since is not None:
        np.testing.assert_allclose(result["time_of_divergence"][lost], since, rtol=1e-9)
        assert losses == [f"faulty:Faulty: 11 runs lost: {words}"]
    for name, values in unharmed.items():
        if values.ndim > 2:  # lost_control is of the plant
            assert result[name][~lost].tobytes() == values[~lost].tobytes(), name


def test_what_hangs_is_ended_after_the_stated_time(folder, unharmed):
    design = {"name": "mass", "repeats": 2, "factor": [MASS]}
    result, losses = scores(study_of(folder, faulty("hang"), design=[design]))
    assert losses == ["faulty:Faulty: 2 runs lost: it gave no answer within 2 s and was ended"]
    assert (result[STATUS][:, :, 0] == [[OK] * 2, [ESTIMATOR_DIVERGED] * 2]).all()
