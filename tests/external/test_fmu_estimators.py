"""Observers that are FMUs."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.external.fmu.estimators import load
from harness.external.fmu.read import observer
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


@pytest.mark.parametrize("version", [2, 3])
def test_an_observer_gets_what_an_ecu_gets(version, tmp_path):
    body = load(observer(make(tmp_path, OBSERVER, version), MAP, NAMES))
    samples = 50
    steer, rate = np.sin(0.2 * np.arange(samples)), np.cos(0.3 * np.arange(samples))
    rate[::7] = np.nan
    expected, x, last = [], 0.0, 0.0
    for k in range(samples):
        last = last if np.isnan(rate[k]) else rate[k]
        if k > 0:
            x += 0.1 * 10.0 * (0.0 if np.isnan(rate[k]) else 0.5 * (last - x)) + 0.1 * np.degrees(steer[k])
        expected.append((x, last))
    for _ in range(2):
        out = body.estimate(0.1, steer[:, None], rate[:, None], np.zeros(0), 1)
        assert (out.reached, out.reason) == (samples, "")
        np.testing.assert_allclose(out.estimates[:, 0], [e[0] for e in expected], rtol=1e-12)
        np.testing.assert_array_equal(out.nis, [e[1] for e in expected])
        np.testing.assert_array_equal(out.variances, 4.0)


def test_settings_are_parameters_and_names_of_signals_need_no_map(tmp_path):
    plain = Equations({"yaw_rate": "rad/s"}, {"sideslip_angle": "rad"}, {"gain": ("", 2.0)}, {}, "y[0] = p[0] * u[0];")
    names = {"inputs": [], "measurements": ["yaw_rate"], "estimates": ["sideslip_angle"]}
    loader = observer(make(tmp_path, plain), None, names)
    out = load({**loader, "settings": {"gain": 3.0}}).estimate(0.1, np.zeros((3, 0)), np.ones((3, 1)), np.zeros(0), 1)
    np.testing.assert_array_equal(out.estimates[:, 0], 3.0)
    assert out.variances is None
    assert out.nis is None


def test_an_observer_that_fails_says_when(tmp_path):
    path = make(tmp_path, OBSERVER.faulty(STEP="if (t >= 1.0) return 3;"))
    out = load(observer(path, MAP, NAMES)).estimate(0.1, np.zeros((30, 1)), np.zeros((30, 1)), np.zeros(0), 1)
    assert out.reached == 11
    assert "returned error" in out.reason


def test_an_observer_for_model_exchange_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"offers model-exchange, not co-simulation"):
        observer(make(tmp_path, OBSERVER, 2, "me"), MAP, NAMES)
