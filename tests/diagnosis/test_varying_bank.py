"""A bank that varies along the road: a random process of the search, beside which the rest is found."""

import copy

import numpy as np
import pytest

from harness.diagnosis.criteria import EXCESS
from harness.diagnosis.model.hypotheses import coordinates, hypotheses
from harness.diagnosis.selection import forward_selection
from harness.diagnosis.selection.forward_selection import trace
from harness.diagnosis.selection.posterior import kind_of
from harness.diagnosis.selection.selection_round import random_scores
from support.driven_car import FREE, driven

NAME, PARAMETER, SIZE, MEMORY = "road_bank_varying", "bank_wander", 0.02, 10.0


@pytest.fixture(scope="module")
def bank(augmented):
    return next(h for h in hypotheses(augmented, FREE) if h.name == NAME)


def drives_of(augmented, seeds, *others, **values):
    given = {PARAMETER: SIZE, "bank_memory": MEMORY, **values}
    recordings = [driven(seed, [NAME, *others], **given) for seed in seeds]
    return [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]


@pytest.fixture(scope="module")
def found(augmented):
    drives = drives_of(augmented, (184, 185, 186))
    return trace(augmented, drives[:2], drives[2:], FREE)


def test_it_is_an_effect_of_the_road_with_a_memory_that_no_fit_moves(augmented, bank):
    assert (bank.random, bank.of_recording, kind_of(bank)) == (True, False, "effect")
    assert (bank.amplitudes, bank.shapes) == ((PARAMETER,), ("bank_memory",))
    assert [c.name for c in coordinates(augmented, FREE, (bank,), 2) if c.kind == "intensity"] == [PARAMETER]
    assert "bank_memory" not in [c.name for c in coordinates(augmented, FREE, (bank,), 2)]


def test_it_is_named_with_its_size_and_nothing_else(found, bank):
    assert [h.name for h in found.added] == [NAME]
    row = found.fitting.augmented.row(PARAMETER)
    size, (error,) = found.final.point.values[row, 0], found.fitting.standard_errors(found.final)[-1:]
    assert 0 < error < 0.3 * SIZE
    assert abs(size - SIZE) < 3 * error
    assert found.after.normalised_excess_mse < 0.2 * found.before.normalised_excess_mse


def test_what_is_constant_beside_it_is_found_as_well(augmented):
    drives = drives_of(augmented, (187, 188, 189), "steering_offset", steering_offset=0.01)
    found = trace(augmented, drives[:2], drives[2:], FREE)
    assert {h.name for h in found.added} == {NAME, "steering_offset"}


def test_it_is_tried_no_more_where_it_leaves_coloured_innovations(augmented, found, monkeypatch):
    """It takes up whatever is slow; where that is something else, the search is one without it."""
    monkeypatch.setattr(forward_selection, "colour_left", lambda before, after: 2 * EXCESS)
    drives, alone = [*found.fitting.drives, *found.held_out.drives], copy.copy(augmented)
    alone.discrepancy = ()
    other = trace(alone, drives[:2], drives[2:], FREE)
    assert NAME not in {h.name for h in other.added}
    assert NAME in {h.name for h in other.dropped}
    assert NAME not in {h.name for m in other.posterior.models for c in m.added for h in c.hypotheses}
    assert other.rounds[-1].added is None
    assert NAME not in {c.hypothesis.name for c in other.rounds[-1].candidates}


def test_its_values_are_the_likeliest_of_their_grids_together(found, bank):
    fits = _Fits(found.fitting)
    (score,) = random_scores(fits, found.nominal.point, [bank])
    assert score.amplitudes == pytest.approx([0.03], rel=1.0)
    assert score.shapes.tolist() == [MEMORY]
    assert score.gain > 100


class _Fits:
    """What ``random_scores`` asks of the fits."""

    def __init__(self, fitting):
        self.fitting, self.augmented = fitting, fitting.augmented


def test_the_floor_holds_the_variance_that_it_gives_the_outputs(augmented, found):
    """It grows with the square of the intensity, and is nothing without one."""
    values = found.nominal.point.values[:, 0].copy()
    values[[augmented.row(PARAMETER), augmented.row("bank_memory")]] = SIZE, MEMORY
    drive = found.held_out.drives[0]
    wander = augmented.wander(drive, values)
    assert wander.shape == drive.measurements.shape
    assert (wander >= 0).all()
    half = augmented.wander(drive, with_value(values, augmented.row(PARAMETER), 0.5 * SIZE))
    np.testing.assert_allclose(half[1000:], 0.25 * wander[1000:], rtol=0.05, atol=1e-9)
    assert augmented.wander(drive, with_value(values, augmented.row(PARAMETER), 0.0)).max() == 0


def with_value(values, row, value):
    """Return parameters with one of another value."""
    other = values.copy()
    other[row] = value
    return other
