"""A score is a number, or the status of the run says why there is none: targets that stop being defined in a run."""

import numpy as np
import pytest

from harness.config import load_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import ESTIMATOR_DIVERGED, OK, PLANT_DIVERGED
from support.plugins import forget, register

FILES = {
    "vehicles/rooted_ramp.py": '''
"""A state that grows with time, and a port that is defined up to an edge only."""
import sympy as sp
from harness.models.contracts import Parameter
from harness.models.signals import Signal
STATES = ("ramp_state",)
INPUTS = ("ramp_rate",)
AXLES = {}
VALID = {"ramp_state": 1e3}
SIGNALS = tuple(Signal(n, n, "1", "1", "", "of a test") for n in ("ramp_state", "ramp_rate", "ramp_root"))
PARAMETERS = (
    Parameter("edge", "e", "dimensionless", 0.0, 100.0, "where the root ends"),
    Parameter("size", "s", "dimensionless", 0.0, 1e300, "square root of the size of the root"),
)
def equations(v):
    x = v.state("ramp_state")
    v.port("ramp_root", v.p("size") ** 2 * sp.sqrt(v.p("edge") - x))
    v.derivative("ramp_state", v.input("ramp_rate"))
def drive_inputs(profile, context):
    return {"ramp_rate": 0 * profile.time + 1}
''',
    "sensors/ramp_alone.py": 'OUTPUTS = {"ramp_state": "ramp_state"}\n',
    "parameters/rooted_ramp_usual.py": """
VEHICLE = "rooted_ramp"
VALUES = {"edge": 50.0, "size": 1.0}
NOISE_STEP = 0.01
PROCESS_NOISE = {"ramp_state": 1e-8}
MEASUREMENT_NOISE = {"ramp_state": 1e-4}
""",
}
STUDY = """
name = "undefined"
targets = ["ramp_root", "ramp_state"]
[plant]
vehicle = "rooted_ramp"
parameters = "rooted_ramp_usual"
sensors = "ramp_alone"
[[drive]]
name = "on"
kind = "sine"
duration = "6 s"
amplitude = "0.01 deg"
[[estimator]]
kind = "ekf"
[[design]]
name = "level"
repeats = 8
[[design.factor]]
parameter = "{parameter}"
levels = [{low}, {high}]
{of}
"""


@pytest.fixture
def evaluate(tmp_path):
    """Scores of a study in which one parameter has two values, by level."""

    def run(parameter, low, high, of=""):
        path = tmp_path / "undefined.toml"
        path.write_text(STUDY.format(parameter=parameter, low=low, high=high, of=of), encoding="utf-8")
        study = load_study(path)
        evaluator = StudyEvaluator(study)
        return [evaluator.evaluate(unit) for unit in units(study, study.designs[0])]

    register(tmp_path, FILES)
    yield run
    forget()


@pytest.mark.parametrize(
    ("of", "fate"),
    [('of = "plant"', PLANT_DIVERGED), ('of = "belief"', ESTIMATOR_DIVERGED)],
    ids=["plant", "estimator"],
)
def test_a_target_that_is_no_number_any_more_ends_the_run_with_a_status(evaluate, of, fate):
    ends, holds = evaluate("edge", 1.505, 50.0, of)
    assert (holds["status"] == OK).all()
    assert np.isfinite(holds["rmse"]).all()
    assert (ends["status"] == fate).all()
    np.testing.assert_allclose(ends["time_of_divergence"], 1.51, atol=0.06)
    assert np.isfinite(ends["rmse"]).all()  # of the part before
    assert (ends["updates"] < holds["updates"]).all()


def test_an_error_too_large_to_be_squared_is_a_divergence(evaluate):
    fine, absurd = evaluate("size", 1.0, 1e100, 'of = "belief"')
    assert (fine["status"] == OK).all()
    assert (absurd["status"] == ESTIMATOR_DIVERGED).all()
    assert not np.isinf(absurd["rmse"]).any()
