"""The models are one package, ``harness.models``: no second copy is loaded, and who writes the old name is told."""

import importlib.util
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from setuptools import find_packages

from harness import models
from harness.common.errors import ModelError
from harness.models.roles import ROLES, TYRES

HOSTILE = {
    "there is none": {},
    "it is another's module": {"models.py": "class User:\n    pass\n"},
    "it is another's package": {"models/__init__.py": "", "models/user.py": ""},
}


@pytest.fixture
def drop_in(tmp_path, monkeypatch):
    """Return a folder of tyres outside the project."""
    folder = tmp_path / "dropped" / "tyres"
    folder.mkdir(parents=True)
    for each in (folder, folder.parent):
        (each / "__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    yield folder
    for name in [n for n in sys.modules if n.split(".")[0] in ("dropped", "models")]:
        del sys.modules[name]


def test_they_are_installed_as_part_of_the_harness_alone():
    root = Path(__file__).parents[2]
    chosen = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    packages = find_packages(str(root), **chosen["find"])
    assert {f"harness.models.{role}" for role in ROLES} < set(packages)
    assert {name.partition(".")[0] for name in packages} == {"harness"}


@pytest.mark.parametrize("name", ["models", "somewhere.models"])
def test_under_another_name_it_is_refused(name):
    spec = importlib.util.spec_from_file_location(name, models.__file__)
    with pytest.raises(ImportError, match=r"write `from harness\.models\.contracts import"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


@pytest.mark.parametrize("files", [None, *HOSTILE.values()], ids=["it is ours", *HOSTILE])
@pytest.mark.parametrize("line", ["from models.contracts import Parameter", "import models.contracts"])
def test_a_file_that_imports_the_old_name_is_told_the_new_one(drop_in, monkeypatch, tmp_path, files, line):
    """Wherever one stands, and whatever ``models`` is there."""
    root = str(Path(models.__file__).resolve().parents[1]) if files is None else str(tmp_path / "work")
    monkeypatch.setattr(sys, "path", [root, *(p for p in sys.path if not _has_models(p))])
    for name, text in (files or {}).items():
        path = tmp_path / "work" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (drop_in / "old.py").write_text(f"{line}\nPARAMETERS = ()\n")
    with pytest.raises(ModelError, match=r"write `from harness\.models\.contracts import") as caught:
        replace(TYRES, package="dropped.tyres").load("old")
    assert str(drop_in / "old.py") in str(caught.value)


def _has_models(folder):
    return (Path(folder or ".") / "models").is_dir()


def test_what_else_a_file_cannot_import_stays_as_it_is(drop_in):
    (drop_in / "other.py").write_text("import nowhere_to_be_found\n")
    with pytest.raises(ModuleNotFoundError, match="nowhere_to_be_found"):
        replace(TYRES, package="dropped.tyres").load("other")
