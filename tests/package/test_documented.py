"""What README and docs show is run from the first command of a page to the last, as its reader would.

What takes long says so in a comment above it (support/documented.py); tests/test_commands.py reads it all the same.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest

from bench import gallery
from support.documented import PAGES, ROOT, parts, write_recordings

pytestmark = pytest.mark.notebooks

ELSEWHERE = {gallery.PAGE}
"""Pages whose commands ``make docs`` runs, for their pictures."""

WRITTEN = re.compile(r"[\w./-]+\.\w{2,7}")
"""A line that names a file: commands print what they wrote."""

CELLS = {"docs/api.md": "tests/api", "docs/studies.md": "tests/config", "docs/plugins.md": "tests/study"}
"""Pages whose Python is run by other tests."""


def runs(page):
    """Return the parts of a page that are run here."""
    kinds = {"sh", "file"} | (set() if page in CELLS else {"python"})
    found = [p for p in parts(page) if p.kind in kinds and p.how not in ("begun", "shown")]
    return [p for p in found if p.kind != "sh" or re.match("harness |cd ", p.text)]


RUN = {
    page: found
    for page, found in ((page, runs(page)) for page in PAGES if page not in ELSEWHERE)
    if any(p.kind != "file" for p in found)
}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    write_recordings(folder)
    return folder


@pytest.mark.parametrize("page", RUN)
def test_a_page_does_what_it_shows(page, recordings, tmp_path):
    folder = tmp_path / "work"
    shutil.copytree(recordings, folder)
    shutil.copytree(ROOT / "studies", folder / "studies")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    cells = ""
    for part in RUN[page]:
        if part.kind == "file":
            (folder / part.name).parent.mkdir(parents=True, exist_ok=True)
            (folder / part.name).write_text(part.text, encoding="utf-8")
            continue
        if part.kind == "sh" and part.text.startswith("cd "):
            folder = folder / shlex.split(part.text)[1]
            continue
        cells += part.text if part.kind == "python" else ""
        words = ["-c", cells] if part.kind == "python" else ["-m", *shlex.split(f"{part.text} {part.more}")]
        done = subprocess.run(
            [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{part.text}\n{done.stdout}{done.stderr}"
        written = [folder / line for line in done.stdout.splitlines() if WRITTEN.fullmatch(line)]
        assert [str(path) for path in written if not path.stat().st_size] == [], part.text
        assert written or done.stdout.strip() or part.kind == "python", f"{part.text}: says nothing and writes nothing"
