"""A trace that was interrupted goes on where it stopped, and says so; its progress is a line per stage."""

import dataclasses
import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from harness.diagnosis import run
from harness.diagnosis.fitting import FittedHypothesis, Fitting, KeptFits
from harness.diagnosis.model.hypotheses import coordinates
from harness.diagnosis.run import Stages, progress
from harness.diagnosis.selection.forward_selection import first_variances
from support.driven_car import FREE, driven


@pytest.fixture(scope="module")
def fitting(augmented):
    drive = augmented.drive(driven(12, duration=25.0), "drive")
    return Fitting(augmented, [drive], first_variances(augmented, [drive]))


def test_a_fit_is_taken_where_everything_is_the_same_and_only_there(augmented, fitting, tmp_path, monkeypatch):
    done = []

    def counted(self, moved, start, *turns):
        done.append(turns)
        return FittedHypothesis(moved, dataclasses.replace(start, process=start.process + 1.0), 5.0, 4.0, ended=True)

    monkeypatch.setattr(Fitting, "fit", counted)
    moved, start = coordinates(augmented, FREE, (), 1), fitting.first()
    first = KeptFits(tmp_path / "kept").fit(fitting, moved, start, (8, 3))
    kept = KeptFits(tmp_path / "kept")
    again = kept.fit(fitting, moved, start, (8, 3))
    assert (len(done), kept.taken, kept.written) == (1, 1, 0)
    np.testing.assert_array_equal(again.point.process, first.point.process)
    assert (again.coordinates, again.log_likelihood, again.objective, again.ended) == (moved, 5.0, 4.0, True)
    kept.fit(fitting, moved, start, (8, 3))
    assert (len(done), kept.taken, kept.written) == (1, 1, 0)  # the same way again is no other fit
    elsewhere = dataclasses.replace(start, measurement=start.measurement + 1e-12)
    other = dataclasses.replace(fitting.drives[0], measurements=fitting.drives[0].measurements * (1 + 1e-15))
    for what in (
        (fitting, moved, start, (9, 3)),
        (fitting, moved, elsewhere, (8, 3)),
        (fitting, moved[:1], start, (8, 3)),
        (Fitting(augmented, [other], np.ones(3)), moved, start, (8, 3)),
    ):
        kept.fit(*what)
    assert (kept.taken, kept.written) == (1, 4)
    assert len(done) == 5
    kept.fit(fitting, moved, start, (9, 3))
    assert (kept.taken, kept.written) == (1, 4)  # written by itself


def test_what_was_cut_off_is_fitted_again(augmented, fitting, tmp_path, monkeypatch):
    monkeypatch.setattr(Fitting, "fit", lambda self, moved, start, *_: FittedHypothesis(moved, start, 1.0, 1.0))
    moved = coordinates(augmented, FREE, (), 1)
    KeptFits(tmp_path).fit(fitting, moved, fitting.first(), (8, 3))
    (file,) = tmp_path.glob("*.npz")
    file.write_bytes(file.read_bytes()[:200])
    kept = KeptFits(tmp_path)
    kept.fit(fitting, moved, fitting.first(), (8, 3))
    assert (kept.taken, kept.written) == (0, 1)
    kept.remove()
    assert not tmp_path.exists()


def test_an_interrupt_says_what_is_kept_and_that_the_same_command_goes_on(tmp_path, monkeypatch):
    def interrupted(task, augmented, say, failures, kept):
        kept.written = 3
        raise KeyboardInterrupt

    for name in ("refuse_recordings", "recording_warnings"):
        monkeypatch.setattr(run, name, lambda *_: ())
    monkeypatch.setattr(run, "_searched", interrupted)
    said = io.StringIO()
    spec = SimpleNamespace(model=lambda: None)
    task = SimpleNamespace(
        train=[], test=[], recordings=[], baseline=(), spec=spec, estimators=(), study=None, notes=()
    )
    with pytest.raises(KeyboardInterrupt):
        run.run_trace(task, tmp_path, Console(file=said, width=300), SimpleNamespace(within=lambda _: None))
    text = said.getvalue()
    assert f"interrupted: 3 fits are kept in {tmp_path / 'unfinished'}" in text
    assert "goes on from there" in text


def test_without_a_terminal_every_stage_is_a_line():
    said = io.StringIO()
    with progress(Console(file=said, width=300)) as say:
        say("fitting the nominal model")
        say("round 1: score test")
    lines = said.getvalue().splitlines()
    assert [line.split("  ", 1)[1] for line in lines] == [
        "compiling the library of effects",
        "fitting the nominal model",
        "round 1: score test",
    ]


def test_the_second_round_says_how_long_it_may_take():
    now = [0.0]
    stages = Stages(lambda: now[0])
    now[0] = 10.0
    assert stages.line("round 1: score test") == "0:10  round 1: score test"
    now[0] = 70.0
    assert stages.line("round 2: score test") == "1:10  round 2: score test; about 3:00 left if it is the last round"
    now[0] = 100.0
    assert stages.line("round 2: fitting").endswith("about 2:30 left if it is the last round")


def test_what_follows_the_rounds_takes_about_as_long_as_they_did():
    now = [0.0]
    stages = Stages(lambda: now[0])
    said = []
    for at, what in ((10, "round 1: score test"), (70, "round 2: score test"), (90, "still needed?"), (150, "likely?")):
        now[0] = at
        said.append(stages.line(what))
    assert said[2:] == ["1:30  still needed?; about 1:20 left", "2:30  likely?; about 0:20 left"]
    now[0] = 175.0
    assert stages.line("looking for where something is missing") == "2:55  looking for where something is missing"
    now[0] = 180.0
    assert stages.line("round 3: score test").endswith("about 2:00 left if it is the last round")
