"""Studies made short: what is kept, and that nobody takes the result for that of the whole study."""

from pathlib import Path

import pytest

from harness.config import load_study
from harness.config.load import QUICK_RUNS
from support.probe_study import STUDY

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture
def whole_and_quick(tmp_path):
    path = tmp_path / "probe.toml"
    path.write_text(STUDY.replace("repeats = 5", "repeats = 20").replace("samples = 4", "samples = 16"))
    return load_study(path), load_study(path, quick=True)


def test_name_and_title_say_that_it_is_short(whole_and_quick):
    whole, quick = whole_and_quick
    assert quick.name == "probe-quick"
    assert quick.hash != whole.hash
    assert quick.title == "Does the runner keep its promises? (quick look: 1 of 2 drives, few runs)"
    assert quick.path == whole.path


def test_levels_and_estimators_stay_and_drives_and_runs_are_few(whole_and_quick):
    whole, quick = whole_and_quick
    assert quick.estimators == whole.estimators
    assert [d.band_labels for d in quick.designs] == [d.band_labels for d in whole.designs]
    assert [(d.base_samples, d.repeats) for d in quick.designs] == [(1, QUICK_RUNS), (QUICK_RUNS, 1)]
    assert [d.name for d in quick.drives] == ["weave"]  # the one that is drawn over time
    assert [h.name for h in quick.history] == [h.name for h in whole.history]


def test_its_text_states_the_same_study(whole_and_quick, tmp_path):
    quick = whole_and_quick[1]
    again = tmp_path / "again.toml"
    again.write_text(quick.text)
    assert load_study(again).hash == quick.hash


def test_a_recording_is_found_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "drives").mkdir()
    (tmp_path / "drives" / "lap.csv").write_text("time,steering_wheel_angle,speed\n0,0,10\n1,0,10\n")
    drive = '[[drive]]\nname = "lap"\nkind = "from_file"\nfile = "lap.csv"\n'
    (tmp_path / "drives" / "laps.toml").write_text(drive)
    head = STUDY.split("[[drive]]")[0].replace("seed = 0", 'seed = 0\ndrives = "laps"', 1)
    (tmp_path / "probe.toml").write_text(head + '[[design]]\nname = "once"\n')
    monkeypatch.chdir(tmp_path)
    quick = load_study("probe.toml", quick=True)
    assert quick.drives[0].options["file"] == str(tmp_path / "drives" / "lap.csv")


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda p: p.stem)
def test_every_study_can_be_looked_at(path):
    assert load_study(path, quick=True).name == f"{path.stem}-quick"


def test_a_study_elsewhere_takes_drives_of_the_package(load):
    study = load(("seed = 0", 'seed = 0\ndrives = "robustness"'))
    assert {"two-ramps", "sine"} <= {d.name for d in study.drives}
