"""``make short-runs`` in short: every figure is there, and what was killed is continued."""

import re
import sys

import pytest

from bench.scale import main
from bench.short_runs import session


def said(monkeypatch, capsys, *arguments):
    """Run the command and return what it prints."""
    monkeypatch.setattr(sys, "argv", ["bench.scale", *map(str, arguments)])
    main()
    return capsys.readouterr().out


@pytest.mark.proof
def test_what_runs_take_beside_their_kernels(tmp_path, monkeypatch, capsys):
    printed = said(monkeypatch, capsys, "--run", "--runs", 16 * 64, "--out", tmp_path)
    assert "in one go" in printed
    assert "killed half-way" in printed
    assert "Kernels take" in printed
    again = session(tmp_path, 1)
    assert (again.runs, again.kernels) == (0, 0.0)
    assert again.start > 0.0


@pytest.mark.proof
def test_dask_is_measured_against_threads(tmp_path, monkeypatch, capsys):
    printed = said(monkeypatch, capsys, "--dask", "--runs", 400, "--rounds", 1, "--out", tmp_path)
    assert re.search(r"(?i)dask", printed)
    assert all(float(n) > 0 for n in re.findall(r"(\d+\.\d+) (?:s|ms|us|µs)\b", printed))


@pytest.mark.proof
def test_the_report_of_a_store_of_many_runs_is_timed(tmp_path, monkeypatch, capsys):
    printed = said(monkeypatch, capsys, "--runs", 2000, "--out", tmp_path / "store")
    seconds, memory = re.fullmatch(r"2,000 runs: report in (\d+) s, at most ([\d,]+) MiB\n", printed).groups()
    assert int(seconds) < 600
    assert 50 < int(memory.replace(",", "")) < 10_000
    assert (tmp_path / "store" / "report.pdf").stat().st_size > 10_000
