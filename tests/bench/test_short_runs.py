"""``bench.scale --run`` in short: every figure is there, and what was killed is continued."""

import pytest
from rich.console import Console

from bench.scale import STUDY
from bench.short_runs import measure, session


@pytest.mark.proof
def test_what_runs_take_beside_their_kernels(tmp_path):
    (tmp_path / "scale.toml").write_text(STUDY.format(samples=16 * 64 // 20), encoding="utf-8")
    console = Console(width=300, record=True)
    measure(tmp_path, 2, console)
    said = console.export_text()
    assert "in one go" in said
    assert "killed half-way" in said
    assert "Kernels take" in said
    again = session(tmp_path, 1)
    assert (again.runs, again.kernels) == (0, 0.0)
    assert again.start > 0.0
