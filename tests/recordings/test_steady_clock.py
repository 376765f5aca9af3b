"""Stamps that jitter about a steady clock: its instants are found, unless the samples were taken at the stamps."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import load_recording
from harness.recordings.read.clock import check_clock, steadied

STEP, SAMPLES = 0.01, 6000


def motion(time):
    return np.sin(2 * np.pi * 0.4 * time) + 0.3 * np.sin(2 * np.pi * 1.1 * time)


@pytest.fixture(scope="module")
def stamps():
    """Return instants and stamps of a steady clock with lost samples."""
    rng = np.random.default_rng(0)
    kept = rng.random(SAMPLES) >= 0.001
    instants = STEP * np.arange(SAMPLES)
    jitter = np.clip(1e-3 * rng.standard_normal(SAMPLES), -0.4 * STEP, 0.4 * STEP)
    return instants[kept], (instants + jitter)[kept]


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_signals_tell_whether_samples_were_taken_at_their_stamps(stamps, noise):
    instants, jittered = stamps
    clock = check_clock(jittered, "file: 'time'")
    white = noise * np.random.default_rng(1).standard_normal(len(instants))
    at_rest = np.zeros(len(instants))
    mended = steadied(clock, [at_rest, motion(instants) + white])
    assert mended.time == pytest.approx(instants, abs=1e-4)
    assert (mended.rows == clock.rows).all()
    assert steadied(clock, [at_rest, motion(jittered) + white]) is clock


@pytest.mark.parametrize("seed", [0, 15, 18])
def test_a_channel_that_repeats_its_values_tells_nothing(seed):
    """Speed held for two samples: its steps while the vehicle accelerates looked like samples taken at the stamps."""
    rng, instants = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    jittered = instants + np.clip(1e-3 * rng.standard_normal(SAMPLES), -0.4 * STEP, 0.4 * STEP)
    speed = 20 + 3 * np.tanh((instants - 30) / 0.15) + 0.002 * rng.standard_normal(SAMPLES)
    mended = steadied(check_clock(jittered, "file: 'time'"), [speed[np.arange(SAMPLES) // 2 * 2]])
    assert mended.time == pytest.approx(instants, abs=1e-4)


def test_a_clock_that_wanders_or_is_exact_or_short_stays(stamps):
    instants, jittered = stamps
    wandering = instants + 1e-3 * np.sin(0.2 * instants)
    irregular = np.cumsum(np.random.default_rng(2).uniform(0.2, 1.8, SAMPLES)) * STEP
    for time in (wandering, irregular, instants, jittered[:50]):
        clock = check_clock(time, "file: 'time'")
        assert steadied(clock, [motion(time)]) is clock


def test_noise_stays_white_on_the_grid(stamps, tmp_path):
    """Samples that lie on the grid are not mixed: interpolation between jittering stamps correlates them."""
    instants, jittered = stamps
    read = motion(instants) + 0.05 * np.random.default_rng(3).standard_normal(len(instants))
    file = tmp_path / "drive.csv"
    np.savetxt(file, np.column_stack([jittered, read]), delimiter=",", header="time,yaw_rate", comments="")
    mapping = {
        "time": {"channel": "time", "unit": "s"},
        "yaw_rate": {"channel": "yaw_rate", "unit": "rad/s"},
        "recording": {"step": "10 ms"},
    }
    loaded = load_recording(file, mapping)
    on_grid = loaded["yaw_rate"].to_numpy()[np.rint(instants / STEP).astype(int)[: len(instants) - 2]]
    assert on_grid == pytest.approx(read[: len(on_grid)], abs=2e-3)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (1e306 * np.arange(100), r"stamps reach 9.9e\+307 s"),
        (np.append(STEP * np.arange(199), 1e308), r"stamps reach 1e\+308 s"),
        (-1e200 + 1e198 * np.arange(90), r"stamps reach 1e\+200 s"),
        (1e17 + 100 * np.arange(200), "a step of 96 s is lost|a step of 112 s is lost"),
    ],
)
def test_stamps_that_no_clock_gives_are_refused(stamps, message):
    with pytest.raises(UserError, match=message):
        check_clock(stamps, "file: 'time'")


def test_nanoseconds_of_the_epoch_taken_for_seconds_are_a_clock():
    assert check_clock(1.76e18 + 1e5 * np.arange(200), "file: 'time'").step == pytest.approx(1e5, abs=256)
