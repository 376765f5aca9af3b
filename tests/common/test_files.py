"""TOML: what is written is read again, bit by bit, with its comments."""

import json
import math
import os
import tomllib
import tracemalloc
from pathlib import Path

import pytest

from harness.common import places
from harness.common.errors import UserError
from harness.common.files import (
    json_text,
    parse_toml,
    read_text,
    read_toml,
    refuse_url,
    renewed,
    toml_text,
    write_files,
)
from harness.recordings.read.write import check_target

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


@pytest.mark.parametrize("bits", [16, 32])
def test_wide_text_is_named(tmp_path, bits):
    (tmp_path / "a.toml").write_text("name = 1\n", encoding=f"utf-{bits}")
    with pytest.raises(UserError, match=rf"a\.toml: is UTF-{bits} text; save the file as UTF-8"):
        read_toml(tmp_path / "a.toml")


DEEP = "a key has more than 32 parts"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (".".join("a" * 50_000) + " = 1", f"line 1: {DEEP}"),
        ("x = 1\n[" + " . ".join(['"a b"'] * 5000) + "]", f"line 2: {DEEP}"),
        ("x = { " + ".".join(["'a'", "b"] * 20) + " = 1 }", f"line 1: {DEEP}"),
        ("".join(f"k{i}=1\n" for i in range(50_001)), "has 50,001 keys and tables, at most 50,000 are read"),
        ("x = 1" + "\n[[a]]" * 50_000, "has 50,001 keys and tables"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        ("a = " + ("{" + ".".join("b" * 32) + " = ") * 40 + "1" + "}" * 40, "nested too deeply"),
    ],
)
def test_a_toml_text_that_takes_memory_is_refused_before_it_is_read(text, said):
    with pytest.raises(UserError) as error:
        parse_toml(text, "a.toml")
    assert str(error.value).startswith("a.toml: ")
    assert said in str(error.value)


def test_a_toml_text_of_some_depth_and_length_is_read():
    assert parse_toml(".".join("a" * 32) + " = 1.5", "a.toml")["a"]["a"]
    numbers = "[" + ", ".join(["0.1"] * 9999) + "]"
    assert len(parse_toml(f"a = {numbers}\nb = 'v1. v2. v3. in www.a.b.c.d.e.f'", "a.toml")["a"]) == 9999


def test_a_result_may_be_larger_than_a_study(tmp_path):
    """A trace of a semitrailer that grew without a baseline writes 5 MB."""
    (tmp_path / "trace.json").write_text("[" + " " * 5 * 2**20 + "]", encoding="utf-8")
    assert json.loads(read_text(tmp_path / "trace.json")) == []
    with (tmp_path / "larger.json").open("wb") as file:
        file.truncate(2**30)
    with pytest.raises(UserError, match=r"larger\.json: is larger than 64 MiB"):
        read_text(tmp_path / "larger.json")


def test_a_text_file_larger_than_any_study_is_not_read(tmp_path):
    with (tmp_path / "a.toml").open("wb") as file:
        file.truncate(2**30)  # takes no room on the disk
    tracemalloc.start()
    with pytest.raises(UserError, match=r"a\.toml: is larger than 4 MiB"):
        read_toml(tmp_path / "a.toml")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_a_file_name_that_is_no_utf_8_can_be_written_of(tmp_path):
    write_files(tmp_path, {"a.html": f"made from {os.fsdecode(b'a' + bytes([255]))}.csv"})
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == "made from a?.csv"


def test_what_is_no_toml_is_one_error(tmp_path):
    (tmp_path / "a.toml").write_text("name = \n")
    with pytest.raises(UserError, match=r"a\.toml: not valid TOML: .*line 1"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("url", ["s3://bucket/results", "memory://x"])
def test_a_url_is_no_folder(url, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"of the commands only run, report, status and verify take a URL"):
        write_files(Path(url), {"a.txt": "text"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes that are files")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(UserError, match=r"a\.toml: is no file but a pipe"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("folder", ["results/a", "/tmp/a:/b", "C:/results", "s3"])
def test_a_folder_is_no_url(folder):
    assert refuse_url(Path(folder)) is None


def test_a_page_keeps_what_is_around_the_marks():
    assert renewed("a\n<!-- b -->\nold\n<!-- e -->\nc\n", "new", "<!-- b -->", "<!-- e -->") == (
        "a\n<!-- b -->\n\nnew\n\n<!-- e -->\nc\n"
    )
    for page in ("a\nb\n", "<!-- e -->\n<!-- b -->\n"):
        with pytest.raises(UserError, match="lines of their own"):
            renewed(page, "new", "<!-- b -->", "<!-- e -->")


@pytest.mark.parametrize("taken", ["report.html", "report.html.part"])
@pytest.mark.parametrize("link", [os.symlink, os.link])
@pytest.mark.parametrize("name", ["file", "new"])
def test_nothing_is_written_through_a_link(tmp_path, taken, link, name):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "file").write_text("precious")
    (tmp_path / "out").mkdir()
    if link is os.symlink or name == "file":
        link(tmp_path / "elsewhere" / name, tmp_path / "out" / taken)
    write_files(tmp_path / "out", {"report.html": "ours"})
    assert [(p.name, p.read_text(), p.is_symlink()) for p in (tmp_path / "out").iterdir()] == [
        ("report.html", "ours", False)
    ]
    assert [(p.name, p.read_text()) for p in (tmp_path / "elsewhere").iterdir()] == [("file", "precious")]


def test_a_pipe_is_not_written_to(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "link.csv").symlink_to(tmp_path / "pipe.csv")
    for name in ("pipe.csv", "link.csv"):
        with pytest.raises(UserError, match="is no file but a pipe or a device; name a file"):
            write_files(tmp_path, {name: "ours"})
        with pytest.raises(UserError, match="is no file but a pipe or a device; name a file"):
            check_target(tmp_path / name)


def test_the_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "report.pdf").mkdir()
    with pytest.raises(UserError, match=r"report\.pdf: cannot be written"):
        write_files(tmp_path, {"report.html": "ours", "report.pdf": "ours"})


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, ValueError])
def test_of_a_folder_that_is_not_filled_to_its_end_nothing_is_kept(tmp_path, error):
    with places.whole(tmp_path / "store", []) as filled:
        filled.mkdir()
        (filled / "old").touch()

    def begun():
        with places.whole(tmp_path / "store", []) as filled:
            filled.mkdir()
            (filled / "new").touch()
            raise error

    with pytest.raises(error):
        begun()
    assert [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")] == ["store", "store/old"]


def test_a_list_of_numbers_is_one_line_of_json():
    content = {"matrix": [[1.0, 0.5], [math.nan, 1.0]], "words": ["a [\n1,\n2]", "b"], "empty": [], "rows": [{"x": 1}]}
    text = json_text(content)
    assert json.loads(text) == {**content, "matrix": [[1.0, 0.5], [None, 1.0]]}
    assert "[1.0, 0.5]" in text
    assert text.count("\n") == 16
