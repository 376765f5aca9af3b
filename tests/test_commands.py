"""Every command that README and docs show is read as written, up to where its work begins; what is short is done.

``make notebooks`` runs what takes longer from beginning to end (tests/package/test_documented.py).
"""

import os
import re
import shlex
import shutil
import subprocess

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from support.documented import PAGES, ROOT, Part, parts, write_recordings

WORK = (
    "harness.study.run.run_study", "harness.study.cluster.connected", "harness.realtime.measure.contestants",
    "reproductions.campaign.report.write_campaign", "harness.api.results.open_results", "harness.study.report.analyse",
    "harness.study.tune.tune", "harness.study.worst_case.tune_for_worst_case", "harness.remedy.run.try_remedies",
    "harness.experiment.run.design_drives",
    "harness.remedy.monitor.run.count_monitor",
    "harness.identification.fit_recordings.Innovations", "harness.diagnosis.run.run_trace",
    "harness.diagnosis.measured_study.trace_study", "harness.simulation.simulate.simulate_drive",
    "harness.cli.observability_report.report", "harness.recorded.run.RecordedModel", "harness.view.pages.pages",
)  # fmt: skip
"""Where the work of commands begins."""

NO_MAKE = shutil.which("make") is None


class Reached(Exception):
    """The work would begin."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    write_recordings(folder)
    return folder


@pytest.fixture
def reader(recordings, tmp_path, monkeypatch):
    """Work as a reader in a checkout of their own, with recordings and results; the work of commands does not begin."""

    def stop(*_, **__):
        raise Reached

    for place in WORK:
        monkeypatch.setattr(place, stop)
    shutil.copytree(recordings, tmp_path / "work")
    shutil.copytree(ROOT / "studies", tmp_path / "work" / "studies")
    (tmp_path / "work" / "results" / "mass").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "work"


def begun(command: str) -> None:
    """Run a command of the harness up to where its work begins."""
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code == 0 or isinstance(done.exception, Reached) or "Reached" in done.output, (
        f"{command}\n{done.output}\n{done.exception!r}"
    )


def read(part: Part) -> None:
    """Read a command as written."""
    word = part.text.split()[0]
    if word == "cd":
        os.chdir(shlex.split(part.text)[1])
    elif word == "make" and not NO_MAKE:
        command = ["make", "-n", "-C", str(ROOT), *shlex.split(part.text)[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    elif word == "harness":
        begun(f"{part.text} {part.more}")
    else:
        assert word in ("make", "export"), f"{part.text}: no test runs it; say by a comment above it why it is shown"


@pytest.mark.parametrize("page", [p for p in PAGES if any(part.kind == "sh" for part in parts(p))])
def test_every_command_of_a_page_is_one(page, reader):
    if page == "docs/identification/em.md":
        shutil.copy(reader / "reference.csv", reader / "A.csv")  # the page is about a car
    for part in parts(page):
        if part.kind == "file":
            path = reader / part.name
            path = path if os.getcwd() == str(reader) else type(path)(part.name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(part.text, encoding="utf-8")
        elif part.kind == "sh" and part.how != "shown":
            read(part)


def spans():
    """Return what the prose of the pages calls in passing, where nothing is left open."""
    texts = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
    found = {(s, page) for page, text in texts.items() for s in re.findall(r"`(harness list(?: [a-z_0-9]+)*)`", text)}
    return sorted(dict(sorted(found)).items())


@pytest.mark.parametrize(("command", "page"), spans(), ids=lambda v: v.replace(" ", "-"))
def test_what_the_prose_lists_is_there(command, page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    begun(command)


def test_a_comment_that_fits_no_command_or_gives_no_reason_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr("support.documented.ROOT", tmp_path)
    for comment in ("harness rum: begun; long", "harness run: begun", "harness run: quickly; long"):
        (tmp_path / "page.md").write_text(f"<!-- commands\n{comment}\n-->\n```sh\nharness run mass\n```\n")
        with pytest.raises(AssertionError, match="page"):
            parts("page.md")
    (tmp_path / "page.md").write_text("```sh\nharness run mass \\\n  --quik  # so\n```\n")
    (part,) = parts("page.md")
    assert part.text == "harness run mass --quik"
    with pytest.raises(AssertionError, match="--quik"):
        begun(part.text)
