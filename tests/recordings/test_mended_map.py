"""The lines that mend a channel map."""

import pytest

from harness.recordings.faults import SIGN, Fault
from harness.recordings.remedy import mended


@pytest.mark.parametrize(
    ("entry", "after"),
    [
        ({}, {"sign": -1}),
        ({"sign": -1}, {}),
        ({"factor": -1.0}, {}),
        ({"factor": -2.0}, {"factor": 2.0}),
        ({"factor": 2.0}, {"factor": 2.0, "sign": -1}),
    ],
)
def test_a_sign_is_turned_where_the_map_has_it(entry, after):
    named = {"channel": "r", "unit": "rad/s"}
    fault = Fault(SIGN, ("yaw_rate",), -1.0, 0.0, 0.0, "wrong sign")
    found = mended({"yaw_rate": {**named, **entry}}, [fault], [], {}, 60.0)
    assert found == {"yaw_rate": {**named, **after}}
