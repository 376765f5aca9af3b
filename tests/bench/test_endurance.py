"""Kalman-type filters over many hours: a short form of ``make endurance``."""

import sys

import pytest

from bench.endurance import KINDS, main


@pytest.mark.proof
def test_covariances_stay_symmetric_and_definite(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(sys, "argv", ["bench.endurance", "--hours", "0.2"])
    main()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in capsys.readouterr().out.splitlines()]
    rows = [row for row in rows if row]
    assert [row[0] for row in rows] == list(KINDS)
    for kind, asymmetry, pivot, repairs, outside, _ in rows:
        assert float(asymmetry) == 0.0, kind
        assert 1e-13 < float(pivot) < 1.0, kind  # 1 where no sample was filtered
        assert (repairs, outside) == ("0", "0"), kind
