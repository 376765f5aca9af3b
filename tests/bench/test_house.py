"""Counts of the structure, on a package of known counts."""

import pytest

from bench.house import counts

ONE = '''"""The first module.

It is short.
"""

import os
from lab import (
    two,
)


class Point:
    """A point."""


def _area(a, b):
    # the area
    return a * b


def area(self, a, b, *c):
    found = _area(a, b)
    return found, os, two
'''
TWO = "class Point: ...\n\n\ndef f(a, b, c, d, e, f, g, h, i, j, *, k):\n" + "    a += 1\n" * 70


@pytest.fixture
def tree(tmp_path):
    for name, text in {"__init__": "", "one": ONE, "two": TWO}.items():
        (tmp_path / "lab" / f"{name}.py").parent.mkdir(exist_ok=True)
        (tmp_path / "lab" / f"{name}.py").write_text(text, encoding="utf-8")
    (tmp_path / "lab" / "models").symlink_to(tmp_path / "lab", target_is_directory=True)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text("# Page\n\n| a | b |\n|---|---|\n", encoding="utf-8")
    return tmp_path


def test_counts(tree):
    assert counts(tree, ["lab"]) == {
        "files": 3,
        "lines": 23 + 74,
        "code lines": 10 + 72,
        "lines of import headers": 4,
        "private functions called once": 1,
        "modules imported by one module only": 1,
        "class names with several meanings": 1,
        "files below 100 lines": 3,
        "modules above 450 lines": 0,
        "functions above 70 lines": 1,
        "functions with more than 10 parameters": 1,
        "files with a variable found, known, left, told": 1,
        "lines of docs, tables apart": 2,
    }
