"""The short form of ``make faults``: a study that was struck has the bits of one that was not."""

import pytest

from bench.faults.__main__ import main
from bench.faults.faults import PLAN, SHORT


def test_the_long_form_strikes_everything_and_at_least_forty_times():
    assert set(PLAN) == {"study", "campaign", "identify", "tune", "trace", "remedy"}
    assert sum(sum(faults.values()) for faults in PLAN.values()) >= 40
    assert all(fault in PLAN[job] for job, faults in SHORT.items() for fault in faults)


@pytest.mark.proof
def test_a_study_that_was_struck_has_the_same_bits(tmp_path, capsys):
    assert main(["--short", "--out", str(tmp_path / "faults"), "--seed", "1"]) == 0
    assert "7 of 7 faults survived with the same bits" in capsys.readouterr().out
