"""The sentence that opens a report: what the vehicle lacks, what the recordings have, which values were wrong."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.statistics import Interval
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.result.answer import Value, answer
from harness.diagnosis.result.claims import Claims
from harness.diagnosis.selection.posterior import Alike, ComparedModel, Posterior
from harness.identification.coordinates import parameter_coordinate
from harness.models.contracts import Parameter
from harness.reporting.style import uncertain

LAG = Hypothesis("steering_lag", "effect", ("steering_lag",))
DELAYS = tuple(
    Hypothesis(f"sensor_delay@{n}", "effect", (f"sensor_delay_{n}",), output=i)
    for i, n in enumerate(("yaw_rate", "roll"))
)
LATE = Hypothesis("steering_delay", "effect", ("steering_delay",))
MASS = Hypothesis("mass", "parameter", ("mass",))
MANY = Hypothesis(ALL_PARAMETERS, "parameter", ("mass", "friction"))
STATED = {"mass": 24_000.0, "friction": 0.9}
VALUES = {
    "mass": (Value("mass", "kg", 27_612.0, 163.0),),
    ALL_PARAMETERS: (Value("friction", "dimensionless", 0.91, 0.02), Value("mass", "kg", 27_612.0, 163.0)),
}
NOWHERE = SimpleNamespace(random_process=None, unmodelled=None)


def said(verdict, *added, posterior=None):
    excess = [SimpleNamespace(normalised_excess_mse=e) for e in (4.0, 0.01)]
    trace = SimpleNamespace(
        added=added,
        effects=tuple(h for h in added if h.kind == "effect"),
        final=SimpleNamespace(coordinates=()),
        fitting=SimpleNamespace(augmented=SimpleNamespace(spec=SimpleNamespace(values=STATED))),
        before=excess[0],
        after=excess[1],
        cut_short="",
        discrepancy=(),
    )
    return answer(trace, Claims(verdict, added, posterior), NOWHERE, VALUES)


def test_an_effect_of_the_vehicle_is_told_apart_from_what_the_recordings_have():
    text = said("amended", *DELAYS, LAG, LATE)
    assert text.startswith("The model lacks steering lag. ")
    assert "The recordings have sensor delay of yaw rate and roll and steering delay." in text


def test_late_channels_alone_are_nothing_that_the_vehicle_lacks():
    assert said("amended", *DELAYS).startswith("Of the vehicle nothing is missing that these drives can show. The rec")


def test_a_wrong_value_is_named_with_what_it_is_and_what_was_stated():
    assert "A stated value was wrong: mass (27610 ± 160 kg in place of 24000)." in said("adequate", MASS)


def test_of_many_wrong_values_the_surest_come_first():
    text = said("adequate", MANY)
    assert "Many stated values were wrong, most surely mass (27610 ± 160 kg in place of 24000) and friction" in text


def posterior(none, *shares):
    """Return how likely models are, each by its probability and what it has."""
    zero, alone = np.zeros(1), Interval(0.0, 0.0, 0.0)
    models = [
        ComparedModel(tuple(Alike((h,), (1.0,)) for h in added), None, 0.0, zero, alone, share / (1.0 - none), share)
        for share, *added in shares
    ]
    return Posterior(tuple(models), none, zero)


def test_what_is_claimed_is_as_sure_as_its_probability():
    """The lag is in models of nine tenths, the delay in that of four, the mass in none that has probability."""
    split = posterior(0.1, (0.5, LAG), (0.4, LAG, LATE), (0.0, LAG, MASS))
    text = said("amended", LAG, LATE, MASS, posterior=split)
    assert text.startswith("The model probably lacks steering lag (9 in 10). The recordings may have steering delay (4")
    assert "A stated value may have been wrong (less than 1 in 100): mass (" in text
    sure = said("amended", LAG, posterior=posterior(0.0, (0.96, LAG), (0.04,)))
    assert sure.startswith("The model lacks steering lag. ")


def test_that_nothing_is_missing_is_as_sure_as_the_model_without_additions():
    split = posterior(0.4, (0.3,), (0.3, LAG))
    text = said("adequate", posterior=split)
    assert text.startswith("The model may be adequate (3 in 10): nothing is missing that these drives can show.")


def test_what_shares_the_probability_of_an_addition_is_told_with_it():
    """What is in its place alone: the delay, and nothing; the mass of a model with the lag is no rival of it."""
    shared = posterior(0.1, (0.4, LAG), (0.3, LATE), (0.1,), (0.1, LAG, MASS))
    text = said("amended", LAG, posterior=shared)
    assert text.startswith("The model may lack steering lag (5 in 10). ")
    assert "In the place of steering lag there may be steering delay (3 in 10) or nothing (1 in 10)." in text
    rivals = Claims("amended", (LAG,), shared).rivals(LAG)
    assert [(r.hypothesis, round(r.probability, 12)) for r in rivals] == [(LATE, 0.3), (None, 0.1)]


def test_where_probably_none_is_right_names_have_the_probability_of_one_right_model():
    """As the table of odds has it."""
    none = posterior(0.9, (0.08, LAG), (0.02, LATE))
    text = said("unresolved", LAG, posterior=none)
    assert "Part of it is probably steering lag (8 in 10, if one of these explanations is right)." in text
    assert "there may be steering delay (2 in 10)" in text


def test_what_is_named_of_something_unresolved_is_a_part_of_it():
    assert "explains. Part of it is steering lag." in said("unresolved", LAG)


def test_a_value_by_an_implausible_factor_is_no_explanation():
    mass = parameter_coordinate(Parameter("mass", "m", "kg", 1.0, 1e6, ""), 0, 24_000.0, 0.2, 1.0)
    coordinate = replace(mass, stated_std=mass.prior)
    point = SimpleNamespace(value=lambda c: 10 * 24_000.0)
    trace = SimpleNamespace(
        added=(MANY,),
        effects=(),
        final=SimpleNamespace(coordinates=(coordinate,), point=point),
        before=SimpleNamespace(normalised_excess_mse=4.0),
        after=SimpleNamespace(normalised_excess_mse=0.01),
        cut_short="",
        discrepancy=(),
    )
    said = answer(trace, Claims("unresolved", (MANY,), None), NOWHERE, {})
    assert "would explain it, but only with implausible factors: mass 10." in said


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (4.3e-17, 1.8, "0 ± 1.8"),
        (27_612.3, 163.0, "27610 ± 160"),
        (99.6321, 0.0012, "99.6321 ± 0.0012"),
        (-0.37, 0.012, "−0.370 ± 0.012"),
        (12.0, 300.0, "10 ± 300"),
        (1.234, math.inf, "1.23"),
        (np.nan, 1.0, "–"),
    ],
)
def test_a_number_is_written_to_the_second_digit_of_its_error(value, std, text):
    assert uncertain(value, std) == text
