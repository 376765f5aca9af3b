"""Recordings in which each message of a bus has a clock of its own, in a structure or in rows of a table."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import load_recording
from support.weaving_car import TIME, drive, stored


def test_clocks_of_one_length_belong_to_their_structures(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    early, late = TIME + 0.002, TIME + 0.007
    path, channels = tmp_path / "a.mat", tmp_path / "map.toml"
    scipy_io.savemat(path, {"a": {"t": early, "v": 10 + np.sin(early)}, "b": {"t": late, "w": np.sin(late)}})
    written = (
        'time = [{ channel = "a.t", unit = "s" }, { channel = "b.t", unit = "s" }]\n'
        'speed = { channel = "a.v", unit = "m/s" }\nheading = { channel = "b.w", unit = "rad" }\n'
    )
    channels.write_text(written)
    recording = load_recording(path, channels)
    time = recording["time"].values + recording.attrs["start"]
    np.testing.assert_allclose(recording["heading"][1:], np.sin(time)[1:], atol=1e-4)
    scipy_io.savemat(path, {"t": early, "v": 10 + np.sin(early), "u": late, "w": np.sin(late)})
    channels.write_text(written.replace("a.", "").replace("b.t", "u").replace("b.", ""))
    with pytest.raises(UserError, match=r"'t' and 'u' of .* may both be the clock of 'v'"):
        load_recording(path, channels)


def by_message(path, quantum=0.0):
    """Write a file in which each of three messages of a bus has rows of its own; return their stamps and channels."""
    rng, rows, messages = np.random.default_rng(0), [], {}
    for name, rate, phase in (("speed", 50, 0.003), ("yaw_rate", 100, 0.001), ("heading", 200, 0.004)):
        time = np.arange(phase, 40.0, 1 / rate)
        stamps = time + 0.0002 * rng.standard_normal(len(time))
        messages[name] = stamps, 10 + np.sin(time) + 0.1 * rng.standard_normal(len(time))
        written = np.round(stamps / quantum) * quantum if quantum else stamps
        rows += [(t, name, v) for t, v in zip(written, messages[name][1], strict=True)]
    lines = [",".join([f"{t}", *(f"{v}" if n == c else "" for c in messages)]) for t, n, v in sorted(rows)]
    path.write_text("\n".join([",".join(["time", *messages]), *lines, ""]))
    return messages


def test_each_message_of_a_bus_has_the_clock_of_its_own_rows(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    messages = by_message(tmp_path / "a.csv")
    scipy_io.savemat(tmp_path / "a.mat", {n: {"t": t, "v": v} for n, (t, v) in messages.items()})
    clocks = ", ".join(f'{{ channel = "{n}.t", unit = "s" }}' for n in messages)
    units = {"speed": "m/s", "yaw_rate": "rad/s", "heading": "rad"}
    (tmp_path / "map.toml").write_text(
        f"time = [{clocks}]\n"
        + "".join(f'{n} = {{ channel = "{n}.v", unit = "{u}" }}\n' for n, u in units.items())
        + '[recording]\nstep = "10 ms"\n'
    )
    found, apart = (
        load_recording(tmp_path / "a.csv", step=0.01),
        load_recording(tmp_path / "a.mat", tmp_path / "map.toml"),
    )
    assert found.attrs["warnings"] == []
    for name in messages:
        np.testing.assert_array_equal(found[name], apart[name])
        assert found[name].attrs["missing"] == 0


def test_messages_with_the_same_stamp_are_not_taken_for_one_that_repeats(tmp_path):
    """Stamps in whole milliseconds: messages meet in them, each in a row of its own."""
    by_message(tmp_path / "a.csv", 0.001)
    found = load_recording(tmp_path / "a.csv", step=0.01)
    assert found.attrs["warnings"] == []
    assert np.isfinite(found["speed"]).all()


def test_a_channel_that_dies_is_missing_and_no_message_of_its_own(tmp_path):
    columns = drive(TIME)
    columns["yaw_rate"][len(TIME) // 3 :] = np.nan
    recording = load_recording(stored(tmp_path, columns)[0])
    assert recording["yaw_rate"].attrs["missing"] == len(TIME) - len(TIME) // 3


def merged(path, phase=0.0, columns=("speed", "heading")):
    """Write a fast message and one at 10 Hz, in rows of its own or, without a phase, in some of the fast one's rows."""
    slow = np.arange(120, 600) * 0.1 + phase
    rows = {t: [f"{10 + np.sin(t)}", ""] for t in np.arange(6000) * 0.01}
    for t in slow:
        near = min(round(t / 0.01), 5999) * 0.01
        rows.setdefault(near if phase == 0.0 else t, ["", ""])[1] = f"{np.sin(0.1 * t)}"
    lines = [",".join([f"{t!r}".replace("np.float64(", "").replace(")", ""), *rows[t]]) for t in sorted(rows)]
    path.write_text("\n".join([",".join(["time", *columns]), *lines, ""]))
    return path


