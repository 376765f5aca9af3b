"""The mutation run: what it changes is there, changes, and has tests that concern it."""

import ast

import pytest

from bench import mutation
from harness.common.errors import UserError


def test_mutants_are_drawn_of_files_that_are_there(monkeypatch):
    drawn = mutation.mutants(0, 20)
    assert len(drawn) == 20
    assert drawn == mutation.mutants(0, 20)
    for mutant in drawn:
        before = (mutation.ROOT / mutant["file"]).read_bytes()
        assert ast.dump(ast.parse(mutant["text"])) != ast.dump(ast.parse(before)), mutant["file"]
        assert mutation.concerned(mutant["file"]), mutant["file"]
    assert "tests/study/test_input_noise.py" in mutation.concerned("harness/common/statistics.py", "share_of_squares")
    monkeypatch.setattr(mutation, "CODE", (*mutation.CODE, "harness/moved/*.py"))
    with pytest.raises(UserError, match=r"no file is harness/moved/\*\.py"):
        mutation.mutants(0, 20)
