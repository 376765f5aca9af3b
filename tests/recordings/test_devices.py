"""What ``harness check`` says of calm drives, of devices that are late as a whole, of reversing, turns and mounting."""

import numpy as np
import pandas as pd
import pytest

from bench.recording_faults.foreign import Fault, draw
from bench.recording_faults.foreign_run import NAMED, coverage, score, table
from harness.common.errors import UserError
from harness.recordings.check.causes import DELAY, SCALE
from harness.recordings.check.run import check_tables
from harness.recordings.motion.pair_fit import long_run
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import load_recording, recording_of

STEP = 0.02
TIME = np.arange(0, 120, STEP)


def integral(rate):
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2) * STEP])


def motion(speed, rate, seed=1, late=0.0):
    """Return what bus and receiver record of a vehicle without sideslip: receiver every 0.1 s and so much late."""
    rng = np.random.default_rng(seed)
    speed, rate = np.broadcast_to(speed, TIME.shape), np.broadcast_to(rate, TIME.shape)
    heading = integral(rate)
    east, north = integral(speed * np.cos(heading)), integral(speed * np.sin(heading))
    found = {"time": TIME}
    for name, values, size in (("position_x", east, 0.02), ("position_y", north, 0.02), ("heading", heading, 0.002)):
        found[name] = np.interp(TIME - late, TIME, values) + rng.normal(0, size, len(TIME))
        found[name][np.arange(len(TIME)) % 5 != 0] = np.nan
    found["speed"] = np.abs(speed) + rng.normal(0, 0.02, len(TIME))
    found["yaw_rate"] = rate + rng.normal(0, 0.002, len(TIME))
    return pd.DataFrame(found)


WINDING = 0.1 * np.sin(2 * np.pi * TIME / 17) + 0.05 * np.sin(2 * np.pi * TIME / 5.3)
VARIED = 15 + 4 * np.sin(2 * np.pi * TIME / 23) + np.sin(2 * np.pi * TIME / 7)


def checked(frame, mapping=None):
    tables = tables_of(frame, mapped=mapping is not None)
    return check_tables(tables, "drive", mapping)


def mapping_of(frame):
    units = {"speed": "m/s", "yaw_rate": "rad/s", "heading": "rad"}
    content = {n: {"channel": n, "unit": units.get(n, "m")} for n in frame.columns if n not in ("time", "gear")}
    return {"time": [{"channel": "time", "unit": "s"}], **content}


@pytest.mark.parametrize("seed", range(4))
def test_a_constant_speed_tells_no_delay_of_it(seed):
    found = checked(motion(20.0, WINDING, seed))
    assert found.findings == (), list(map(str, found.findings))
    assert "speed against speed over ground is too calm to tell a delay: accelerate and brake" in found.summary


def test_a_receiver_that_is_late_is_one_cause():
    found = checked(motion(VARIED, WINDING, late=0.2))
    (late,) = found.findings
    assert (late.kind, set(late.signals)) == (DELAY, {"position_x", "position_y", "heading"})
    assert late.value == pytest.approx(0.2, abs=0.003)
    assert {line.split(" = ")[0] for line in found.remedy.lines} == {"position_x", "position_y", "heading"}
    assert found.remedy.passes


def test_a_delay_that_the_map_takes_out_may_be_too_much():
    frame = motion(VARIED, WINDING)
    mapping = mapping_of(frame)
    mapping["speed"]["delay"] = "150 ms"
    (early,) = checked(frame, mapping).findings
    assert (early.kind, early.signals) == (DELAY, ("speed",))
    assert early.value == pytest.approx(-0.15, abs=0.005)
    assert "or position_x and position_y: 1" in early.words


def test_an_unsigned_speed_is_named_and_signed_by_the_course():
    speed = 6 - 9 / (1 + np.exp(60 - TIME)) + 9 / (1 + np.exp(80 - TIME)) + np.sin(TIME / 3)
    frame = motion(speed, WINDING)
    found = checked(frame)
    assert [f.kind for f in found.findings] == ["reverse"], list(map(str, found.findings))
    assert "drives backwards at 61 to 79 s" in str(found.findings[0])
    assert found.remedy.content["speed"]["reverse"] == "course"
    assert found.remedy.passes
    signed = recording_of(tables_of(frame, mapped=True), "drive", found.remedy.content)["speed"].to_numpy()
    assert np.abs(signed - np.interp(np.arange(len(signed)) * STEP, TIME, speed))[200:-200].max() < 0.8


