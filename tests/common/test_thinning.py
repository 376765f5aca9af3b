"""A line through fewer samples has the extremes of the whole."""

import numpy as np
import pytest

from harness.common.thinning import kept, largest


@pytest.mark.parametrize(("first", "stop"), [(0, 60_001), (123, 40_000), (10, 50)])
def test_every_extreme_of_every_column_is_kept(first, stop):
    rng = np.random.default_rng(4)
    columns = [rng.standard_normal(60_001) for _ in range(3)]
    columns[1][30_000] = 50.0
    columns[2][500:900] = np.nan
    rows = kept(columns, first, stop, bins=100)
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
