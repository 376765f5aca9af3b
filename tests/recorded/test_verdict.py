"""Whether model and noise fit a recording: right, with wrong noise, wrong values, and a reference that has noise."""

import dataclasses

import numpy as np
import pytest

from harness.identification.whiteness import is_white, whiteness
from harness.models.signals import TRUTH
from harness.recorded.run import RecordedEstimator, RecordedModel
from harness.recorded.summary import is_coloured, is_large, summary, verdict
from support.identification import CAR, model_of, recorded

NAME = "lateral_velocity_rear"
SENSORS = {**CAR, "sensors": "yaw_rate,heading"}


@pytest.fixture(scope="module")
def drive():
    return recorded(model_of(CAR), 5, duration=60.0, speed=15.0, amplitude=0.5)


def run(drive, noise=1.0, **values):
    """Return the numbers of an EKF whose variances are all stated ``noise`` times as large as they are."""
    spec = model_of(SENSORS, **values)
    process, measurement = ({k: noise * v for k, v in n.items()} for n in (spec.process_noise, spec.measurement_noise))
    spec = dataclasses.replace(spec, process_noise=process, measurement_noise=measurement)
    return summary(RecordedEstimator(RecordedModel(spec, inputs="held", jobs=1), "ekf").run(drive))


@pytest.mark.parametrize(
    ("options", "begins"),
    [
        ({}, "model and noise fit"),
        ({"noise": 4.0}, "the noise does not fit: it is stated too large"),
        ({"noise": 0.25}, "the noise does not fit: it is stated too small"),
        ({"stiffness_over_load_rear": 6.0}, "model or noise does not fit"),
    ],
)
def test_the_verdict_says_what_does_not_fit(drive, options, begins):
    exact = drive.drop_vars([v for v in drive if str(v).startswith(TRUTH)]).drop_vars(NAME)
    assert verdict([run(exact, **options)]).startswith(begins)


def test_errors_that_are_larger_than_stated_weigh_most(drive):
    found = run(drive, stiffness_over_load_rear=6.0)
    assert is_large(found.errors[NAME])
    assert not is_large(run(drive).errors[NAME])
    said = verdict([found])
    assert said.index("errors of") < said.index("coloured") < said.index("NIS")


def test_the_noise_of_a_reference_is_not_an_error_of_the_estimator(drive):
    """0.2 m/s of white noise on a reference whose estimate is a hundred times as near to it."""
    noisy = drive.drop_vars([v for v in drive if str(v).startswith(TRUTH)])
    noisy[NAME] = drive[f"{TRUTH}{NAME}"] + 0.2 * np.random.default_rng(0).standard_normal(drive.sizes["time"])
    error = run(noisy).errors[NAME]
    assert error.nees > 10.0
    assert error.noise == pytest.approx(0.2, rel=0.1)
    assert error.nees_with_noise == pytest.approx(1.0, abs=0.2)
    assert error.inside_with_noise == pytest.approx(0.95, abs=0.03)
    assert error.mostly_noise
    assert not is_large(error)


def test_a_little_colour_in_a_long_series_does_not_matter():
    """A correlation of 0.05 is beyond chance in 20000 samples; one of 0.4 matters."""
    white = np.random.default_rng(1).standard_normal(20_001)
    little, much = (whiteness(white[1:] + a * white[:-1]) for a in (0.05, 0.5))
    assert not is_white(little)
    assert not is_coloured(little)
    assert is_coloured(much)
