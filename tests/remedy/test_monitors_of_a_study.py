"""Trust monitors that a study asks for: counted after its run, told in its report, and taken by an export."""

import json
import re
import shutil
from pathlib import Path

import pytest

import harness
from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.config import build_study, load_study
from harness.realtime.export import run
from harness.remedy import choices
from harness.remedy.monitor import of_study, sensors
from harness.study import run_file, trust_file
from harness.study.report import report
from harness.study.report.analysis import Analysis
from harness.study.report.sections import trust as section
from harness.study.results import read
from support.observers import CONTENT

ROOT = Path(__file__).parents[2]
PLACE = {"parameter": "cog_to_front_axle", "shift": ["0 %", "40 %"]}
MONITOR = {"limits": {"lateral_velocity": "0.013 m/s"}, "false_alarms": 60, "window": "1 s", "within": "2 s", "runs": 8}
CAR = {
    **CONTENT,
    "name": "watched",
    "targets": ["lateral_velocity"],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
    "drive": [{**CONTENT["drive"][0], "amplitude": "60 deg"}],
    "design": [{"name": "place", "repeats": 2, "factor": [PLACE]}],
    "report": {"monitor": MONITOR},
}


def with_monitor(**changes):
    return {**CAR, "report": {"monitor": {**MONITOR, **changes}}}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("watched")
    (folder / "watched.toml").write_text(toml_text(with_monitor(estimators=["UKF", "EKF"])))
    return folder, harness.read_study(folder / "watched.toml").run(folder / "out", jobs=1)


def test_all_estimators_that_are_named_are_counted(finished):
    folder, _ = finished
    study = load_study(folder / "watched.toml")
    trust = trust_file.read(folder / "out", study.hash)
    assert [each.estimator for each in trust.estimators] == ["UKF", "EKF"]
    for each in trust.estimators:
        (target,) = each.targets
        same, other = target.levels
        assert (same.label, other.label) == ("CoG to front axle 0 %", "CoG to front axle +40 %")
        assert other.wrong > 0.02 > same.wrong
        assert other.said > 0.9
        assert other.area.lower > 0.8
        assert 0.0 <= other.delay < 2.0
        assert target.drawn == (other,)
        assert list(target.false) == sorted(target.false, reverse=True)
        assert len(target.false) == len(other.detected)
        assert 0.0 <= each.alarms.lower <= each.alarms.value <= each.alarms.upper
    assert trust_file.read(folder / "out", "of another") is None


def test_the_report_has_sentences_figure_and_table(finished):
    folder, _ = finished
    analysis = Analysis(read(folder / "out"))
    blocks = section.blocks(analysis)
    kinds = [type(block).__name__ for block in blocks]
    assert kinds == ["Prose", "Heading", "Bullets", "Heading", "Bullets", "Drawing", "Sheet", "Sheet"]
    drawn = blocks[5].draw()
    assert b"CoG to front axle +40 %: area" in drawn
    rows = [row for sheet in blocks[-2:] for row in sheet.rows]
    assert [row[1] for row in rows[:4]] == [
        "as believed, within limits", "as believed", "CoG to front axle 0 %", "CoG to front axle +40 %",
    ]  # fmt: skip
    title = "Does the filter say when it is not to be trusted?"
    assert title in [section.title for section in report(analysis).sections]


def test_each_monitor_is_a_file_that_an_export_prints(finished):
    folder, _ = finished
    study = load_study(folder / "watched.toml")
    for name in ("ekf", "ukf"):
        exported = run.export(study, name.upper(), recorded=(None, 1.0), monitor=folder / f"out/monitor-{name}.toml")
        says = exported.export.monitor.says
        header = " ".join(exported.files[f"watched_{name}.h"].replace("\n *", " ").split())
        assert len(says) > 1
        assert all(" ".join(sentence.split()) in header for sentence in says)


def test_what_is_counted_is_not_counted_again_but_where_another_thing_is_asked(finished, tmp_path, monkeypatch):
    folder, out = finished[0], tmp_path / "out"
    shutil.copytree(folder / "out", out)
    asked = []

    def counted(study, spec, name, jobs, say, computed):
        asked.append((name, spec.within))
        raise UserError("nothing to calibrate on")

    monkeypatch.setattr(of_study, "count_monitor", counted)
    study = load_study(folder / "watched.toml")
    of_study.write(study, out, 1, print)
    assert asked == []
    other = build_study(with_monitor(within="1 s"), folder / "watched.toml")
    assert other.hash == study.hash
    of_study.write(other, out, 1, print)
    assert asked == [("EKF", 1.0)]  # the first where none is named
    trust = trust_file.read(out, study.hash)
    assert trust.estimators[0].says == ("nothing to calibrate on",)
    kinds = [type(block).__name__ for block in section.blocks(Analysis(read(out)))]
    assert kinds == ["Prose", "Heading", "Bullets"]
    assert not list(out.glob("monitor-*.toml"))  # of what was asked for before


def test_estimators_with_the_same_name_in_c_have_a_file_each():
    names = ["EKF, tuned", "EKF (tuned)", "UKF", "ekf tuned"]
    files = ["monitor-ekf_tuned.toml", "monitor-ekf_tuned_2.toml", "monitor-ukf.toml", "monitor-ekf_tuned_3.toml"]
    assert of_study.files_of(names) == files


