"""What cannot be made costs a sentence, a warning and a traceback in a file, and never the rest of a result."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.failures import FILE, RAISED, Failures
from harness.reporting import style
from harness.reporting.document import (
    Bullets,
    Drawing,
    Heading,
    Picture,
    Prose,
    Report,
    Section,
    plain,
    source,
)
from harness.study.report import analyse, write_report
from support.report_parts import Page

PLAIN = b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>'


def broken(*_, **__):
    raise ZeroDivisionError("no effect is left")


def text_of(path):
    return Page(path.read_text(encoding="utf-8")).text


@pytest.mark.fails_in_part
def test_a_section_and_a_figure_that_fail_leave_their_sentences(tmp_path, capsys):
    sections = [
        Section(lambda: [Prose(plain("It stands."))], "First"),
        Section(broken, "How large is it?"),
        Section(lambda: [Drawing(broken, "caption", "Gain over time."), Prose(plain("End."))], "Figures"),
        Drawing(lambda: PLAIN, "caption", "Another one."),
    ]
    files = Report("What?", sections).write(tmp_path)
    assert [f.name for f in files] == ["report.html", "report.pdf"]
    shown, kept = text_of(files[0]), (tmp_path / FILE).read_text()
    why = f"ZeroDivisionError: no effect is left; the traceback is in {tmp_path / FILE}."
    assert f"This section could not be made: {why}" in shown
    assert "How large is it?" in shown
    assert f"The figure “Gain over time” could not be made: {why}" in shown
    assert all(stands in shown for stands in ("It stands.", "Figures", "End."))
    assert kept.count("Traceback (most recent call last)") == 2
    assert "in broken" in kept
    warned = capsys.readouterr().err
    assert f"warning: the section “How large is it?” could not be made: {why}" in warned
    assert "warning: the figure “Gain over time”" in warned


@pytest.mark.fails_in_part
def test_what_cannot_be_laid_out_leaves_a_sentence(tmp_path):
    blocks = [Prose(plain("Before.")), Picture(b"<svg", "caption", "alt"), Prose("#nothing()"), Prose(plain("After."))]
    shown = text_of(Report("What?", blocks).write(tmp_path)[0])
    assert shown.count("This part of the report could not be laid out: TypstError") == 2
    assert "Before." in shown
    assert "After." in shown


def test_without_a_folder_what_fails_is_raised():
    with pytest.raises(ZeroDivisionError):
        RAISED.attempt("a part", broken, lambda why: None)
    with pytest.raises(ZeroDivisionError):
        source(Report("What?", [Section(broken, "Section")]))


@pytest.mark.parametrize("error", [MemoryError, KeyboardInterrupt])
def test_what_ends_all_work_is_no_failure_of_a_part(tmp_path, error):
    def make():
        raise error

    with pytest.raises(error):
        Failures(tmp_path).attempt("a part", make, lambda why: None)


@pytest.mark.fails_in_part
def test_tracebacks_of_an_earlier_result_are_removed_and_reasons_meant_for_users_have_no_type(tmp_path):
    (tmp_path / FILE).write_text("old")
    failures = Failures(tmp_path)
    assert not (tmp_path / FILE).exists()

    def refuse():
        raise UserError("drive.csv: lasts 3 s.\n  record 20 s")

    why = failures.attempt("the check", refuse, lambda why: why)
    assert why == f"drive.csv: lasts 3 s. record 20 s; the traceback is in {tmp_path / FILE}"
    failures.attempt("the check", refuse, lambda why: why)
    assert failures.sentences == [f"the check could not be made: {why}."]  # once


def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot be written"):
        Failures(tmp_path / "file" / "folder")


@pytest.mark.fails_in_part
def test_a_study_keeps_its_report_when_a_section_fails(small, monkeypatch, capsys):
    monkeypatch.setattr("harness.study.report.sections.boxes.pictures", broken)
    files = write_report(analyse(small))
    shown = text_of(files[0])
    assert "This section could not be made: ZeroDivisionError" in shown
    assert "How was this made?" in shown
    assert (small / FILE).exists()
    assert "warning: " in capsys.readouterr().err
    monkeypatch.undo()
    assert "could not be made" not in text_of(write_report(analyse(small))[0])
    assert not (small / FILE).exists()


def test_names_with_odd_characters_are_drawn_and_set_as_they_are(tmp_path):
    name = "drive_$x_{$\x00\x1b<&>#“\udcff"
    with style.drawing():
        fig = style.figure(2.0)
        axes = fig.subplots()
        axes.plot([0.0, 1.0], [0.0, np.nan], label="run_$x_{$")
        axes.set_title("run_$x_{$<&>", loc="left")
        picture = style.svg(fig)
    assert picture.startswith(b"<?xml")
    blocks = [Heading(name), Bullets([plain(name)]), Picture(picture, name, name)]
    assert text_of(Report(name, blocks).write(tmp_path)[0]).count("drive_$x_{$\ufffd\ufffd<&>#“\ufffd") >= 4
