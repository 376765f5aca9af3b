"""What holds for every file in ``models/sensors``."""

from __future__ import annotations

import types

import pytest

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble
from harness.models.roles import SENSORS
from harness.testing import check_sensors


@pytest.mark.parametrize("name", SENSORS.names())
def test_every_set_of_sensors(name):
    check_sensors(name)


@pytest.mark.parametrize(
    ("outputs", "says"),
    [
        ({}, "OUTPUTS is empty"),
        ({"yaw_rat": "yaw_rate"}, "no signals: yaw_rat"),
        ({"heading": "heading", "articulation_angle": "articulation_angle"}, "no vehicle publishes what it measures"),
    ],
)
def test_a_wrong_set_is_found(outputs, says):
    module = types.ModuleType("wrong")
    module.__doc__, module.OUTPUTS = "Wrong.", outputs
    with pytest.raises(AssertionError, match=says):
        check_sensors(module)
    assert "wrong" not in SENSORS.names()


def test_a_list_of_signals_is_a_set_of_sensors():
    both = SENSORS.load("yaw_rate_tractor, lateral_velocity,sideslip_angle")
    assert both.OUTPUTS == {
        "yaw_rate_tractor": "yaw_rate_tractor",
        "lateral_velocity": "lateral_velocity_reference",  # as a set says
        "sideslip_angle": "sideslip_angle",
    }
    assert list(SENSORS.load("articulation_angle").OUTPUTS) == ["articulation_angle"]
    for wrong, says in (
        ("yaw_rate,", "no signal before or behind a comma"),
        ("yaw_rate,heading, yaw_rate", "'yaw_rate' is named twice"),
        ("stability_contrl", "closest: stability_control"),
    ):
        with pytest.raises(ModelError, match=says):
            SENSORS.load(wrong)
    with pytest.raises(ModelError, match="measures 'yaw_rat', which 'car' does not publish; closest: yaw_rate"):
        assemble("car", "linear", (), "yaw_rat, lateral_acceleration")
