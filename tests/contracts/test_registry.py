"""The folder is the registry, and ``models/`` stands on its own."""

from __future__ import annotations

import ast
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from harness import models
from harness.common import registry
from harness.common.errors import ModelError
from harness.models.roles import ROLES, TYRES

NEWCOMERS = replace(TYRES, package="newcomer.tyres")
ROOT = Path(models.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("role", ROLES)
def test_names_are_the_stems_of_the_folder(role):
    stems = {p.stem for p in (ROOT / role).glob("*.py") if not p.stem.startswith("_")}
    assert set(ROLES[role].names()) == stems
    for stem in stems:
        assert ROLES[role].load(stem).__name__ == f"harness.models.{role}.{stem}"


@pytest.mark.parametrize(
    ("role", "asked", "meant", "kind"),
    [
        ("vehicles", "semitrailor", "semitrailer", "vehicle"),
        ("tyres", "magicformula", "magic_formula", "tyre"),
        ("parameters", "ziaukas2023", "ziaukas_2023", "parameter"),
        ("sensors", "test_vehicel", "test_vehicle", "sensor"),
    ],
)
def test_an_unknown_name_gets_the_closest(role, asked, meant, kind):
    with pytest.raises(ModelError, match=rf"unknown {kind} '{asked}'; closest: {meant}"):
        ROLES[role].load(asked)


def test_a_name_like_no_other_gets_the_whole_list():
    with pytest.raises(ModelError, match=r"there are: .*linear, magic_formula"):
        TYRES.load("zzzz")


def test_no_choice_at_all_is_said():
    assert registry.closest("x", []) == "; there are none"


def test_private_helpers_are_not_offered():
    with pytest.raises(ModelError, match="unknown tyre '_stiffness'"):
        TYRES.load("_stiffness")


@pytest.fixture
def newcomer(tmp_path, monkeypatch):
    """Return a folder of tyres outside the project, as a newcomer's half-finished file."""
    folder = tmp_path / "newcomer" / "tyres"
    folder.mkdir(parents=True)
    (folder.parent / "__init__.py").touch()
    (folder / "__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    yield folder
    for name in [n for n in sys.modules if n.split(".")[0] == "newcomer"]:
        del sys.modules[name]


def test_a_missing_export_names_file_and_export(newcomer):
    (newcomer / "half.py").write_text("PARAMETERS = ()\n")
    with pytest.raises(ModelError) as caught:
        NEWCOMERS.load("half")
    assert str(newcomer / "half.py") in str(caught.value)
    assert "missing export lateral_force" in str(caught.value)
    assert "PARAMETERS" not in str(caught.value)


def test_a_new_file_is_found_without_editing_anything(newcomer):
    (newcomer / "rubber.py").write_text("PARAMETERS = ()\ndef lateral_force(t):\n    return 0\n")
    assert NEWCOMERS.names() == ["rubber"]
    assert NEWCOMERS.load("rubber").PARAMETERS == ()
    with pytest.raises(ModelError, match="missing export grip"):
        NEWCOMERS.load("rubber", exports=("grip",))


def imported(path: Path) -> set[str]:
    """Return the packages that a file imports, anywhere in it; those of the harness with the name of the part."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {"harness.models"} if node.level else {f"{node.module}.{alias.name}" for alias in node.names}
    return {".".join(name.split(".")[: 1 + name.startswith("harness.")]) for name in found}


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(ROOT)) for p in FILES])
def test_models_import_only_sympy_numpy_and_the_standard_library(path):
    strangers = imported(path) - {"harness.models", "harness.common", "sympy", "numpy"} - set(sys.stdlib_module_names)
    assert strangers == set()


def test_the_scan_sees_imports_inside_functions(tmp_path):
    file = tmp_path / "late.py"
    file.write_text("import os\ndef f():\n    from harness.study.run import go\n    import scipy.signal as s\n")
    assert imported(file) == {"os", "harness.study", "scipy"}


@pytest.mark.parametrize("role", ROLES)
def test_nothing_outside_a_file_lists_its_name(role):
    """A registry apart from the folder would name files that may not exist."""
    assert len(ast.parse((ROOT / role / "__init__.py").read_text()).body) <= 1  # its docstring
