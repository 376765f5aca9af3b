"""``harness verify`` and ``harness status`` as they print."""

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.config import load_study
from harness.study.run import run_study
from harness.study.store import STORE
from support.probe_study import STUDY


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "probe.toml").write_text(STUDY)
    run_study(load_study(folder / "probe.toml"), folder / "out", jobs=1)
    return folder


def harness(*arguments):
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, " ".join(done.output.split())


def test_verify_and_status_say_what_they_find(probe):
    (probe / "probe.toml").rename(probe / "elsewhere.toml")
    status, said = harness("verify", probe / "out", "--sample", 1)
    assert status == 0
    assert "files: all as they were written 1 of 6 finished units" in said
    assert "computed again: the same bits" in said
    status, said = harness("status", probe / "out")
    assert status == 0
    assert "study 'probe': 28 of 28 runs done, 0 missing" in said
    assert said.endswith("nobody is at work")
    lost = probe / "out" / STORE / "level" / "rmse" / "c.1.0.0.0.0.0"
    lost.unlink()
    status, said = harness("verify", probe / "out")
    assert status == 1
    assert said.startswith("failed: level/rmse/c.1.0.0.0.0.0 is missing 'harness run' with its study computes what is")
    status, said = harness("status", probe / "out")
    assert status == 0
    assert "23 of 28 runs done, 5 missing" in said
    assert "level/rmse/c.1.0.0.0.0.0 is missing" in said


def test_a_folder_without_a_result(tmp_path):
    status, said = harness("status", tmp_path)
    assert status == 2
    assert "there is no result of a study here" in said
