"""What a command does with what it raises: one message, a file with the traceback, and no raw warning."""

from __future__ import annotations

import errno
import importlib
import logging
import os
import shlex
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.__main__ import main as command_line
from harness.cli import guard, main, options
from harness.cli.guard import GLYPHS, NUMBERS
from harness.common.errors import ModelError, UserError, WorkError
from support import synthetic
from support.plugins import forget, project


def raising(error):
    def run():
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (UserError("a.toml: mend it"), 2, "error: a.toml: mend it\n"),
        (ModelError("no tyre"), 2, "error: no tyre\n"),
        (WorkError("every worker is lost"), 1, "failed: every worker is lost\n"),
        (MemoryError(), 1, "failed: the memory does not suffice; give less at once, or fewer --jobs\n"),
        (OSError(errno.ENOSPC, "No space left on device", "scores"), 1, "failed: scores: No space left on device\n"),
        (OSError(errno.EFBIG, "File too large", "scores"), 1, "failed: scores: File too large\n"),
        (RuntimeError("Symlink loop from '/a/b.csv'"), 2, "error: '/a/b.csv' is a link that leads back to itself\n"),
        (
            KeyboardInterrupt(),
            130,
            "interrupted: a study, a trace or a plan goes on from what is finished, other commands begin again\n",
        ),
    ],
)
def test_what_is_no_fault_leaves_no_file(tmp_path, capsys, error, status, said):
    assert guard.guarded(raising(error), tmp_path) == status
    assert capsys.readouterr() == ("", said)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="a working directory cannot be removed")
