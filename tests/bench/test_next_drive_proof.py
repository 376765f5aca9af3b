"""Score of the closed loop of planned drives: hand-made traces against hand-made seals."""

import json

import numpy as np
import pytest

from bench import next_drive_score
from bench.next_drive_proof import draws
from bench.next_drive_score import (
    ARMS,
    AS_LONG,
    FIRST,
    MARKS,
    PLANNED,
    difference,
    figure,
    page,
    probability_of_right,
    reliability,
    scored_cases,
    standing,
    table,
)


def traced(**probabilities):
    """A trace whose models have the effects of their keys, ``and`` between them, ``at`` before a place."""

    def hypotheses(key):
        return [[{"name": n.replace("_at_", "@"), "kind": "effect"}] for n in key.split("_and_") if n != "nothing"]

    models = [{"added": hypotheses(key), "probability": p, "share": p} for key, p in probabilities.items()]
    return {"posterior": {"none_of_these": 0.0, "models": models}, "confusable": {"models": models}}


def sealed(*effects, quality="clean", **equivalent):
    return {
        "quality": quality,
        "effects": [{"name": e, "equivalent": list(equivalent.get(e, ()))} for e in effects],
    }


def test_places_are_one_name_and_the_probabilities_are_those_of_the_models_alone():
    trace = traced(sensor_gain_at_yaw_rate=0.5, sensor_gain_at_lateral_velocity=0.46, steering_lag=0.04)
    assert standing(trace, False) == frozenset({"sensor_gain"})
    assert probability_of_right(trace, sealed("sensor_gain")) == pytest.approx(0.96)
    assert probability_of_right(trace, sealed("steering_lag")) == pytest.approx(0.04)
    assert probability_of_right(trace, sealed()) == 0.0


def test_what_goes_beyond_the_truth_is_not_right():
    trace = traced(steering_lag=0.6, steering_lag_and_crosswind=0.4)
    assert standing(trace, False) is None
    assert probability_of_right(trace, sealed("steering_lag")) == pytest.approx(0.6)


def test_an_equal_counts_as_the_effect_also_as_a_parameter():
    trace = traced(sensor_gain=0.2, steering_compliance=0.3)
    trace["posterior"]["models"].append(
        {"added": [[{"name": "stiffness_peak_front", "kind": "parameter"}]], "probability": 0.5}
    )
    compliance = sealed("steering_compliance", steering_compliance=["parameter:stiffness_peak_front"])
    assert probability_of_right(trace, compliance) == pytest.approx(0.8)
    assert probability_of_right(trace, sealed("sensor_gain_speed", sensor_gain_speed=["sensor_gain"])) == 0.2
    assert probability_of_right(trace, sealed()) == pytest.approx(0.5)  # a parameter is no claim


def test_names_that_stand_together_share_the_probability_of_their_model():
    trace = traced(steering_lag=1.0)
    trace["posterior"]["models"][0]["added"][0].append({"name": "steering_delay", "kind": "effect"})
    assert standing(trace, False) is None
    assert probability_of_right(trace, sealed("steering_delay")) == pytest.approx(0.5)
    trace["posterior"]["models"][0]["added"] = [[{"name": f"sensor_gain@{c}", "kind": "effect"} for c in "ab"]]
    assert standing(trace, False) == frozenset({"sensor_gain"})


def test_faults_of_a_recording_are_of_no_name_in_field_quality_alone():
    trace = traced(steering_lag_and_speed_delay=0.7, steering_lag=0.3)
    assert standing(trace, False) is None
    assert standing(trace, True) == frozenset({"steering_lag"})
    assert probability_of_right(trace, sealed("steering_lag", quality="field")) == pytest.approx(1.0)


