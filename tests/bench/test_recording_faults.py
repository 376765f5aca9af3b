"""The proof of ``harness check`` in short: one drawn drive, one fault of every kind."""

import numpy as np
import pytest

from bench.recording_faults import drives
from bench.recording_faults.__main__ import RECALL, main, summary
from bench.recording_faults.planted import planted
from bench.recording_faults.run import CLEAN, check_drive, line_of, score_drive, scored


@pytest.fixture(scope="module")
def drive():
    return drives.car(3)


@pytest.fixture(scope="module")
def clean(drive):
    return check_drive(drive)[0]


def test_a_drive_without_a_fault_has_no_finding(clean):
    assert clean.findings == ()
    assert clean.remedy is None


@pytest.mark.parametrize(
    "kind",
    [
        "yaw rate: 1/57.3²",
        "speed: 3.6, 1/3.6",
        "acceleration: reversed",
        "heading: compass, degrees",
        "exchanged: yaw rate, lateral acceleration",
        "exchanged: position axes",
        "wheel radius: 0.3 to 3 %",
        "delay of the yaw rate: 10 to 150 ms",
        "drift of a clock: 200 to 1000 ppm",
    ],
)
def test_a_planted_fault_is_named_and_mended(drive, clean, kind):
    fault = next(f for f in planted(drive, np.random.default_rng(5)) if f.kind == kind)
    result = scored(drive, clean, fault, measured=False)
    assert result.named, result.found
    assert result.passes, result.found
    assert result.further == 0, result.found


def test_the_score_counts_what_is_missed(drive, clean):
    fault = planted(drive, np.random.default_rng(5))[0]
    harmless = type(fault)(fault.kind, fault.signals, 1.0, fault.named, fault.plant)
    assert not scored(drive, clean, harmless, measured=False).named


@pytest.mark.proof
def test_the_command_writes_the_table_of_what_is_there(tmp_path, capsys):
    """Of one drive, which was checked before."""
    found = list(score_drive(lambda: drives.semitrailer(5), 5, measured=False))
    (tmp_path / "checks.jsonl").write_text("".join(map(line_of, found)), encoding="utf-8")
    _, recall, alarms = summary(found, measured=False)
    assert recall >= 0.9
    assert alarms == 0
    assert main(["--seeds", "5:5", "--foreign", "3:3", "--no-measured", "--out", str(tmp_path)]) == (recall < RECALL)
    said = capsys.readouterr().out
    assert f"({recall:.1%})" in said
    assert "0 of 1 drives without a planted fault have a finding" in said
    kinds = {s.kind for s in found}
    assert kinds > {CLEAN, "time: ms, us, s for ms"}
    assert len((tmp_path / "table.md").read_text(encoding="utf-8").splitlines()) == len(kinds - {CLEAN}) + 2