def test_a_working_directory_that_is_gone_is_said(tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert guard.guarded(os.getcwd) == 2
    assert "working directory is gone" in capsys.readouterr().err


def test_a_library_that_cannot_be_imported_is_no_fault_of_ours(tmp_path, monkeypatch, capsys):
    (tmp_path / "threaded").mkdir()
    (tmp_path / "threaded" / "__init__.py").write_text("import os\nint(os.environ['THREADS_OF_MINE'])\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("THREADS_OF_MINE", "many")
    out = tmp_path / "out"
    assert guard.guarded(lambda: importlib.import_module("threaded"), out) == 1
    assert capsys.readouterr().err.startswith("failed: threaded cannot be imported: ValueError: invalid literal")
    assert not out.exists()


@pytest.mark.parametrize(
    "error", [KeyError("x"), ZeroDivisionError("division by zero"), RecursionError(), OSError(errno.ENOENT, "No", "f")]
)
def test_a_fault_leaves_its_traceback_beside_the_output(tmp_path, capsys, error):
    out = tmp_path / "out"
    assert guard.guarded(raising(error), out) == 70
    said = capsys.readouterr().err
    (file,) = out.iterdir()
    assert said.count("\n") == 1
    assert said.startswith(f"fault: {type(error).__name__}: ")
    assert f"please report it; the traceback is in {file}" in said
    text = file.read_text(encoding="utf-8")
    assert text.startswith("harness ")
    assert "command: " in text
    assert "stage: cli" in text
    assert f"{type(error).__name__}" in text.split("Traceback (most recent call last)")[1]


def test_a_file_to_write_gets_its_traceback_beside_it(tmp_path):
    assert guard.guarded(raising(KeyError("x")), tmp_path / "drive.csv") == 70
    assert [p.name.partition("-")[0] for p in tmp_path.iterdir()] == ["crash"]


def test_a_folder_that_cannot_be_written_is_passed_over(tmp_path, monkeypatch, capsys):
    (tmp_path / "taken").write_text("")
    monkeypatch.chdir(tmp_path)
    assert guard.guarded(raising(KeyError("x")), tmp_path / "taken" / "out") == 70
    assert "the traceback is in crash-" in capsys.readouterr().err


def test_the_headline_after_a_run_is_guarded(tmp_path, monkeypatch):
    import harness.study.report as report
    import harness.study.run as stage
    from support.small_study import STUDY

    (tmp_path / "s.toml").write_text(STUDY)
    out = tmp_path / "out"
    written = {"level": synthetic.design(repeats=2)}
    monkeypatch.setattr(stage, "run_study", lambda _, out, *__, **___: synthetic.write(out, written))
    monkeypatch.setattr(report, "answer_in_short", lambda _: {}["headline"])
    done = CliRunner().invoke(main.app, ["run", str(tmp_path / "s.toml"), "--out", str(out)])
    assert done.exit_code == 70, done.output
    assert "fault: KeyError: 'headline'" in done.stderr
    assert len(list(out.glob("crash-*.txt"))) == 1
    assert "stage: study" in next(out.glob("crash-*.txt")).read_text(encoding="utf-8")


def test_commands_of_modules_are_guarded_alike(tmp_path, capsys):
    @options.answers_errors
    def command(arguments):
        raise KeyError(arguments[0])

    assert command(["file", "--out", str(tmp_path)]) == 70
    assert "fault: KeyError: 'file'" in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 1


def test_code_of_the_users_own_is_named_with_file_and_line(tmp_path, monkeypatch):
    reader = 'SUFFIXES = (".log",)\n\n\ndef read(path):\n    return {}["speed"]\n'
    monkeypatch.chdir(project(tmp_path, {"readers/logger.py": reader, "drive.log": "x"}))
    try:
        done = CliRunner().invoke(main.app, ["check", "drive.log", "--out", "out"])
    finally:
        forget()
    assert done.exit_code == 2, done.output
    assert (
        f"error: your own code, {tmp_path}/readers/logger.py line 5, raised KeyError: 'speed'; the traceback is in out"
        in (done.stderr)
    )
    assert "report it" not in done.stderr


def test_warnings_of_the_users_own_code_are_said(tmp_path, monkeypatch):
    reader = (
        "import warnings\n"
        + '\nSUFFIXES = (".log",)\n\n\ndef read(path):\n    warnings.warn("mind the gap")\n    return []\n'
    )
    monkeypatch.chdir(project(tmp_path, {"readers/logger.py": reader, "drive.log": "x"}))
    try:
        done = CliRunner().invoke(main.app, ["check", "drive.log", "--out", "out"])
    finally:
        forget()
    assert done.stderr == (
        "error: drive.log: holds no numeric column\n"
        f"note: your own code, {tmp_path}/readers/logger.py line 7, warns: mind the gap\n"
    )


def test_warnings_are_said_in_words_once_each(capsys):
    def run():
        for _ in range(3):
            np.log(np.zeros(2))
            np.float64(1e300) * np.float64(1e300)
        warnings.warn("Glyph 128 () missing from font(s) DejaVu Sans.", stacklevel=1)
        warnings.warn("old", DeprecationWarning, stacklevel=1)
        warnings.warn("old", FutureWarning, stacklevel=1)
        logging.getLogger("some.library").warning("block 3\nis odd")

    assert guard.guarded(run) == 0
    assert capsys.readouterr().err == f"note: {NUMBERS}\nnote: {GLYPHS}\nnote: a library says: block 3 is odd\n"


def test_nothing_raw_comes_from_a_command_of_its_own_process(tmp_path):
    code = (
        "import sys, warnings; sys.argv = ['harness', 'list', 'tyres']\n"
        "import harness.cli.listing as listing\n"
        "listing.show = lambda *_: warnings.warn('divide by zero encountered', RuntimeWarning)\n"
        "from harness.cli.main import main\nmain()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"note: {NUMBERS}\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
@pytest.mark.parametrize(
    ("words", "output", "status", "said"),
    [
        ("--help", ">/dev/full", 1, "failed: No space left on device\n"),
        ("--version", ">/dev/full", 1, "failed: No space left on device\n"),
        ("list tyres", ">/dev/full", 1, "failed: No space left on device\n"),
        ("list tyres", ">&-", 0, ""),
        ("list nothing", "2>&-", 2, ""),
        ("list tyres", ">&- 2>&-", 0, ""),
    ],
)
def test_an_output_that_takes_nothing_is_no_traceback(tmp_path, words, output, status, said):
    line = f"{shlex.quote(sys.executable)} -m harness {words} {output}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (status, said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="Python resolves such links without an error")
def test_a_link_to_itself_as_a_recording_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").symlink_to("a.csv")
    words = "estimate -m car --parameters govindarajan_2018 -d a.csv -e ekf -o there"
    done = CliRunner().invoke(main.app, words.split())
    assert done.exit_code == 2
    assert "a.csv' is a link that leads back to itself" in done.stderr


@pytest.fixture
def in_the_foreground():
    """Take Ctrl-C as a command on a terminal does; what a script starts in the background is told to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("in_the_foreground")
def test_an_interrupt_that_a_library_answers_with_an_error_of_its_own_is_an_interrupt(tmp_path, capsys):
    """pydantic raises a SchemaError where Ctrl-C comes while it builds a model."""

    def run():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("cannot build the model") from None

    assert guard.guarded(run, tmp_path) == 130
    assert capsys.readouterr().err.startswith("interrupted: ")
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("in_the_foreground")
def test_an_interrupt_that_the_interpreter_drops_comes_once_more(tmp_path, capsys):
    """Python prints what is raised in a finaliser, and goes on."""

    class Last:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    begun = []

    def run():
        last = Last()
        del last
        for _ in range(200):
            time.sleep(0.05)
        begun.append("what comes after")

    assert guard.guarded(run, tmp_path) == 130
    assert capsys.readouterr().err.startswith("interrupted: ")
    assert begun == []


@pytest.mark.skipif(sys.platform == "win32", reason="no signal ends a process there")
@pytest.mark.usefixtures("in_the_foreground")
def test_an_interrupt_after_the_end_of_a_command_is_no_traceback():
    at_exit = "import atexit, os, signal, sys; atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))"
    code = f"{at_exit}; sys.argv = ['harness', '--version']; from harness.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == -signal.SIGINT  # of which a shell makes 130
    assert done.stdout.startswith("harness ")
    assert done.stderr == ""


@pytest.mark.usefixtures("in_the_foreground")
def test_an_interrupt_while_the_command_line_is_imported_is_no_traceback(monkeypatch):
    monkeypatch.setitem(sys.modules, "harness.cli.main", None)
    with pytest.raises(ModuleNotFoundError):
        command_line()

    class Interrupted(dict):
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "harness.cli.main", Interrupted())
    with pytest.raises(SystemExit) as ended:
        command_line()
    assert ended.value.code == 130
