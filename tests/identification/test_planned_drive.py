"""A recording is told from the planned drives by duration, speed, size and quickness of the steering."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from harness.identification.planned_drive import driven_otherwise, unplanned


def drive(seconds=20.0, speed=12.0, angle=0.4, hertz=0.5, still=(1.0, 0.0), noise=0.0, name="driven"):
    """Return a weave with so many seconds of straight driving before and behind it."""
    time = np.arange(0.0, still[0] + seconds + still[1], 0.01)
    phase = 2 * np.pi * hertz * (time - still[0])
    steer = np.where((time > still[0]) & (time < still[0] + seconds), angle * np.cos(phase), 0.0)
    steer += noise * np.random.default_rng(1).normal(size=len(time))
    signals = {"steering_wheel_angle": steer, "speed": np.full_like(time, speed)}
    return xr.Dataset({n: ("time", v) for n, v in signals.items()}, {"time": time}, {"name": name})


@pytest.fixture
def plan(tmp_path):
    for name, recording in {"1-weave": drive(), "2-circle": drive(hertz=0.0, angle=1.0)}.items():
        pd.DataFrame({n: recording[n] for n in ("time", "steering_wheel_angle", "speed")}).to_csv(
            tmp_path / f"{name}.csv", index=False
        )
    return tmp_path


NAMES = ["1-weave", "2-circle"]


@pytest.mark.parametrize(
    "driven",
    [
        {},
        {"still": (7.0, 9.0), "noise": 0.003},  # the way there and back, and a measured angle
        {"hertz": 0.6, "angle": 0.5, "speed": 13.5, "seconds": 25.0},  # by hand
        {"hertz": 0.0, "angle": 0.9, "noise": 0.003},  # the other one
    ],
)
def test_what_was_planned_is_recognised(plan, driven):
    assert unplanned([drive(**driven)], plan, NAMES) == []


@pytest.mark.parametrize(
    "driven",
    [{"speed": 17.0}, {"angle": 0.1}, {"hertz": 1.6}, {"seconds": 60.0, "hertz": 0.49}, {"hertz": 0.0, "angle": 0.3}],
)
def test_another_drive_is_told(plan, driven):
    assert unplanned([drive(name="planned"), drive(**driven)], plan, NAMES) == ["driven"]


def test_fewer_drives_than_planned_are_told(plan):
    sequence = {"sequence": [{"name": "1-weave", "times": 2}, {"name": "2-circle", "times": 1}]}
    circle = drive(hertz=0.0, angle=1.0)
    assert driven_otherwise([drive(), drive(), circle], plan, sequence) == ""
    assert driven_otherwise([drive(), circle], plan, sequence) == "only 2 of 3 planned drives are there"
    assert driven_otherwise([drive(hertz=1.6)], plan, sequence) == "driven is not as planned (1-weave and 2-circle)"
    assert driven_otherwise([drive()], plan, {}) == ""


def test_where_nothing_can_be_compared_nothing_is_said(plan):
    straight = drive(speed=30.0)
    assert unplanned([straight.drop_vars("steering_wheel_angle")], plan, NAMES) == []
    assert unplanned([straight], plan, [*NAMES, "3-lost"]) == []
    assert unplanned([straight], plan, []) == []
