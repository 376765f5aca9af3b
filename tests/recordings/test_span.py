"""A part of a recording by its name: begin and end, what is refused, and that parts do not overlap."""

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import UserError
from harness.identification.data import refuse_the_same
from harness.recordings import load_recording
from harness.recordings.check.examine import recording_warnings
from harness.recordings.read.span import named_parts


@pytest.fixture
def lap(tmp_path):
    time = np.arange(0.0, 30.0, 0.01)
    path = tmp_path / "lap@home.csv"  # such a name is no span
    pd.DataFrame({"time": 5.0 + time, "yaw_rate": np.sin(time), "speed": 10.0 + time}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("span", "first", "last", "samples"),
    [
        ("0s:20s", 10.0, 29.99, 2000),
        (":20s", 10.0, 29.99, 2000),
        ("20 s:", 30.0, 39.99, 1000),
        ("0.1 min:12s", 16.0, 21.99, 600),
    ],
)
def test_a_part_begins_at_zero_and_ends_before_the_next_one(lap, span, first, last, samples):
    part = load_recording(f"{lap}@{span}")
    assert float(part["time"][0]) == 0.0
    assert (float(part["speed"][0]), float(part["speed"][-1])) == pytest.approx((first, last))
    assert part.sizes["time"] == samples
    assert part.attrs["file"] == str(lap)
    assert part.attrs["start"] == pytest.approx(5.0 + first - 10.0)


def test_a_file_without_a_span_is_whole(lap):
    assert "span" not in load_recording(lap).attrs
    assert named_parts("C:/drives/lap.csv")[1:] == (None, None)


@pytest.mark.parametrize(
    ("span", "said"),
    [
        ("20s:10s", "end behind that"),
        ("-3s:10s", "must begin at 0 s or later"),
        ("40s:50s", "runs from 0 to 29.99 s; there is nothing in that span"),
        ("0kg:10s", "begin"),
    ],
)
def test_a_wrong_span_says_what_is_right(lap, span, said):
    with pytest.raises(UserError) as caught:
        load_recording(f"{lap}@{span}")
    assert said in str(caught.value)


def test_what_is_fitted_is_not_held_out(lap):
    begin, middle, end, whole = (load_recording(f"{lap}{s}") for s in ("@:20s", "@15s:25s", "@20s:", ""))
    refuse_the_same([begin], [end])
    for fitted, held_out in (([begin], [middle]), ([end], [middle]), ([whole], [end]), ([begin], [whole])):
        with pytest.raises(UserError, match="overlaps what is fitted"):
            refuse_the_same(fitted, held_out)


def test_what_is_odd_about_a_file_is_said_once_of_several_parts(tmp_path):
    time = np.arange(0.0, 30.0, 0.01)
    gap = (time > 10) & (time < 11)
    table = pd.DataFrame({"time": time, "yaw_rate": np.where(gap, np.nan, 0.1 * np.sin(time)), "speed": 10.0 + time})
    table.to_csv(tmp_path / "lap.csv", index=False)
    parts = [load_recording(f"{tmp_path / 'lap.csv'}@{part}").assign_attrs(name="lap") for part in ("0s:9s", "12s:")]
    assert [w.split(": gaps")[0] for w in recording_warnings(parts) if "gaps longer" in w] == ["lap: yaw_rate"]
