"""What holds for every file in ``models/parameters``."""

from __future__ import annotations

import re
import types

import pytest

from harness.models.roles import PARAMETERS
from harness.testing import check_parameter_set


@pytest.mark.parametrize("name", PARAMETERS.names())
def test_every_parameter_set(name):
    check_parameter_set(name)


@pytest.mark.parametrize("name", PARAMETERS.names())
def test_our_sets_are_named_author_year_and_variants_by_a_word_more(name):
    assert re.fullmatch(r"[a-z0-9_]+_\d{4}[a-z]?(_[a-z]+)*", name)


def test_the_readings_of_the_steering_noise_differ_in_it_alone():
    wheel, road = PARAMETERS.load("ziaukas_2023"), PARAMETERS.load("ziaukas_2023_road_wheels")
    ratio = {s: road.PROCESS_NOISE[s] / v for s, v in wheel.PROCESS_NOISE.items()}
    assert ratio.pop("steering_wheel_angle") == pytest.approx(23**2)
    assert set(ratio.values()) == {1.0}
    assert (road.VALUES, road.MEASUREMENT_NOISE) == (wheel.VALUES, wheel.MEASUREMENT_NOISE)
    assert (road.VEHICLE, road.NOISE_STEP) == (wheel.VEHICLE, wheel.NOISE_STEP)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"__doc__": "Mine."}, "say in the docstring where the values come from"),
        ({"VALUES": {"mass": 1.0}}, "no value of "),
        ({"VALUES": ("mass", -1.0)}, "mass = -1 is outside"),
        ({"VALUES": ("colour", 1.0)}, "has no parameter colour"),
        ({"PROCESS_NOISE": {}}, "every state needs a process noise"),
        ({"PROCESS_NOISE": ("yaw_rate", -1.0)}, "a negative process noise"),
        ({"MEASUREMENT_NOISE": {}}, "every sensor that fits needs a measurement noise"),
        ({"MEASUREMENT_NOISE": ("heading_increment", 1.0)}, "does not publish: heading_increment"),
        ({"STD": {"colour": 1.0}}, "STD of what has no value: colour"),
        ({"STD": {"mass": 0.0}}, "a standard deviation that is not positive"),
        ({"NOISE_STEP": 10.0}, "NOISE_STEP is in s"),
    ],
)
def test_a_wrong_set_is_found(changes, says):
    module = types.ModuleType("wrong")
    vars(module).update({n: v for n, v in vars(PARAMETERS.load("govindarajan_2018")).items() if n not in ("__name__",)})
    for name, change in changes.items():
        setattr(module, name, {**getattr(module, name), change[0]: change[1]} if isinstance(change, tuple) else change)
    with pytest.raises(AssertionError, match=says):
        check_parameter_set(module)
