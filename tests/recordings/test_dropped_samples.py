"""Which samples on the common time base were measured: dropped and slower ones are joined, and say so."""

import numpy as np
import pandas as pd
import pytest

from harness import recordings
from harness.recordings.check.check_report import CONTENT, content_rows
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import recording_of
from harness.recordings.read.resample import updated_on_grid

STEP = 0.01
GRID = np.arange(1000) * STEP


def recording(**columns):
    tables = tables_of(pd.DataFrame({"time": GRID, **columns}), False)
    return recording_of(tables, "memory")


def test_a_dropped_sample_is_missing_for_filters_and_smoother_though_it_is_bridged():
    speed, yaw_rate = 20 + np.sin(GRID), 0.1 * np.cos(GRID)
    speed[[300, 301, 500]] = np.nan
    found = recording(speed=speed, yaw_rate=yaw_rate)
    assert np.isfinite(found.speed).all()
    np.testing.assert_array_equal(np.flatnonzero(~recordings.updated(found, "speed")), [300, 301, 500])
    measured = recordings.measurements(found, ["speed", "yaw_rate"])
    assert np.isnan(measured[[300, 301, 500], 0]).all()
    assert np.isfinite(measured[:, 1]).all()
    assert recordings.updated(found, "yaw_rate") is None


def test_the_share_of_missing_samples_is_that_of_the_file_and_not_of_the_bridged_signal():
    speed, slow, held = 20 + np.sin(GRID), np.full(len(GRID), np.nan), 0.1 * np.cos(GRID)
    speed[[300, 301, 500]] = np.nan
    slow[::10] = np.sin(GRID[::10])
    slow[400] = np.nan
    held[1::2] = held[::2]
    found = recording(speed=speed, heading=slow, yaw_rate=held)
    shares = {n: found[n].attrs["missing_share"] for n in found.data_vars}
    assert shares == pytest.approx({"speed": 0.003, "heading": 0.01, "yaw_rate": 0.0})
    missing = {row[0]: row[CONTENT.index("missing")] for row in content_rows(found)}
    assert list(missing.values()) == ["0.30 %", "1.00 %", "0.00 %"]


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.5])
def test_jitter_and_phase_drop_nothing(phase):
    rng = np.random.default_rng(1)
    time = GRID + phase * STEP + 0.1 * STEP * rng.normal(size=len(GRID)).clip(-2, 2)
    assert updated_on_grid(time, GRID)[1:].all()
    some = np.delete(time, [400, 401, 402])
    assert 2 <= (~updated_on_grid(some, GRID)[1:]).sum() <= 3


@pytest.mark.parametrize("every", [2, 5, 10])
def test_a_slower_channel_is_measured_where_it_has_a_sample(every):
    time = np.arange(0.002, 9.9, every * STEP)
    found = updated_on_grid(time, GRID)
    assert found.sum() == len(time)
