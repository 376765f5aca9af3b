"""TOML: what is written is read again, bit by bit, with its comments."""

import tomllib

import pytest

from harness.common.errors import UserError
from harness.common.files import read_toml, renewed, toml_text

CONTENT = {
    "name": 'a "quoted" name, with µ and \\',
    "seed": 0,
    "ratio": 0.1 + 0.2,
    "tiny": 5e-324,
    "whole": 24000.0,
    "flag": True,
    "drives": ["one", "two"],
    "plant": {"vehicle": "car", "values": {"mass": 1e-300, "odd key": 1.0}, "effects": []},
    "design": [{"name": "a", "factor": [{"parameter": "mass", "levels": ["8 t", 9000]}]}, {"name": "b"}],
}


def test_what_is_written_is_read_again():
    again = tomllib.loads(toml_text(CONTENT))
    assert again == CONTENT
    assert isinstance(again["whole"], float)


def test_comments_stand_behind_values_and_heads_and_the_heading_first():
    text = toml_text(
        CONTENT, "by hand", {("plant", "values", "mass"): "kg +- 3", ("plant",): "the truth", ("seed",): "0"}
    )
    lines = text.splitlines()
    assert lines[0] == "# by hand"
    assert {"mass = 1e-300 # kg +- 3", "[plant] # the truth", "seed = 0 # 0"} <= set(lines)
    assert tomllib.loads(text) == CONTENT


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfname = 1\n")
    assert read_toml(tmp_path / "a.toml") == {"name": 1}


def test_what_is_no_toml_is_one_error(tmp_path):
    (tmp_path / "a.toml").write_text("name = \n")
    with pytest.raises(UserError, match=r"a\.toml: not valid TOML: .*line 1"):
        read_toml(tmp_path / "a.toml")


def test_a_page_keeps_what_is_around_the_marks():
    assert renewed("a\n<!-- b -->\nold\n<!-- e -->\nc\n", "new", "<!-- b -->", "<!-- e -->") == (
        "a\n<!-- b -->\n\nnew\n\n<!-- e -->\nc\n"
    )
    for page in ("a\nb\n", "<!-- e -->\n<!-- b -->\n"):
        with pytest.raises(UserError, match="lines of their own"):
            renewed(page, "new", "<!-- b -->", "<!-- e -->")
