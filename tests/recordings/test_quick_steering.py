"""Quasi-static relations of a recording: no fault is stated for what quick steering does to a car without any."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lsim

from harness.recordings.check.examine import examine
from harness.recordings.motion.consistency import NOT_JUDGED
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import recording_of

MASS, INERTIA, FRONT, REAR, RATIO = 1650.0, 2900.0, 1.25, 1.55, 15.2
STIFF_FRONT, STIFF_REAR = 95e3, 118e3
TIME = np.arange(0.0, 25.0, 0.01)


def recorded(waves, speed, steering=1.0, lateral=1.0):
    """Return a linear single-track car that is steered by waves ``(Hz, rad)``, two signals scaled as by a fault."""
    angle = np.clip(TIME - 1.0, 0.0, 1.0) * sum(a * np.sin(2.0 * np.pi * f * TIME) for f, a in waves)
    both, turning = STIFF_FRONT + STIFF_REAR, STIFF_FRONT * FRONT - STIFF_REAR * REAR
    square = STIFF_FRONT * FRONT**2 + STIFF_REAR * REAR**2
    states = [
        [-both / MASS / speed, -speed - turning / MASS / speed],
        [-turning / INERTIA / speed, -square / INERTIA / speed],
    ]
    inputs = [[STIFF_FRONT / MASS], [STIFF_FRONT * FRONT / INERTIA]]
    outputs = [[0.0, 1.0], [states[0][0], states[0][1] + speed]]
    motion = lsim((states, inputs, outputs, [[0.0], inputs[0]]), angle / RATIO, TIME)[1]
    noise = np.random.default_rng(7).standard_normal((2, len(TIME)))
    columns = {
        "time": TIME,
        "steering_wheel_angle": steering * angle,
        "speed": np.full(len(TIME), speed) + 1e-3 * noise[0],
        "yaw_rate": motion[:, 0] + 0.002 * noise[0],
        "lateral_acceleration": lateral * (motion[:, 1] + 0.06 * noise[1]),
    }
    return recording_of(tables_of(pd.DataFrame(columns), mapped=False), "drive")


@pytest.mark.parametrize(
    ("frequency", "amplitude", "speed"),
    [(0.6, 0.5, 30.0), (0.8, 0.5, 20.0), (1.35, 0.5, 20.0), (1.7, 0.7, 16.0), (2.45, 1.0, 12.0), (3.0, 1.2, 20.0)],
)
def test_a_quick_weave_is_no_fault(frequency, amplitude, speed):
    assert not examine(recorded([(frequency, amplitude)], speed)).findings


def test_what_is_too_quick_to_be_judged_has_no_slope():
    (quick,) = [f for f in examine(recorded([(1.35, 0.46)], 19.0)).fits if f.verdict == NOT_JUDGED]
    assert "too quick" in quick.reasons[0]
    assert np.isnan(quick.slope)  # so that no small deviation is sought in it either


@pytest.mark.parametrize("waves", [[(0.3, 0.5)], [(0.25, 0.4), (2.45, 0.8)]])
@pytest.mark.parametrize(
    ("fault", "words"), [({"steering": -1.0}, "opposite sign"), ({"lateral": 0.5}, "lateral_acceleration")]
)
def test_faults_show_in_what_is_slow(waves, fault, words):
    assert not examine(recorded(waves, 16.0)).findings
    findings = [str(f) for f in examine(recorded(waves, 16.0, **fault)).findings]
    assert any(words in text for text in findings), findings
