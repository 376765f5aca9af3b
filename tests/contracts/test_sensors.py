"""What holds for every file in ``models/sensors``."""

from __future__ import annotations

import types

import pytest

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
