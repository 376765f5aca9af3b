"""The notebooks of the tutorial run from the first cell to the last; ``make docs`` shows what they printed and drew."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))

pytestmark = pytest.mark.notebooks


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_it_runs(path):
    from bench.notebooks import run  # needs the extra docs, which other tests do without

    run(path, ROOT / "build" / "notebooks" / path.name)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_it_is_stored_without_outputs(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells), "make docs makes them"


def test_there_are_five():
    assert len(NOTEBOOKS) == 5
