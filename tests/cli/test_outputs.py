"""What the command line refuses before anything is computed: empty words, options given twice, other results."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.cli.outputs import RESULTS
from harness.common.files import BUNDLED_STUDIES
from reproductions import identify_measured

ROOT = Path(__file__).parents[2]


def harness(*arguments):
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, " ".join(done.output.replace("│", " ").split())


@pytest.mark.parametrize(
    "line",
    [
        ("view", ""),
        ("check", "a.csv", "--out", " "),
        ("estimate", "-m", "car", "-d", "a.csv", "-e", "ekf", "-o", ""),
        ("identify", "-m", "car", "-d", "a.csv", "-f", "mass", "--out="),
        ("observability", "car", "-o", ""),
    ],
)
def test_an_empty_word_is_not_the_working_directory(tmp_path, monkeypatch, line):
    monkeypatch.chdir(tmp_path)
    status, said = harness(*line)
    assert status == 2
    assert "of the command is empty, as of a variable that is not set" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["-e", "--estimator"])
def test_no_estimator_at_all_is_an_empty_word(tmp_path, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    drives = "--train", "a.csv", "--test", "b.csv"
    status, said = harness("trace", "-m", "car", *drives, "--out", "t", option, "")
    assert (status, "a.csv: the recording does not exist" in said) == (2, True)


@pytest.mark.parametrize(
    ("line", "option"),
    [
        (("run", "mass", "--jobs", "1", "-j", "2"), "--jobs"),
        (("view", "results", "--browser", "--no-browser"), "--browser"),
        (("new", "parameters", "x", "--model", "car", "-m", "car"), "--model"),
        (("estimate", "-m", "car", "-d", "a.csv", "--data", "a.csv", "-e", "ekf", "-o", "there"), "--data"),
        (("trace", "-m", "car", "--train", "a.csv", "--train=a.csv", "-t", "b.csv", "-o", "there"), "--train"),
        (("trace", "-m", "car", "--train", "a.csv", "--train", "./a.csv", "-t", "b.csv", "-o", "there"), "--train"),
        (("estimate", "-m", "car", "-d", "x/../a.csv", "-d", "a.csv", "-e", "ekf", "-o", "there"), "--data"),
        (("simulate", "car", "--drive", "sine", "-o", "a.csv", "--set", "mass=2t", "--set", "mass = 3t"), "--set mass"),
        (("simulate", "car", "--drive", "sine", "-o", "a.csv", "--option", "speed=1", "--option", "speed=2"), "speed="),
        (("estimate", "-m", "car", "-d", "a.csv", "-e", "ukf,alpha=1,alpha=2", "-o", "there"), "ukf, alpha="),
    ],
)
def test_an_option_is_given_once(tmp_path, monkeypatch, line, option):
    monkeypatch.chdir(tmp_path)
    status, said = harness(*line)
    assert status == 2
    assert option in said
    assert "is given twice" in said
    assert list(tmp_path.iterdir()) == []


def test_a_link_to_a_recording_is_that_recording(tmp_path):
    (tmp_path / "link.csv").symlink_to(tmp_path / "a.csv")
    data = [word for name in ("a.csv", "link.csv") for word in ("--data", tmp_path / name)]
    status, said = harness("estimate", "-m", "car", *data, "-e", "ekf", "-o", tmp_path / "there")
    assert status == 2
    assert "is given twice" in said


def test_a_module_takes_an_option_once(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        identify_measured.main(["a.toml", "--out", str(tmp_path / "a"), "--out", str(tmp_path / "b")])
    assert ended.value.code == 2
    assert "argument --out: is given twice; give it once" in capsys.readouterr().err
    files = [path for top in ("harness", "reproductions", "bench") for path in (ROOT / top).rglob("*.py")]
    files.remove(ROOT / "bench/real/plant.py")  # a plant that shares nothing with the program
    own = [path.name for path in files if "= argparse.ArgumentParser(" in path.read_text(encoding="utf-8")]
    assert own == []  # harness.common.arguments.Parser it is


@pytest.mark.parametrize(
    "line",
    [
        ("tune", "mass", "--drive", "robustness", "-o", "there", "--budget"),
        ("tune", "mass", "--drive", "robustness", "-o", "there", "--points"),
        ("trace", "-m", "car", "--train", "a.csv", "-t", "b.csv", "-o", "there", "--study", "mass", "--repeats"),
        ("remedy", "there", "--jobs"),
    ],
)
def test_a_count_that_nothing_would_end_with_is_refused_at_once(line):
    status, said = harness(*line, 10**12)
    assert status == 2
    assert "100000" in said
    assert "there" not in said


def test_options_that_say_the_same_twice_without_a_value_are_taken():
    assert harness("cache", "--clear", "--clear", "--help")[0] == 0


@pytest.mark.parametrize("none", [("--estimator", ""), ("--estimator=",), ("--estimators", "")])
def test_no_estimators_are_an_empty_list(none):
    status, said = harness("trace", "-m", "car", "--train", "a.csv", "--test", "b.csv", "--out", "there", *none)
    assert status == 2
    assert "empty" not in said
    assert "a.csv" in said


@pytest.mark.parametrize("mark", ["zarr.json", ".zgroup"])
@pytest.mark.parametrize("command", ["run", "campaign"])
def test_a_store_is_no_result_folder(tmp_path, command, mark):
    (tmp_path / mark).write_text("{}")
    status, said = harness(command, *([] if command == "campaign" else ["kalman-lecture"]), "--out", tmp_path)
    assert status == 2
    assert "is a store of Zarr" in said
    assert [path.name for path in tmp_path.iterdir()] == [mark]


@pytest.mark.parametrize(("command", "other"), [("remedy", "run"), ("run", "trace"), ("campaign", "estimate")])
def test_a_folder_with_the_result_of_another_command_is_left_alone(tmp_path, command, other):
    (tmp_path / RESULTS[other]).mkdir()
    (tmp_path / "report.html").write_text("theirs")
    status, said = harness(command, *([] if command == "campaign" else ["kalman-lecture"]), "--out", tmp_path)
    assert status == 2
    assert f"holds a result of 'harness {other}'" in said
    assert (tmp_path / "report.html").read_text() == "theirs"


@pytest.mark.parametrize("command", ["estimate", "check"])
def test_a_file_in_place_of_a_folder_is_refused_before_anything_is_computed(tmp_path, command):
    (tmp_path / "a.csv").write_text("kept")
    words = {"estimate": ["-m", "car", "-e", "ekf", "-d", "none.csv"], "check": ["none.csv"]}[command]
    status, said = harness(command, *words, "--out", tmp_path / "a.csv" / "deeper")
    assert status == 2
    assert "a.csv is a file, where --out names a folder" in said
    assert (tmp_path / "a.csv").read_text() == "kept"


LONG = {  # commands that write a folder or file at the end of long work
    "run": ["kalman-lecture"],
    "estimate": ["-m", "car", "-e", "ekf", "-d", "none.csv"],
    "identify": ["-m", "car", "--train", "none.csv", "-f", "mass"],
    "trace": ["-m", "car", "--train", "none.csv", "--test", "nor-this.csv"],
    "tune": ["-m", "car", "--data", "none.csv"],
    "simulate": ["car", "--drive", "none"],
    "check": ["none.csv"],
    "remedy": ["none"],
    "realtime": ["kalman-lecture"],
    "observability": ["car"],
    "campaign": [],
}


@pytest.mark.parametrize("command", LONG)
@pytest.mark.parametrize("within", ["", "deeper"])
def test_a_link_that_leads_nowhere_is_refused_before_anything_is_computed(tmp_path, command, within):
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    out = tmp_path / "link" / within / {"tune": "tuned.toml", "simulate": "drive.csv"}.get(command, "")
    status, said = harness(command, *LONG[command], "--out", out)
    assert status == 2
    assert f"{tmp_path / 'link'} is a link that leads nowhere" in said
    assert [path.name for path in tmp_path.iterdir()] == ["link"]


def test_a_folder_that_may_not_be_written_to_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.cli.outputs.os.access", lambda *_: False)
    status, said = harness("check", "none.csv", "--out", tmp_path / "new" / "deeper")
    assert status == 2
    assert f"nothing may be written to {tmp_path}" in said


@pytest.mark.parametrize("command", ["run", "identify", "trace", "check", "remedy", "realtime", "campaign"])
@pytest.mark.parametrize("place", ["link", "file"])
def test_results_that_cannot_be_a_folder_are_refused_before_anything_is_computed(tmp_path, monkeypatch, command, place):
    monkeypatch.chdir(tmp_path)
    Path("results").touch() if place == "file" else Path("results").symlink_to("nowhere")
    status, said = harness(command, *LONG[command])
    assert status == 2
    assert ("results is a file" if place == "file" else "results is a link that leads nowhere") in said
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


@pytest.mark.parametrize("objective", ["likelihood", "worst-case"])
@pytest.mark.parametrize("over", ["mine.toml", "drives.toml"])
def test_a_study_or_its_drives_are_not_written_over_by_what_is_tuned(tmp_path, objective, over):
    study = (BUNDLED_STUDIES / "kalman-heading.toml").read_text(encoding="utf-8")
    files = {"mine.toml": study, "drives.toml": '[[drive]]\nname = "one"\nkind = "sine"\nduration = "2 s"\n'}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    words = ["--drive", tmp_path / "drives.toml", "--objective", objective, "--out", tmp_path / "." / over]
    status, said = harness("tune", tmp_path / "mine.toml", *words)
    assert status == 2
    assert "this is a file that the command reads" in said
    assert {name: (tmp_path / name).read_text() for name in files} == files


def test_a_url_that_is_viewed_is_named_as_it_was_given():
    status, said = harness("view", "s3://bucket/results", "--no-browser")
    assert status == 2
    assert "s3://...: of the commands only run, report, status and verify take a URL" in said
