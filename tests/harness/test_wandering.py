"""A random process that a model lacks: found where it acts, with its parameters, and nowhere else."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_trace import CAR, FREE, SIGNALS, driven

from harness.configure import resolve_single
from harness.loop.amend import fitted_model
from harness.loop.fit import Fitting
from harness.loop.hypotheses import coordinates
from harness.loop.pinpoint import Pinpoint
from harness.loop.trace import first_variances
from harness.loop.wandering import find_wandering
from harness.loop.whole import Whole

WANDER, MEMORY = 0.02, 5.0


@pytest.fixture(scope="module")
def whole():
    return Whole(resolve_single({**CAR, "integrator": "rk4"}, "test"), SIGNALS, jobs=2)


def search(whole, recordings):
    """Return what is found in the last of some drives, fitted to the others with nothing named."""
    drives = [whole.drive(r, f"drive {i}") for i, r in enumerate(recordings)]
    variances = first_variances(whole, drives)
    fitting = Fitting(whole, drives[:-1], variances)
    fit = fitting.fit(coordinates(whole, FREE, (), len(drives) - 1), fitting.first(), 10)
    trace = SimpleNamespace(fitting=fitting, held_out=Fitting(whole, drives[-1:], variances), free=FREE)
    return find_wandering(trace, fitted_model(trace, whole.spec, fit.point), Pinpoint(fitting, fit.point))


def test_a_bank_that_wanders_is_found_and_leaves_nothing(whole):
    values = {"bank_wander": WANDER, "bank_memory": MEMORY}
    found = search(whole, [driven(seed, ["road_bank_varying"], **values) for seed in (81, 82, 83)])
    assert found is not None
    assert found.hypothesis.name == "road_bank_varying"
    assert found.hypothesis.amplitudes == ("bank_wander",)
    assert found.gain > 100
    assert found.held_out_gain > 50
    # 120 s of a process that forgets in 5 s are two dozen independent stretches.
    assert found.spec.values["bank_wander"] == pytest.approx(WANDER, rel=0.3)
    assert 0 < found.errors["bank_wander"] < 0.3 * WANDER
    assert abs(np.log(found.spec.values["bank_memory"] / MEMORY)) < 1.2
    assert found.spec.process_noise["bank_walk"] > 0
    assert found.spec.effects == ("road_bank_varying",)


def test_a_gust_is_no_bank(whole):
    times = ((20.0, 31.0), (35.0, 44.0), (25.0, 40.0))
    gusts = [
        driven(i, ["crosswind"], crosswind_force=400.0, crosswind_onset=a, crosswind_end=b)
        for i, (a, b) in enumerate(times)
    ]
    assert search(whole, gusts) is None
