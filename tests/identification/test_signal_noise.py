"""How far apart samples have to be for their noise to be white."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from harness.diagnosis.criteria import CORRELATED, INDEPENDENT
from harness.identification import signal_noise
from harness.identification.signal_noise import thinned

STEP, COUNT = 0.01, 12_000
TIME = np.arange(COUNT) * STEP
MOTION = np.sin(2 * np.pi * 0.3 * TIME) + 0.3 * np.sin(2 * np.pi * 1.7 * TIME)


white_spacing = partial(signal_noise.white_spacing, tolerable=CORRELATED, white=INDEPENDENT)


@dataclass(frozen=True)
class Drive:
    """What of a recording counts here."""

    time: np.ndarray
    measurements: np.ndarray


def drives_of(*columns):
    return [Drive(TIME[: len(columns[0])], np.column_stack(columns))]


def noise(seed):
    return 0.05 * np.random.default_rng(seed).standard_normal(COUNT)


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_on_a_vehicles_motion_is_taken_sample_by_sample(seed):
    seldom = np.where(np.arange(COUNT) % 2, np.nan, MOTION + noise(seed + 50))  # a channel of half the rate
    lost = np.where(np.random.default_rng(seed).random(COUNT) < 0.01, np.nan, MOTION + noise(seed + 20))
    nearly = noise(seed + 30) + 0.12 * np.roll(noise(seed + 30), 1)
    assert white_spacing(drives_of(MOTION + noise(seed), seldom, lost, MOTION + nearly)) == (1, 1, 1, 1)


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_white_at_the_spacing_that_is_returned(seed):
    """Noise behind a filter of 12 Hz, interpolated between two samples, and of a body that vibrates at 10 Hz."""
    filtered = lfilter(*butter(2, 12.0, fs=1.0 / STEP), noise(seed))
    between = 0.5 * (noise(seed) + np.roll(noise(seed), 1))
    vibration = lfilter(*butter(1, (8.0, 13.0), "bandpass", fs=1.0 / STEP), 2.0 * noise(seed)) + noise(seed + 9)
    coloured = (filtered, between, vibration)
    spacing = white_spacing(drives_of(*(MOTION + own for own in coloured)))
    assert spacing[1] == 2
    for every, own in zip(spacing, coloured, strict=True):
        assert 2 <= every <= 8
        assert abs(np.corrcoef(own[1:], own[:-1])[0, 1]) > 0.2
        rest = own[::every]
        for lag in range(1, 3):
            assert abs(np.corrcoef(rest[lag:], rest[:-lag])[0, 1]) < 0.05 + 4.0 / np.sqrt(len(rest))


def test_what_is_too_short_slow_or_still_is_taken_as_it_is():
    short = np.full(COUNT, np.nan)
    short[:900] = noise(1)[:900]
    slow = np.where(np.arange(COUNT) % 8, np.nan, noise(2))  # 12.5 Hz shows nothing of what is above the motion
    assert white_spacing(drives_of(short, slow, np.zeros(COUNT))) == (1, 1, 1)


def test_a_short_drive_hides_nothing_of_the_long_ones():
    between = 0.5 * (noise(3) + np.roll(noise(3), 1))
    assert white_spacing([*drives_of(noise(4)[:900]), *drives_of(between)]) == (2,)


def test_a_thinned_recording_keeps_every_so_many_of_the_samples_that_it_has():
    (drive,) = drives_of(np.arange(COUNT) * 1.0, np.where(np.arange(COUNT) % 2, np.nan, np.arange(COUNT)), MOTION)
    rest = thinned(drive, (3, 2, 1)).measurements
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(rest[:, 0]))[:4], [0, 3, 6, 9])
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(rest[:, 1]))[:4], [0, 4, 8, 12])
    np.testing.assert_array_equal(rest[:, 2], MOTION)
    assert np.isfinite(drive.measurements[:, 0]).all()
