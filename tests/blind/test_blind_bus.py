"""Bus quality of the blind plant: every channel a message of its own; the drives are those of clean recordings."""

import numpy as np
import pytest
from plant_bus import INTERVALS, ON_TIME, RESOLUTION, draw_bus
from plant_cases import cases, seeds
from plant_field import LOST, SPEED_STEP
from plant_simulation import drive

from support.blind_vehicles import NOMINAL


@pytest.fixture(scope="module")
def both():
    """The same drive of a car, clean and in bus quality, with the logger."""
    case, found = cases()["car-none"], []
    logger = draw_bus("car", np.random.default_rng(seeds(case, 0)[4]))
    for given in (None, logger):
        found.append(drive(NOMINAL["car"], seeds(case, 0)[1], given))
    return *found, logger


def test_every_row_is_one_message_in_the_order_of_the_stamps(both):
    clean, bus, _ = both
    np.testing.assert_array_equal(clean.truth, bus.truth)
    assert clean.recording.keys() == bus.recording.keys()
    time, *columns = bus.recording.values()
    assert (np.isfinite(columns).sum(axis=0) == 1).all()
    assert (np.diff(time) >= 0).all()


def test_every_message_has_a_rate_and_a_phase_of_its_own_and_stamps_that_jitter(both):
    _, bus, logger = both
    for name, interval in logger.intervals.items():
        stamps = bus.recording["time"][np.isfinite(bus.recording[name])] * 1e3
        place = (stamps - logger.phases[name]) / interval
        assert 0.8 * ON_TIME < np.std((place - np.round(place)) * interval * 1e-3) < 1.2 * ON_TIME
        assert 0.0 < 1 - len(stamps) / (120e3 / interval) < 3 * LOST
        np.testing.assert_allclose(stamps, np.round(stamps / RESOLUTION / 1e3) * RESOLUTION * 1e3)


def test_a_speed_comes_in_steps_and_is_not_held(both):
    _, bus, _ = both
    speed = bus.recording["speed"][np.isfinite(bus.recording["speed"])]
    counts = speed / SPEED_STEP
    assert (np.abs(counts - np.round(counts)) > 1e-6).sum() <= 8  # outliers alone are off the steps
    assert np.mean(np.diff(speed) == 0) < 0.1


def test_rates_and_phases_differ_between_messages():
    loggers = [draw_bus("semitrailer", np.random.default_rng(i)) for i in range(30)]
    assert {interval for each in loggers for interval in each.intervals.values()} == set(INTERVALS)
    assert all(0 <= each.phases[name] < each.intervals[name] for each in loggers for name in each.phases)
    assert all(len(set(each.phases.values())) > 1 for each in loggers)
