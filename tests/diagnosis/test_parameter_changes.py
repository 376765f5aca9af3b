"""Which parameter is another one in new drives: known answers on drives of a car that was simulated."""

import dataclasses
import re
from types import SimpleNamespace

import pytest

from harness.diagnosis.measured_study import answer_of_changes, record_of_changes
from harness.diagnosis.selection.parameter_changes import Changes, single_changes
from support.driven_car import driven


def changes_of(augmented, **values) -> Changes:
    fitted, held_out = (augmented.drive(driven(seed, duration=30.0, **values), f"drive {seed}") for seed in (60, 61))
    return single_changes(augmented, [fitted], [held_out], stated_noise=False)


@pytest.fixture(scope="module")
def geared(augmented):
    """A steering three times as slow: far beyond what a step from the stated value would find."""
    return changes_of(augmented, steering_ratio=3.0)


def test_a_large_change_is_found_with_its_value(geared):
    assert geared.change is not None
    assert geared.change.parameter.name == "steering_ratio"
    assert geared.change.stated == 1.0
    assert geared.change.value == pytest.approx(3.0, abs=max(4 * geared.change.std, 0.003))
    assert geared.change.held_out.normalised_excess_mse < 0.05 < 10 < geared.before.normalised_excess_mse


def test_where_nothing_changed_nothing_is_found(augmented):
    changes = changes_of(augmented)
    assert changes.change is None
    assert all(c.bic < 10 for c in changes.tried)


def test_a_change_that_does_not_carry_over_is_none(geared):
    worse = dataclasses.replace(
        geared.tried[0].held_out, normalised_excess_mses=0.9 * geared.before.normalised_excess_mses
    )
    first = dataclasses.replace(geared.tried[0], held_out=worse)
    assert dataclasses.replace(geared, tried=(first, *geared.tried[1:])).change is None


def test_numbers_of_the_integration_are_not_tried(geared):
    names = [c["name"] for c in record_of_changes(geared)["tried"]]
    assert "lowest_speed" not in names
    assert {"mass", "yaw_inertia", "stiffness_peak_front"} <= set(names)
    assert record_of_changes(geared)["found"] == "steering_ratio"


def test_the_answer_names_parameter_and_both_values(augmented, geared):
    said = answer_of_changes(geared, SimpleNamespace(trace=SimpleNamespace(added=())), augmented.spec)
    assert re.match(r"Steering ratio changed from 1.00 to (3\.0\d+|2\.9\d+) ± 0.0\d+\. ", said)
    assert "falls by " in said
