"""What holds for every kernel in ``harness/estimation/methods``; the check is tried on wrong ones."""

import textwrap

import pytest

import harness
from harness.common import components
from harness.estimation.contract import kernel_kinds
from harness.testing import check_estimator


@pytest.mark.parametrize("name", kernel_kinds())
def test_every_estimator(name):
    check_estimator(name)


# --- the check finds what it is for

PREDICTOR = """
    \"\"\"Only predicts.\"\"\"
    import numpy as np
    from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_covariance, put, splat, is_nan, select

    KALMAN_TYPE = False


    def workspace():
        return (np.empty((NW, LANES)),)


    def step(before, u_before, u, y, belief, work, after, info):
        (w,) = work
        next_covariance(before.mean, u_before, belief.constants, before.covariance, after.mean, after.covariance, w)
        for i in range(NX):
            put(get(after.covariance, i, i) + get(belief.process_noise, i), after.covariance, i, i)
        seen = splat(0.0)
        for j in range(NY):
            seen = seen + select(is_nan(get(y, j)), splat(0.0), splat(1.0))
        put(seen, info.seen, 0)
        put(splat(0.0), info.log_likelihood, 0)
        put(splat(0.0), info.repairs, 0)
"""


@pytest.fixture
def predictor(tmp_path):
    def make(*replacements):
        text = textwrap.dedent(PREDICTOR)
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "predictor.py"
        path.write_text(text)
        return harness.register("estimators", path).__name__.rpartition(".")[2]

    yield make
    components.unregister("estimators", "predictor")


def test_a_right_estimator_passes(predictor):
    check_estimator(predictor())


@pytest.mark.parametrize(
    ("replacement", "says"),
    [
        (("KALMAN_TYPE = False", "KALMAN_TYPE = True"), "off the textbook's on a linear model"),
        (("put(seen, info", "put(splat(1.0), info"), "'seen' must"),
        (
            ("    seen = splat(0.0)", "    put(splat(7.0), before.mean, 0)\n    seen = splat(0.0)"),
            "changes its arguments",
        ),
        (("+ get(belief.process_noise, i)", "- splat(1e3)"), "not positive definite"),
        (
            ("    seen = splat(0.0)", "    put(get(y, 0), after.mean, 0)\n    seen = splat(0.0)"),
            "not finite where meas",
        ),
    ],
)
def test_a_wrong_estimator_is_found(predictor, replacement, says):
    with pytest.raises(AssertionError, match=says):
        check_estimator(predictor(replacement))