def test_the_gear_gives_a_speed_its_sign(tmp_path):
    speed = np.where((TIME > 60) & (TIME < 80), -3.0, 6.0)
    frame = motion(speed, WINDING).assign(gear=np.where(speed < 0, -1.0, 3.0))
    mapping = mapping_of(frame)
    mapping["speed"]["reverse"] = "gear"
    assert checked(frame, mapping).findings == ()
    frame.to_csv(tmp_path / "log.csv", index=False)  # of a file only the columns are read that the map names
    read = load_recording(tmp_path / "log.csv", mapping)["speed"].to_numpy()
    assert read[3500] == pytest.approx(-3.0, abs=0.1)
    assert read[1000] == pytest.approx(6.0, abs=0.1)
    mapping["speed"]["reverse"] = "gears"
    with pytest.raises(UserError, match=r"'gears' is no column of .*closest: gear"):
        checked(frame, mapping)
    mapping["speed"]["reverse"] = ""
    mapping["yaw_rate"]["reverse"] = "gear"
    with pytest.raises(UserError, match="yaw_rate has a sign of its own"):
        checked(frame, mapping)


@pytest.mark.parametrize(("rate", "turns"), [(0.28, 1), (0.75, 2)])
def test_a_heading_is_continued_across_a_gap_by_the_yaw_rate(rate, turns):
    frame = motion(5.0, rate)
    gap = (frame["time"] > 40) & (frame["time"] < 55)
    frame["heading"] = np.angle(np.exp(1j * frame["heading"]))
    frame.loc[gap, "heading"] = np.nan
    heading = recording_of(tables_of(frame, mapped=False), "drive")["heading"].to_numpy()
    expected = rate * 100.0
    assert heading[5000] - heading[0] == pytest.approx(expected, abs=0.1), turns
    alone = frame.drop(columns="yaw_rate")
    warnings = recording_of(tables_of(alone, mapped=False), "drive").attrs["warnings"]
    assert any("unknown by multiples of a turn" in w for w in warnings)


def test_an_upright_axis_is_named():
    frame = motion(VARIED, WINDING)
    frame["lateral_acceleration"] = 9.79 + 0.1 * np.random.default_rng(2).normal(size=len(TIME))
    (found,) = checked(frame).findings
    assert found.kind == "mounting"
    assert "9.79 m/s²" in found.words
    assert "that axis of the sensor points up" in found.words


def test_a_comparison_without_samples_says_which_are_missing():
    fits = checked(motion(0.8 + 0.4 * np.sin(TIME), 0.3 * np.sin(TIME))).fits
    (course,) = (f for f in fits if f.relation.signal == "heading")
    assert course.reasons == ("both are known on 0 samples of those faster than 2 m/s, 0 s; 2 s are needed",)


def test_a_leaning_accelerometer_has_no_wrong_scale():
    frame = motion(VARIED, WINDING)
    frame["longitudinal_velocity"] = frame["speed"]
    frame["lateral_velocity"] = np.random.default_rng(3).normal(0, 0.01, len(TIME))
    frame["lateral_acceleration"] = 1.067 * VARIED * WINDING + np.random.default_rng(4).normal(0, 0.05, len(TIME))
    assert SCALE not in {f.kind for f in checked(frame).findings}


def test_long_run_is_that_of_newey_and_west():
    values = np.random.default_rng(5).normal(size=(400, 2))
    lags = 30
    expected = values.T @ values
    for lag in range(1, lags + 1):
        cross = values[lag:].T @ values[:-lag]
        expected += (1 - lag / (lags + 1)) * (cross + cross.T)
    assert long_run(values, lags) == pytest.approx(expected)


def test_foreign_drives_are_scored():
    scores = [score((3, planted)) for planted in ("nothing", "one device")]
    assert scores[0].false == scores[1].false == ()
    assert scores[1].outcomes == (NAMED,), scores[1].said
    assert "1 of 1 stated intervals" in coverage(scores)
    assert "| lively | one device | 1 | 1 | 1 | 0 | 0 | 0 |" in table(scores)


def test_foreign_drives_hold_what_is_planted():
    clean, late = draw(3, "nothing"), draw(3, "one device")
    (fault,) = late.faults
    assert isinstance(fault, Fault)
    assert fault.kind == DELAY
    column = clean.mapping[fault.signals[0]]["channel"]
    before, after = (d.tables[0].columns[column] for d in (clean, late))
    rows = np.isfinite(before) & np.isfinite(after)
    lags = [float(np.std(after[rows][k:] - before[rows][: rows.sum() - k])) for k in range(30)]
    assert abs(np.argmin(lags) / late.rates[0] - fault.size) < 1 / late.rates[0]


@pytest.mark.parametrize("channel", ["position_y", "yaw_rate"])
def test_of_two_explanations_that_explain_alike_both_are_named_and_no_line_is_written(channel):
    frame = motion(VARIED, WINDING).drop(columns="heading")
    found = checked(frame.assign(**{channel: -frame[channel]}))
    (sign,) = found.findings
    assert "yaw_rate: wrong sign" in sign.words
    assert "position_y: wrong sign" in sign.words
    assert not sign.mends
    assert found.remedy is None