def test_what_measurements_tell_of_a_parameter_is_computed_once_for_all_estimators(monkeypatch):
    study, asked, shares = load_study(ROOT / "studies" / "mass.toml"), [], {}

    def remaining(changed, drivers):
        asked.append(changed.plant.sensors)
        return [[0.3 if len(asked) == 1 else 0.02]]

    monkeypatch.setattr(sensors, "remaining_shares", remaining)
    first = sensors.parameter_information(study, "UKF", shares)
    computed = len(asked)
    assert first[0].own == 0.3
    assert computed == len(shares) > 1
    assert sensors.parameter_information(study, "EKF, tuned", shares) == first
    assert len(asked) == computed


def test_a_window_longer_than_all_drives_is_refused_before_the_run(tmp_path):
    (tmp_path / "watched.toml").write_text(toml_text(with_monitor(window="1000 s")))
    with pytest.raises(UserError, match="window of 1000 s: no drive of study 'watched' is scored for longer than"):
        harness.read_study(tmp_path / "watched.toml").run(tmp_path / "out", jobs=1)
    assert not (tmp_path / "out").exists()


def test_a_run_says_of_which_estimator_there_is_no_monitor(finished, tmp_path, capsys):
    shutil.copytree(finished[0] / "out", tmp_path / "out")
    (tmp_path / "watched.toml").write_text(toml_text(with_monitor(limits={"lateral_velocity": 1e-9})))
    harness.read_study(tmp_path / "watched.toml").run(tmp_path / "out", jobs=1)
    assert (
        "no monitor of 'EKF': estimator 'EKF' keeps the limits of lateral_velocity in 0 of" in capsys.readouterr().err
    )


@pytest.mark.parametrize("content", ["{", "[]", '{"within": 3}', '{"within": 1, "estimators": [{"estimator": "EKF"}]}'])
def test_a_damaged_file_is_named_with_what_mends_it(content, tmp_path):
    (tmp_path / trust_file.FILE).write_text(content)
    with pytest.raises(UserError, match=re.escape(trust_file.FILE)) as refused:
        trust_file.read(tmp_path, "")
    assert "'harness run' counts again" in str(refused.value)
    assert run_file.faults(tmp_path) == [str(refused.value)]


def test_numbers_that_json_has_no_word_for_come_back(finished, tmp_path):
    folder, _ = finished
    study = load_study(folder / "watched.toml")
    nothing = trust_file.Interval(float("nan"), 0.0, float("inf"))
    level = trust_file.LevelTrust("d", "l", 0.5, float("nan"), 0.25, float("inf"), 1 / 3, nothing, ())
    target = trust_file.TargetTrust("lateral_velocity", 0.013, (), (level,), (1.0, 0.0))
    written = trust_file.EstimatorTrust("EKF", ("Often.",), nothing, (target,))
    trust_file.write(tmp_path, study, trust_file.StudyTrust(2.0, (written,)))
    json.loads((tmp_path / trust_file.FILE).read_text(), parse_constant=pytest.fail)
    (back,) = trust_file.read(tmp_path, study.hash).estimators
    (told,) = back.targets[0].levels
    assert (told.wrong, told.distrusted, told.delay, told.false) == (0.5, 0.25, float("inf"), 0.333333)
    assert told.said != told.said
    assert told.area.value != told.area.value


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"limits": {"lateral_speed": 1.0}}, "report.monitor.limits.lateral_speed: 'lateral_speed' is no target of"),
        ({"limits": {"lateral_velocity": "1 kg"}}, "report.monitor.limits.lateral_velocity"),
        ({"limits": {"lateral_velocity": 0.0}}, "give an error above zero, not 0.0"),
        ({"limits": {}}, "report.monitor.limits: state the error of a target that matters"),
        ({"estimators": ["EFK"]}, "report.monitor.estimators[0]: 'EFK' is no estimator of the study; closest: EKF"),
        ({"window": "-1 s"}, "report.monitor.window: give a time above zero"),
        ({"within": "1 m"}, "report.monitor.within"),
        ({"false_alarms": 0}, "report.monitor.false_alarms"),
        ({"runs": 0}, "report.monitor.runs"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_a_line(changes, said, tmp_path):
    with pytest.raises(UserError) as refused:
        build_study(with_monitor(**changes), tmp_path / "watched.toml")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_limits_are_those_of_the_study_unless_others_are_stated(tmp_path):
    limits = {"lateral_velocity": "0.1 m/s"}
    study = build_study({**with_monitor(limits={}), "limits": limits}, tmp_path / "watched.toml")
    assert study.monitor.limits == {"lateral_velocity": 0.1}
    assert study.monitor.estimators == ("EKF",)


def test_a_quick_look_counts_none(tmp_path):
    (tmp_path / "watched.toml").write_text(toml_text(CAR))
    assert load_study(tmp_path / "watched.toml").monitor is not None
    assert load_study(tmp_path / "watched.toml", quick=True).monitor is None


def test_a_tuning_of_several_estimators_is_kept_for_the_one_that_is_judged():
    study = load_study(ROOT / "studies" / "mass.toml")
    (spec,) = (e for e in study.estimators if e.name == "EKF, tuned")
    (alone,) = choices.applied(study, choices.Remedy(estimated=("trailer_mass",)), "EKF, tuned").estimators
    assert alone.noise == spec.noise != {}
    (bare,) = choices.applied(study, choices.Remedy(estimated=("trailer_mass",)), "EKF").estimators
    assert bare.noise == {}