def case(folder, behind, seconds=40.0, expected=0.9, before=None, true=("steering_lag",)):
    """A case with the trace of each arm that is named."""
    before = before or traced(steering_lag=0.6, body_roll=0.4)
    for arm, trace in {FIRST: before, **behind}.items():
        own = folder / arm.replace(" ", "-")
        own.mkdir(parents=True)
        (own / "trace.json").write_text(json.dumps(trace))
    likeliest = sorted(before["confusable"]["models"], key=lambda m: -m["share"])[:2]
    models = {str(n): {"share": m["share"], "added": [a[0] for a in m["added"]]} for n, m in enumerate(likeliest)}
    arms = {
        arm: {
            "seconds": seconds * (2 if arm.endswith("twice") else 1),
            "expected": {"probability": expected, "models": models},
        }
        for arm in ARMS
    }
    (folder / PLANNED).write_text(json.dumps({"commit": "1", "arms": arms}))
    (folder / "sealed.json").write_text(json.dumps(sealed(*true)))


RIGHT, WRONG, OPEN = (
    traced(steering_lag=1.0),
    traced(body_roll=0.97, steering_lag=0.03),
    traced(steering_lag=0.6, x=0.4),
)


@pytest.fixture
def folder(tmp_path):
    cars = tmp_path / "car-clean"
    case(cars / "a-0", {"designed": RIGHT, "sweep": OPEN, "sweep twice": RIGHT, "random": WRONG})
    case(cars / "b-1", {"designed": RIGHT, "sweep": RIGHT, "random": OPEN, "random twice": OPEN})
    case(cars / "c-2", {"designed": RIGHT})  # its other arms are not there yet
    return tmp_path


def test_an_arm_where_a_name_stood_is_driven_no_longer(folder):
    scored = scored_cases(folder)
    assert scored.traced == {"car-clean": 3}
    assert [o.case for o in scored.opened] == ["a-0", "b-1"]
    first, second = scored.opened
    assert first.arms["sweep twice"].seconds == 80.0
    assert (first.arms["designed twice"].seconds, second.arms["sweep twice"].seconds) == (40.0, 40.0)
    assert [first.arms[a].settled for a in AS_LONG] == [True, False, False]
    assert [first.arms[a].misled for a in AS_LONG] == [False, False, True]
    assert first.held
    assert first.before == pytest.approx(0.6)


def test_the_difference_is_that_of_cases_with_the_interval_of_their_resamples(folder):
    scored = scored_cases(folder)
    assert difference(scored.opened, "designed", "sweep") == (0.5, 0.0, 1.0)
    assert difference(scored.opened, "designed", "random") == (1.0, 1.0, 1.0)


def test_table_and_reliability_are_of_the_cases_that_are_there(folder):
    scored = scored_cases(folder)
    assert "| designed | 40 | 2 of 2 | 2 of 2, 100 % (34 to 100) |" in table(scored)
    assert "| random twice | 60 | 0 of 2 | 0 of 2, 0 % (0 to 66) | 0 of 2, 0 % (0 to 66) | 1 |" in table(scored)
    assert "+50 points against sweep (+0 to +100)" in table(scored)
    ((expected, reached, low, high, count),) = reliability(scored)
    assert (expected, count) == (pytest.approx(0.9), 6)
    assert reached == pytest.approx(np.mean([1, 0.6, 0.03, 1, 1, 0.6]))
    assert low < reached < high
    assert figure(scored).startswith(b"<?xml")


def test_a_right_name_that_was_not_planned_for_is_not_held_against_the_expectation(tmp_path):
    behind = dict.fromkeys(AS_LONG, RIGHT)
    case(tmp_path / "car-clean" / "a-0", behind, before=traced(x=0.5, y=0.5))
    scored = scored_cases(tmp_path)
    assert not scored.opened[0].held
    assert reliability(scored) == []


def test_the_page_gets_table_and_figure(folder, tmp_path, monkeypatch):
    kept = tmp_path / "next-drive.md"
    kept.write_text(f"before\n{MARKS[0]}\nold\n{MARKS[1]}\nbehind\n")
    monkeypatch.setattr(next_drive_score, "PAGE", kept)
    page(scored_cases(folder))
    assert "| designed |" in kept.read_text()
    assert "old" not in kept.read_text()
    assert (tmp_path / "pictures" / next_drive_score.PICTURE).exists()


def test_a_draw_depends_on_its_number_alone(tmp_path):
    some, others = draws("car", 0, 6, tmp_path, "clean"), draws("car", 4, 2, tmp_path, "field")
    assert [c.name for c in some[4:]] == [c.name for c in others]
    assert all(c.name.startswith("car-") for c in some)
