"""The short form of ``make fuzz``, and that its watch sees what it is there for."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.fuzz import watch as watching
from bench.fuzz.mutate import TEXTS
from bench.fuzz.watch import Watch
from harness.common.errors import UserError
from harness.reporting.document import Heading, Listing, Prose, Report, Sheet, plain, render
from support.report_parts import Page

ROOT = Path(__file__).parents[2]


def test_hundreds_of_broken_files_are_read_or_refused_in_words(tmp_path):
    path = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    done = subprocess.run(
        [sys.executable, "-m", "bench.fuzz", "--inputs", "600", "--seed", "20230109", "--out", tmp_path / "fuzz"],
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    said = done.stdout.splitlines()[-1]
    inputs, read, refused = (int(said.split(word)[0].split()[-1]) for word in (" inputs", " read", " refused"))
    assert inputs >= 600
    assert read + refused == inputs
    assert min(read, refused) > 50


def _raise(error):
    raise error


def _wait(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


@pytest.mark.parametrize(
    ("read", "found"),
    [
        (lambda _: None, ""),
        (lambda _: _raise(UserError("a.csv: is empty")), ""),
        (lambda _: _raise(UserError(" ")), "an error without words"),
        (lambda _: _raise(KeyError("x")), "KeyError"),
        (lambda _: _raise(MemoryError()), "MemoryError"),
        (lambda _: _wait(5.0), "hangs"),
        (lambda folder: (folder.parent / "aside.txt").write_text(""), "writes"),
        (lambda folder: (folder / "inside.txt").write_text(""), ""),
        (lambda _: pickle.loads(pickle.dumps(UserError)), "pickle.find_class"),
        (lambda _: os.system("true"), "os.system"),
    ],
)
def test_the_watch_sees_what_it_is_there_for(tmp_path, monkeypatch, read, found):
    monkeypatch.setattr(watching, "SECONDS", 0.2)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    folder = tmp_path / "fuzz"
    folder.mkdir()
    watch = Watch(folder)
    watch.judge("kind", lambda: read(folder), b"input")
    assert bool(watch.findings) == bool(found)
    if found:
        assert found in next(iter(watch.findings.values()))
        assert (folder / "finding-001.input").read_bytes() == b"input"


def test_names_are_escaped_in_html_and_typst():
    """Whatever a study calls its things, it is text in the report: no element, no formula, no code."""
    blocks = [Heading("all"), *(Prose(plain(text)) for text in TEXTS)]
    blocks += [Sheet(list(TEXTS[:3]), [list(TEXTS[k : k + 3]) for k in range(0, len(TEXTS) - 3, 3)], TEXTS[40])]
    blocks += [Listing("\n".join(TEXTS))]
    html, pdf = render(Report('<script>alert(1)</script> #read("/etc/passwd")', blocks))
    page = html.decode("utf-8")
    assert page.lower().count("<script") == 1  # the page's own, which its policy names by its digest
    assert "alert(1)" not in page[page.index("<script>") :]
    assert page.count("&lt;script") >= 5  # title, paragraph, table, listing
    assert Page(page).text.count("<script>alert(1)</script>") >= 5
    assert Page(page).text.count('#read("/etc/passwd")') >= 5
    assert "root:" not in page
    assert pdf.startswith(b"%PDF")
