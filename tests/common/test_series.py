"""Time series beside a result keep every extreme, and a broken file is refused in a sentence."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.series import packed, unpacked


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
