"""Observers that are FMUs."""

from dataclasses import replace

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.config import build_study
from harness.external.fmu.estimators import load
from harness.realtime.measure import contestants, measure
from harness.realtime.outcome import judge
from harness.realtime.report import answer
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import OK, STATUS
from support.fmus import Equations, make, needs_compiler

pytestmark = needs_compiler

OBSERVER = Equations(
    {"steer": "deg", "r": ""}, {"beta": "rad", "variance": "", "s": ""}, {"gain": ("", 0.5)}, {"b": 0.0},
    "dx[0] = 10.0 * ((m->b[0] ? p[0] * (u[1] - x[0]) : 0.0) + 0.1 * u[0]); y[0] = x[0]; y[1] = 4.0; y[2] = u[1];",
    flags=("valid_yaw_rate",),
)  # fmt: skip
MAP = {
    "inputs": {"steering_wheel_angle": "steer"},
    "measurements": {"yaw_rate": {"variable": "r", "unit": "rad/s"}},
    "estimates": {"sideslip_angle": "beta"},
    "variances": {"sideslip_angle": "variance"},
    "nis": "s",
}
NAMES = {"inputs": ["steering_wheel_angle"], "measurements": ["yaw_rate"], "estimates": ["sideslip_angle"]}


def observer(path, content=MAP, **loader):
    given = dict(loader)
    if content:
        chosen = path.with_suffix(".toml")
        chosen.write_text(toml_text(content))
        given["settings"] = {**loader.get("settings", {}), "map": str(chosen)}
    return load({"file": str(path), **given})


@pytest.mark.parametrize("version", [2, 3])
def test_an_observer_gets_what_an_ecu_gets(version, tmp_path):
    body = observer(make(tmp_path, OBSERVER, version), **NAMES)
    samples = 50
    steer, rate = np.sin(0.2 * np.arange(samples)), np.cos(0.3 * np.arange(samples))
    rate[::7] = np.nan
    expected, x, last = [], 0.0, 0.0
    for k in range(samples):
        last = last if np.isnan(rate[k]) else rate[k]
        if k > 0:
            x += 0.1 * 10.0 * (0.0 if np.isnan(rate[k]) else 0.5 * (last - x)) + 0.1 * np.degrees(steer[k])
        expected.append((x, last))
    assert body.declared() == {**NAMES, "variances": True, "nis": True}
    for _ in range(2):
        out = body.estimate(0.1, steer[:, None], rate[:, None], np.zeros(0), 1)
        assert (out.reached, out.reason) == (samples, "")
        np.testing.assert_allclose(out.estimates[:, 0], [e[0] for e in expected], rtol=1e-12)
        np.testing.assert_array_equal(out.nis, [e[1] for e in expected])
        np.testing.assert_array_equal(out.variances, 4.0)


PLAIN = Equations(
    {"yaw_rate": "rad/s", "speed": "km/h"}, {"sideslip_angle": "rad"}, {"gain": ("", 2.0), "m": ("t", 1.0)}, {},
    "y[0] = p[0] * u[0] + p[1];",
)  # fmt: skip


def test_names_of_signals_need_no_map_and_values_are_parameters(tmp_path):
    body = observer(make(tmp_path, PLAIN), None, values=["m"], settings={"gain": 3.0})
    assert body.declared()["measurements"] == ["yaw_rate"]
    assert body.declared()["inputs"] == ["speed"]
    for mass in (2000.0, 3000.0):
        out = body.estimate(0.1, np.zeros((3, 1)), np.ones((3, 1)), np.array([mass]), 1)
        np.testing.assert_array_equal(out.estimates[:, 0], 3.0 + mass / 1000)
    assert out.variances is None
    assert out.nis is None


def test_an_observer_that_fails_says_when(tmp_path):
    body = observer(make(tmp_path, OBSERVER.faulty(STEP="if (t >= 1.0) return 3;")))
    out = body.estimate(0.1, np.zeros((30, 1)), np.zeros((30, 1)), np.zeros(0), 1)
    assert out.reached == 11
    assert "returned error" in out.reason


UNFIT = [
    (MAP | {"variances": {"yaw_rate": "variance"}}, {}, "there is none of sideslip_angle"),
    (MAP | {"nis": "nobody"}, {}, "nis: the FMU has no variable 'nobody'"),
    (MAP | {"valid": {"yaw_rate": "nobody"}}, {}, "there is no input 'nobody'"),
    (MAP | {"estimates": {}}, {}, "estimates something"),
    (MAP | {"outputs": {}}, {}, "unknown table 'outputs'"),
    (MAP, {"values": ["gian"]}, "no parameter 'gian'; closest: gain"),
    (MAP, {"estimates": ["yaw_acceleration"]}, "no variable 'yaw_acceleration'"),
]


@pytest.mark.parametrize(("content", "loader", "reason"), UNFIT)
def test_an_observer_that_does_not_do_is_refused(content, loader, reason, tmp_path):
    with pytest.raises(UserError, match=reason):
        observer(make(tmp_path, OBSERVER), content, **loader)


def test_an_observer_for_model_exchange_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"offers model-exchange, not co-simulation"):
        observer(make(tmp_path, OBSERVER, 2, "me"))


GOVINDARAJAN = {
    "name": "foreign",
    "seed": 3,
    "targets": ["yaw_rate"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [{"name": "sine", "kind": "sine", "duration": "3 s", "lead_in": "0 s", "speed": "15 m/s"}],
    "design": [{"name": "mass", "repeats": 2, "factor": [{"parameter": "mass", "levels": [1000.0, 1600.0]}]}],
}


@pytest.fixture
def beside(tmp_path):
    """Return a study of our filter and an FMU that takes the measurement for the yaw rate."""
    follows = Equations(
        {"yaw_rate": "deg/s"}, {"r": "deg/s"}, {"gain": ("", 1.0)}, {"b": 0.0},
        "dx[0] = 100.0 * p[0] * (u[0] - x[0]); y[0] = x[0];",
    )  # fmt: skip
    make(tmp_path, follows)
    (tmp_path / "observer.toml").write_text('[measurements]\nyaw_rate = "yaw_rate"\n[estimates]\nyaw_rate = "r"\n')
    foreign = {"name": "FMU", "kind": "external", "fmu": "truck_2_cs.fmu", "settings": {"map": "observer.toml"}}
    return build_study({**GOVINDARAJAN, "estimator": ["ekf", foreign]}, tmp_path / "study.toml")


def test_an_fmu_is_left_out_where_steps_are_timed_and_the_others_are_not(beside):
    field = contestants(beside, "sine", 1.0)
    outcome = judge(measure(field, 101, 0.002), beside, "sine")
    assert outcome["estimator"].values.tolist() == ["ekf"]
    assert "Not timed: FMU" in answer(outcome)
    with pytest.raises(UserError, match="has no other estimator"):
        contestants(replace(beside, estimators=beside.estimators[1:]), "sine", 1.0)


def test_an_observer_in_a_study_stands_beside_our_filter(beside):
    study, evaluator = beside, StudyEvaluator(beside)
    results = [evaluator.evaluate(unit) for design in study.designs for unit in units(study, design)]
    assert evaluator.lost() == []
    assert all((r[STATUS] == OK).all() for r in results)
    ekf, fmu = np.moveaxis(np.concatenate([r["rmse"] for r in results])[..., 0], 2, 0)
    assert (ekf > 0).all()
    noise = study.belief.measurement_noise["yaw_rate"] ** 0.5  # it takes the measurement for the yaw rate
    np.testing.assert_allclose(fmu, noise, rtol=0.15)
