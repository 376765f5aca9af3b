"""Result folders that somebody has prepared: links out of them, pipes, foreign formats and forged metadata.

An input is a recipe, which says what is put in the place of which file; the folder is made anew for each.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from bench.fuzz.mutate import changed, values
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.common.lock import locked
from support import synthetic

ELSEWHERE = ("/none/such", "/etc/passwd", "/dev/zero", "..", ".", "scores.zarr")
"""Where links lead; nothing may be read from or written to a folder ``/none``."""

_OLDER = {".zgroup": {"zarr_format": 2}, ".zarray": {
    "zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "compressor": None, "fill_value": "", "order": "C",
    "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]}}  # fmt: skip


def good(folder: Path) -> bytes:
    """Make the whole result that recipes change, and return the recipe that changes nothing."""
    shutil.rmtree(folder, ignore_errors=True)
    synthetic.write(folder, {"level": synthetic.design(repeats=1)})
    for name in ("run.json", "bound.json"):
        (folder / name).write_text(json.dumps({} if name == "run.json" else {"rmse": {}}), encoding="utf-8")
    return b"[]"


def recipes(folder: Path) -> st.SearchStrategy[bytes]:
    """Return a strategy for recipes: lists of a file, what is done with it, and what with."""
    whole = sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))
    places = st.sampled_from([*whole, "run.lock", "report.html", "report.html.part", "errors.txt", "scores.zarr.new"])
    metadata = [name for name in whole if name.endswith(".json")]
    tables = [(name, json.loads((folder / name).read_bytes())) for name in metadata]
    step = st.one_of(
        st.tuples(places, st.just("link"), st.sampled_from(ELSEWHERE)),
        st.tuples(places, st.just("pipe"), st.none()),
        st.tuples(st.sampled_from(metadata), st.just("older"), st.sampled_from(list(_OLDER))),
        st.sampled_from(tables).flatmap(lambda t: st.tuples(st.just(t[0]), st.just("says"), changed(t[1]))),
        st.tuples(st.sampled_from(metadata), st.just("says"), values),
    )
    return st.lists(step, min_size=1, max_size=2).map(lambda recipe: json.dumps(recipe).encode())


def prepare(path: Path) -> None:
    """Make the folder of a recipe."""
    folder = path.parent / "prepared"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(path.parent / "good" / "result", folder)
    for name, what, target in json.loads(path.read_bytes()):
        _put(folder / name, what, target)


def look(path: Path) -> None:
    """Let commands read and write the folder of a recipe.

    Raises:
        UserError: If one refuses it.
    """
    from harness.study.plan import progress
    from harness.study.results import read
    from harness.study.verify import verify

    folder = path.parent / "prepared"
    refused: list[UserError] = []
    for command in (read, progress, lambda f: verify(f, lambda: _none(), 0), _written):
        try:
            command(folder)
        except UserError as error:
            refused.append(error)
    if refused:
        raise refused[0]


def _put(file: Path, what: str, target: Any) -> None:
    if not file.parent.is_dir() or file.parent.is_symlink():
        return  # a recipe that has replaced it before
    if what == "older":
        file.with_name(target).write_text(json.dumps(_OLDER[target]), encoding="utf-8")
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)
    if what == "link":
        file.symlink_to(target)
    elif what == "pipe":
        os.mkfifo(file)
    elif what == "says":
        file.write_text(json.dumps(target), encoding="utf-8")


def _none() -> Any:
    raise UserError("no study")


def _written(folder: Path) -> None:
    with locked(folder, "fuzz"):
        write_files(folder, {"report.html": "ours"})