@pytest.mark.parametrize("phase", [0.0, 0.003])
def test_a_slow_message_has_no_gaps_in_rows_of_its_own_or_of_a_fast_one(tmp_path, phase):
    found = load_recording(merged(tmp_path / "a.csv", phase))
    assert found["heading"].attrs["gaps"] == 0
    np.testing.assert_allclose(found["heading"][1300:5900], np.sin(0.1 * found["time"][1300:5900]), atol=1e-5)


def test_a_part_counts_from_the_first_row_of_the_file_also_where_a_message_begins_late(tmp_path):
    path = merged(tmp_path / "a.csv", 0.003)
    (tmp_path / "map.toml").write_text(
        'time = { channel = "time", unit = "s", factor = 1.01 }\nspeed = { channel = "speed", unit = "m/s" }\n'
        'heading = { channel = "heading", unit = "rad" }\n[recording]\nstart = 20\nstop = 40\n'
    )
    found = load_recording(path, tmp_path / "map.toml")
    time = (found["time"] + found.attrs["start"]) / 1.01
    assert found.attrs["start"] == pytest.approx(20.0, abs=0.02)
    assert float(found["time"][-1]) == pytest.approx(20.0, abs=0.2)
    np.testing.assert_allclose(found["heading"][20:-20], np.sin(0.1 * time)[20:-20], atol=1e-5)


def test_a_bad_stamp_in_a_slow_message_is_left_out_and_said(tmp_path):
    path = merged(tmp_path / "a.csv", 0.003)
    lines = path.read_text().splitlines()
    number = next(i for i, line in enumerate(lines) if line.startswith("30.003"))
    lines[number] = "," + lines[number].split(",", 1)[1]
    path.write_text("\n".join([*lines, ""]))
    (warning,) = load_recording(path).attrs["warnings"]
    assert f"1 rows left out whose stamp is missing, repeats or jumps back (first at row {number}," in warning


def test_only_a_slow_message_may_be_mapped(tmp_path):
    path = merged(tmp_path / "a.csv", 0.003, ("other", "heading"))
    found = load_recording(path)
    assert found["heading"].attrs["missing"] == found["heading"].attrs["gaps"] == 0
    assert float(found["time"][1]) == pytest.approx(0.1)


def test_parts_in_which_channels_are_dead_are_missing_though_they_differ(tmp_path):
    columns, third = drive(TIME), len(TIME) // 3
    columns["yaw_rate"][:third] = columns["heading"][-third:] = np.nan
    for name in set(columns) - {"time", "yaw_rate", "heading"}:
        del columns[name]
    recording = load_recording(stored(tmp_path, columns)[0])
    assert recording["yaw_rate"].attrs["missing"] == recording["heading"].attrs["missing"] == third


def test_the_time_base_of_a_slow_first_signal_is_said(tmp_path):
    path = merged(tmp_path / "a.csv", 0.003)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("\n".join([",".join([t, slow, fast]) for t, fast, slow in rows] + [""]))
    (warning,) = load_recording(path).attrs["warnings"]
    assert "'heading', 0.1 s; another one comes every 0.01 s: state [recording] step" in warning
    assert load_recording(path, step=0.01).attrs["warnings"] == []
