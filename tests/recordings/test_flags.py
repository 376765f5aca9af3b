"""Values that a column beside them calls none are missing."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import load_recording, readers
from harness.recordings.read.channel_map import load_map
from harness.recordings.read.channels import collect


@pytest.mark.parametrize(
    ("condition", "lost"),
    [
        ("Fix", [3, 4, 7]),
        ("Fix == 2", [0, 3, 4, 7, 10, 11, 12, 13]),
        ("Fix != 1", [0, 7, 10, 11, 12, 13]),
        ("Fix==1", [1, 2, 3, 4, 5, 6, 7, 8, 9]),
    ],
)
def test_values_that_a_flag_says_are_none_are_missing(tmp_path, condition, lost):
    flags = ["1", "2", "2", "0", "0", "2", "2", "", "2", "2", *["1"] * 4]
    rows = [f"{i / 10},{np.sin(i)},{flag}" for i, flag in enumerate(flags)]
    (tmp_path / "a.csv").write_text("\n".join(["t,w,Fix", *rows, ""]), encoding="utf-8")
    entry = {"channel": "w", "unit": "rad/s", "valid": condition}
    tables = readers.read_tables(tmp_path / "a.csv")
    mapping = load_map({"time": {"channel": "t", "unit": "s"}, "yaw_rate": entry})
    (raw,), _ = collect(tables, mapping, "a.csv")
    assert sorted(set(range(14)) - set(np.rint(10 * raw.time).astype(int))) == lost
    assert raw.missing == len(lost)


@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ("Fxi", "'Fxi' is no column of"),
        ("Fix == good", "'good' is no number"),
        ("Fix == 7", "where Fix == 7"),
    ],
)
def test_a_flag_that_is_none_is_named(tmp_path, condition, says):
    (tmp_path / "a.csv").write_text("t,w,Fix\n0,1,1\n0.1,2,1\n0.2,3,1\n", encoding="utf-8")
    entry = {"channel": "w", "unit": "rad/s", "valid": condition}
    with pytest.raises(UserError, match=says):
        load_recording(tmp_path / "a.csv", {"time": {"channel": "t", "unit": "s"}, "yaw_rate": entry})
