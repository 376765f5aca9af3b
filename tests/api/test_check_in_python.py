"""``harness.check``: the same as the command, from memory or from a file."""

import json

import numpy as np
import pandas as pd
import pytest

import harness as h
from harness.common.errors import UserError

CHANNELS = {
    "time": {"channel": "t", "unit": "s"},
    "heading": {"channel": "psi", "unit": "rad"},
    "yaw_rate": {"channel": "gyro", "unit": "rad/s"},
    "speed": {"channel": "v", "unit": "m/s"},
    "lateral_acceleration": {"channel": "ay", "unit": "m/s^2"},
}


@pytest.fixture(scope="module")
def log():
    time, rng = np.arange(0, 80, 0.01), np.random.default_rng(1)
    heading = 0.6 * np.sin(0.5 * time) + 0.2 * np.sin(2 * time)
    rate, noise = np.gradient(heading, 0.01), rng.normal(size=(4, len(time)))  # speed and a_y say: it is the gyro
    columns = {
        "psi": heading + 0.0005 * noise[0],
        "gyro": -rate + 0.002 * noise[1],
    }
    return pd.DataFrame({"t": time, **columns, "v": 12 + 0.02 * noise[2], "ay": 12 * rate + 0.05 * noise[3]})


def test_a_reversed_gyro_is_named_and_mended_from_memory_as_from_a_file(log, tmp_path):
    found = h.check(log, CHANNELS)
    assert [(f.kind, f.signals) for f in found.findings] == [("sign", ("yaw_rate",))]
    assert found.mended["yaw_rate"]["sign"] == -1
    assert found.passes
    assert "nothing disagrees any more" in found.answer
    assert set(found.comparisons.verdict) == {"does not agree"}
    log.to_csv(tmp_path / "log.csv", index=False)
    again = h.check(tmp_path / "log.csv", CHANNELS)
    assert again.answer == found.answer
    written = {p.name for p in again.report(tmp_path / "report")}
    assert written == {"check.html", "check.pdf", "check.json", "signals.npz", "mended.toml"}
    record = json.loads((tmp_path / "report" / "check.json").read_text())
    assert any("sign = -1" in line for line in record["mended"])
    (compared,) = (c for c in record["comparisons"] if c["signals"] == ["yaw_rate", "heading"])
    assert compared["slope"] == pytest.approx(-1, abs=0.01)
    assert compared["exact"]
    clean = h.check(log, found.mended)
    assert clean.findings == []
    assert clean.mended is None
    assert clean.passes
    assert "wrong sign" in repr(found)
    assert "comparisons" in found._repr_html_()


def test_a_part_of_a_file_is_checked_alone_and_named_by_file_not_by_map(log, tmp_path):
    log.assign(gyro=np.where(log.t < 40, -log.gyro, log.gyro)).to_csv(tmp_path / "log.csv", index=False)
    first, second = (h.check(f"{tmp_path / 'log.csv'}@{part}", {**CHANNELS, "title": "b"}) for part in (":40s", "40s:"))
    assert first.findings == []
    assert [(f.kind, f.signals) for f in second.findings] == [("sign", ("yaw_rate",))]
    first.report(tmp_path / "report")
    record = json.loads((tmp_path / "report" / "check.json").read_text())
    assert record["title"] == "log.csv@0s:39.99s"
    with pytest.raises(UserError, match="there is nothing in that span"):
        h.check(f"{tmp_path / 'log.csv'}@90s:", CHANNELS)


def test_a_step_that_fits_no_unit_of_time_is_no_reason_to_refuse(log):
    """The map wants 10 ms; read in seconds, the stamps in microseconds would make eight thousand million samples."""
    found = h.check(log.assign(t=1e6 * log.t, gyro=-log.gyro), {**CHANNELS, "recording": {"step": "10 ms"}})
    assert [f.kind for f in found.findings] == ["time"]
    assert found.mended["time"][0]["unit"] == "us"
    assert found.passes


def test_a_delay_that_the_map_wants_estimated_is_no_finding(log):
    late = np.interp(log.t - 0.06, log.t, -log.gyro)
    wanted = {**CHANNELS, "yaw_rate": {"channel": "gyro", "unit": "rad/s", "delay": "estimate"}}
    for factor, kinds in ((1.0, []), (np.degrees(1.0), ["unit"])):
        found = h.check(log.assign(gyro=factor * late), wanted)
        assert [f.kind for f in found.findings] == kinds
        assert found.passes
    plain = h.check(log.assign(gyro=late), CHANNELS)
    assert [f.kind for f in plain.findings] == ["delay"]


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(h.UserError, match=r"none\.csv"):
        h.check(tmp_path / "none.csv", CHANNELS)
