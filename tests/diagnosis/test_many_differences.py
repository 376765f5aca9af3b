"""Growth of a model of a vehicle that differs from it in many ways at once."""

import pytest

from harness.diagnosis.model.augmented_model import MEMORY
from harness.diagnosis.residuals.localisation import NOWHERE
from harness.diagnosis.result.answer import answer
from harness.diagnosis.result.claims import claims_of
from harness.diagnosis.selection.forward_selection import trace
from support.driven_car import FREE, driven

FORCE = 0.1
SIZES = {"steering_delay": 0.03, "steering_backlash": 0.004, "tyre_relaxation_front": 0.6}
EFFECTS = ("steering_delay", "steering_backlash", "tyre_relaxation@front")


@pytest.fixture(scope="module")
def drives(augmented):
    values = {"unmodelled_force": FORCE, "unmodelled_lever": 0.0, MEMORY: 0.2, **SIZES}
    recordings = [driven(seed, ["unmodelled_force", *EFFECTS], **values) for seed in (191, 192, 193)]
    return [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]


@pytest.fixture(scope="module")
def grown(augmented, drives):
    return trace(augmented, drives[:2], drives[2:], FREE)


def test_every_effect_is_named_beside_a_force_that_has_no_name(grown):
    assert {h.name for h in grown.added} == set(EFFECTS)
    errors = dict(
        zip([c.name for c in grown.final.coordinates], grown.fitting.standard_errors(grown.final), strict=False)
    )
    for name, size in SIZES.items():
        assert abs(grown.final.point.values[grown.fitting.augmented.row(name), 0] - size) < 3 * errors[name], name
    force = grown.final.point.values[grown.fitting.augmented.row("unmodelled_force"), 0]
    assert force == pytest.approx(FORCE, rel=0.3)


def test_the_answer_states_what_is_left(grown):
    claims = claims_of(grown, NOWHERE, coloured=False)
    assert claims.verdict == "unresolved"
    said = answer(grown, claims, NOWHERE, {})
    assert " What else it lacks acts as a random force of " in said
    assert " All stated values were free" in said


def test_it_grows_as_soon_as_a_plain_search_has_no_room_and_by_no_more_than_is_stated(augmented, drives):
    said = []
    grown = trace(augmented, drives[:2], drives[2:], FREE, said.append, rounds=2)
    assert grown.discrepancy
    assert sum(len(r.added.hypothesis.single) for r in grown.rounds if r.added) == 2
    first = next(i for i, line in enumerate(said) if line.startswith("growth, round 1:"))
    assert "how likely is each model?" not in said[:first]
    assert "how likely is each model?" in said[first:]
