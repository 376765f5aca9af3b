"""Time series beside a result keep every extreme, and a broken file is refused in a sentence."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.series import largest, packed, thinned, unpacked


def test_what_was_packed_is_there_again_with_its_extremes(tmp_path):
    rng, time = np.random.default_rng(3), np.arange(50_000) / 100
    long = {"time": time, "measured yaw_rate": rng.standard_normal(50_000), "before yaw_rate": np.full(50_000, np.nan)}
    short = {"time": time[:20], "measured yaw_rate": np.arange(20.0)}
    file = tmp_path / "drives.npz"
    file.write_bytes(packed({"a/b <c>": long, "log 2": short}))
    found = unpacked(file)
    assert list(found) == ["a/b <c>", "log 2"]
    kept = found["a/b <c>"]
    assert 3000 < len(kept["time"]) < 9000
    for pick in (np.min, np.max):
        assert pick(kept["measured yaw_rate"]) == pytest.approx(pick(long["measured yaw_rate"]))
    assert np.isnan(kept["before yaw_rate"]).all()
    assert np.array_equal(found["log 2"]["measured yaw_rate"], np.arange(20.0))


def test_a_file_of_another_kind_is_refused(tmp_path):
    file = tmp_path / "drives.npz"
    file.write_bytes(b"PK no archive")
    with pytest.raises(UserError, match="no time series"):
        unpacked(file)


@pytest.mark.parametrize(("first", "stop"), [(0, 60_001), (123, 40_000), (10, 50)])
def test_every_extreme_of_every_column_is_kept(first, stop):
    rng = np.random.default_rng(4)
    columns = [rng.standard_normal(60_001) for _ in range(3)]
    columns[1][30_000] = 50.0
    columns[2][500:900] = np.nan
    rows = thinned(columns, first, stop, bins=100)
    assert len(rows) <= min(stop - first, 101 * 7 + 1)
    assert (rows[0], rows[-1]) == (first, stop - 1)
    assert (np.diff(rows) > 0).all()
    width = -(-(stop - first) // 100)
    for column in columns:
        for begin in range(first, stop, width):
            whole, part = (
                column[begin : min(begin + width, stop)],
                rows[(rows >= begin) & (rows < min(begin + width, stop))],
            )
            if np.isfinite(whole).any():
                assert np.nanmax(whole) == np.nanmax(column[part])
                assert np.nanmin(whole) == np.nanmin(column[part])


def test_the_largest_of_each_part():
    column = np.array([1.0, 5.0, np.nan, 2.0, np.nan, np.nan])
    assert np.array_equal(largest(column, np.array([0, 2, 4])), [5.0, 2.0, np.nan], equal_nan=True)
