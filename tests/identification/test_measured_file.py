"""Files of measured drives: spans of recordings, and what is refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.identification.measured_file import MeasuredStudy

FILE = """
title = "t"
recordings = "rec"
step = "10 ms"
{more}
[model]
vehicle = "car"
parameters = "blanco_2021"
tyre = "linear"
sensors = "car_navigation"
[[train]]
file = "a.csv"
span = ["1 s", "31 s"]
[[test]]
file = "a.csv"
span = ["{start} s", "61 s"]
{last}
"""
FILES = sorted(p for folder in ("loops", "identify") for p in Path("studies", folder).glob("*.toml"))


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a loop file beside a recording of 70 s."""
    (tmp_path / "rec").mkdir()
    time = np.round(np.arange(0, 70, 0.01), 9)
    names = ("steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration", "lateral_velocity")
    table = pd.DataFrame({"time": time, **{n: np.sin(0.5 * time + i) + 20 for i, n in enumerate(names)}})
    table.to_csv(tmp_path / "rec" / "a.csv", index=False)

    def write(more="", start=31, last=""):
        path = tmp_path / "loop.toml"
        path.write_text(FILE.format(more=more, start=start, last=last))
        return path

    return write


def test_a_drive_that_is_stated_as_long_enough_is(written):
    """A recorder lost the last samples: the drive is stated to last 20.0 s, and the recording 70.0 s."""
    path = written(start=50)
    path.write_text(path.read_text().replace("61 s", "70.03 s"))
    assert MeasuredStudy.read(path).drives()["test"][0].sizes["time"] == 2000
    for stop in ("69.9 s", "70.1 s"):
        path.write_text(FILE.format(more="", start=50, last="").replace("61 s", stop))
        with pytest.raises(UserError, match=r"test\[0\]\.span"):
            MeasuredStudy.read(path).drives()


def test_spans_start_at_zero_and_keep_their_length(written):
    drives = MeasuredStudy.read(written()).drives()
    assert [float(d["time"][0]) for d in (*drives["train"], *drives["test"])] == [0.0, 0.0]
    assert float(drives["train"][0]["time"][-1]) == pytest.approx(30.0)
    augmented = drives["test"][0]["speed"].to_numpy()
    assert augmented[0] == pytest.approx(np.sin(0.5 * 31 + 1) + 20, abs=1e-6)


def test_the_step_is_that_of_the_file(written):
    path = written()
    path.write_text(path.read_text().replace('"10 ms"', '"20 ms"'))
    assert len(MeasuredStudy.read(path).drives()["train"][0]["time"]) == 1501


def test_a_model_is_integrated_finely_or_as_its_file_says(written):
    path = written()
    path.write_text(path.read_text().replace('"10 ms"', '"20 ms"'))
    own = MeasuredStudy.read(path).nominal()
    assert (own.integrator, own.step, own.substeps) == ("rk4", 0.02, 2)
    path.write_text(path.read_text().replace("[model]", "[model]\nsubsteps = 4"))
    stated = MeasuredStudy.read(path).nominal()
    assert (stated.integrator, stated.step, stated.substeps) == ("rk4", 0.02, 4)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"start": 20}, r"test\[0\]\.span: overlaps train\[0\]"),
        ({"start": 55}, r"test\[0\]\.span: 6\.0 s are too short"),
        ({"start": 62}, r"test\[0\]\.span: 62 to 61 s; 'a\.csv' runs from 0 to 70\.0 s"),
        ({"last": '[[test]]\nfile = "b.csv"'}, r"no recording 'b\.csv'.*a\.csv"),
        ({"last": '[[exclude]]\neffect = "crosswnd"\nreason = "x"'}, r"exclude\[0\]\.effect.*crosswind"),
        ({"last": '[[exclude]]\neffect = "crosswind"'}, r"exclude\[0\]\.reason"),
        ({"more": "bank_map = true"}, r"bank_map: 'a\.csv' is fitted, so the map is estimated from it"),
        ({"start": "31,5"}, r"test\[0\]\.span: '31,5 s' may mean '31\.5 s' or '315 s'"),
        ({"more": "rounds = 0"}, r"rounds"),
        ({"more": 'colour = "red"'}, r"colour"),
    ],
)
def test_what_is_wrong_is_named_with_its_key(written, changed, said):
    with pytest.raises(UserError, match=said):
        MeasuredStudy.read(written(**changed)).drives()


def test_without_the_folder_of_recordings_a_loop_is_skipped(written):
    path = written()
    (path.parent / "rec" / "a.csv").unlink()
    (path.parent / "rec").rmdir()
    result = CliRunner().invoke(app, ["loop", str(path), "--out", str(path.parent / "out")])
    assert result.exit_code == 0
    assert "skipped, there is no folder" in result.output
    assert not (path.parent / "out").exists()


def test_a_free_parameter_that_the_model_lacks_is_named(written):
    result = CliRunner().invoke(app, ["loop", str(written(more='free = ["yaw_inertai"]'))])
    assert result.exit_code == 2
    assert "free[0]" in result.output
    assert "yaw_inertia" in result.output


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_the_files_of_the_project_are_valid(path):
    study = MeasuredStudy.read(path)
    if study.channels is not None:
        assert study.channels.is_file()
    if not study.folder.is_dir():
        pytest.skip(f"there is no folder {study.folder}")
    files = [s.file for s in (*study.raw.train, *study.raw.test)]
    assert all((study.folder / f).exists() for f in files)
