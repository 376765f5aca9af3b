"""The augmented model of the simulated car, for every test that fits it to drives."""

import pytest

from harness.config import resolve_single
from harness.diagnosis.model.augmented_model import AugmentedModel
from support.driven_car import CAR, SIGNALS


@pytest.fixture(scope="session")
def augmented():
    return AugmentedModel(resolve_single({**CAR, "integrator": "rk4"}, "test"), SIGNALS, jobs=2)
