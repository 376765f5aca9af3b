"""What planned drives were to show of effects that could not be seen, and what they showed."""

import json
import math
from types import SimpleNamespace

import pytest

from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.answer import Value
from harness.diagnosis.result.shown_effects import effects_shown

PLAN = {
    "expected": {
        "limits": {
            "steering_lag": {"unit": "s", "before": 0.2, "after": 0.02, "hypothesis": "steering_lag"},
            "roll_steer_front": {"unit": "rad", "before": None, "after": 0.01, "hypothesis": "roll_steer@front"},
        }
    }
}


def a_round(**limits):
    """Return a round that tried effects, by name the detection limits of their amplitudes."""
    tried = (
        SimpleNamespace(hypothesis=Hypothesis(name.replace("_at_", "@"), "effect", tuple(sizes)), detectable=sizes)
        for name, sizes in limits.items()
    )
    return SimpleNamespace(candidates=tuple(tried))


ROUNDS = (
    a_round(steering_lag={"steering_lag": 0.05}, roll_steer_at_front={"roll_steer_front": 0.5}),
    a_round(
        steering_lag={"steering_lag": 0.022},
        roll_steer={"roll_steer_front": 0.04, "roll_steer_rear": 0.04},
        roll_steer_at_front={"roll_steer_front": 0.011},
    ),
)
LAG = Hypothesis("steering_lag", "effect", ("steering_lag",))
EARLIER = {"confusable": {"models": [{"added": [[{"name": "payload_shift", "kind": "effect"}]], "share": 1.0}]}}


def shown(found=None, inclusion=None, rounds=ROUNDS, otherwise=""):
    return effects_shown(EARLIER, PLAN, rounds, found or {}, inclusion, otherwise)


def test_what_was_not_seen_would_now_be_shown_from_the_limit_of_the_last_round_on():
    neither = shown({Hypothesis("payload_shift", "effect", ("payload_shift",)): ()}, {LAG: 0.3})
    lag, roll = neither.amplitudes
    assert (lag.limit.reached, roll.limit.reached, roll.limit.before) == (0.022, 0.011, math.inf)
    assert neither.verdict == "as expected"
    doubt = "steering lag was not seen, though there with probability 0.300, and would be shown from 0.0220 s"
    assert f"{doubt} (expected 0.0200, before 0.200) on" in neither.words
    assert "roll steer front was not seen and would be" in neither.words
    assert "in addition to" not in neither.words  # the model of the plan had the shift of the payload too
    record = json.loads(json.dumps(neither.record))
    assert record["amplitudes"][1]["limit"]["before"] is None
    assert record["amplitudes"][1]["value"] is None


def test_what_was_seen_has_its_size_with_an_interval_and_is_what_the_others_are_judged_beside():
    found = {LAG: (Value("steering_lag", "s", 0.1, 0.01),)}
    one = shown(found, {LAG: 0.99}, ROUNDS[:1])
    lag, roll = one.amplitudes
    assert lag.interval == pytest.approx((0.0804, 0.1196), abs=1e-4)
    assert roll.limit.ratio == pytest.approx(50.0)
    assert one.verdict == "larger"  # of what was not seen
    assert "steering lag was seen with probability 0.990: 0.100 s, 95 % interval 0.0804 to 0.120 (to be" in one.words
    assert "not seen was sought in addition to steering lag, which the model of the plan had not" in one.words
    assert shown(found).verdict == "as expected"
    roll = {Hypothesis("roll_steer@front", "effect", ("roll_steer_front",)): (Value("roll_steer_front", "", 0.1, 0.1),)}
    both = shown(found | roll, rounds=ROUNDS[:1])
    assert (both.verdict, "in addition to" in both.words) == ("as expected", False)


def test_other_drives_than_planned_are_not_compared_but_what_they_showed_is_said():
    fewer = shown(otherwise="only 1 of 2 planned drives are there")
    assert fewer.verdict == "not compared"
    assert "not compared, as only 1 of 2 planned drives are there: steering lag was not seen" in fewer.words
    assert shown(rounds=()).verdict == "not stated"
