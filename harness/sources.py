"""The source files that a computation really runs, and a digest of them.

What a computation runs is the modules that it begins with and all that these import: not a list of folders, which
forgets what is moved, and not the whole tree, which counts the wording of a report. Packages installed beside the
project are left out; their versions are recorded. A module that only hands a name on stands aside for the one that
defines it.

The digest is of what the files say. Modules count by the place that they have among those imported, not by their
names, and the order of import statements does not matter, so that it stays the same where a file is only renamed or
moved. Comments, layout and docstrings do not count either.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from models import registry

_PROJECT = frozenset(name.partition(".")[0] for name in (__name__, registry.__name__))
_STANDARD = tuple(Path(sysconfig.get_path(key)).resolve() for key in ("stdlib", "platstdlib"))
_INSTALLED = {"site-packages", "dist-packages"}


@dataclass(frozen=True)
class _Import:
    """A name that a module imports.

    Attributes:
        name: The name that the module knows it by.
        home: Module that it comes from.
        attribute: What it is there; empty for the module itself.
    """

    name: str
    home: str
    attribute: str


@dataclass(frozen=True)
class _File:
    """A module as read: its imports at whatever depth, and all else it says, as ``ast.dump`` writes it."""

    imports: tuple[_Import, ...]
    text: str


def is_own(module: ModuleType) -> bool:
    """Return whether a module is of the project or of its user, and not of an installed package or of Python."""
    return _is_own(module.__name__, _PROJECT)


def modules(roots: Iterable[ModuleType]) -> list[str]:
    """Return the names of the modules that the roots consist of: themselves and all they import, in a fixed order."""
    names = [m.__name__ for m in roots]
    inside = _PROJECT | {name.partition(".")[0] for name in names}
    found: dict[str, None] = {}
    # the last in is the first out, so that each is followed by what it imports
    waiting = list(reversed(names))
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = None
            homes = [home for _, home, _ in _resolved(name, inside)]
            waiting += [home for home in reversed(homes) if _is_own(home, inside)]
    return list(found)


def digest(roots: Sequence[ModuleType]) -> str:
    """Return the SHA-256 of what ``modules`` say; the order of the roots counts."""
    return _digest(tuple(m.__name__ for m in roots))


@functools.cache  # of the code that this process runs, whatever becomes of the files
def _digest(names: tuple[str, ...]) -> str:
    inside = _PROJECT | {name.partition(".")[0] for name in names}
    places = {name: str(place) for place, name in enumerate(modules(sys.modules[n] for n in names))}
    total = hashlib.sha256()
    for name in places:
        imports = [(known, places.get(home, home), attribute) for known, home, attribute in _resolved(name, inside)]
        total.update(f"{imports}\n{_read(name).text}\n".encode())
    return total.hexdigest()


def _resolved(name: str, inside: frozenset[str]) -> list[tuple[str, str, str]]:
    """Return what a module imports as (name there, home, name at home), sorted, from the modules that define it."""
    found = {(i.name, *_definition(i.home, i.attribute, inside)) for i in _read(name).imports}
    return sorted(found, key=lambda entry: (entry[0], entry[2]))


def _definition(home: str, attribute: str, inside: frozenset[str]) -> tuple[str, str]:
    """Return the module that defines a name, and what it is there, past packages that hand it on."""
    while attribute and _is_own(home, inside):
        path = _path(home)
        if path is None or path.name != "__init__.py":
            break
        if _path(f"{home}.{attribute}") is not None:
            return f"{home}.{attribute}", ""
        handed_on = next((i for i in _read(home).imports if i.name == attribute), None)
        if handed_on is None:
            break
        home, attribute = handed_on.home, handed_on.attribute
    return home, attribute


def _is_own(name: str, inside: frozenset[str]) -> bool:
    path = _path(name)
    if path is None or path.suffix != ".py":
        return False
    if name.partition(".")[0] in inside:
        return True
    return not _INSTALLED & set(path.parts) and not any(path.is_relative_to(s) for s in _STANDARD)


@functools.cache
def _path(name: str) -> Path | None:
    """Return the file of a module, imported or not; ``None`` if there is none."""
    module = sys.modules.get(name)
    if module is not None:
        file = getattr(module, "__file__", None)
    else:
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, AttributeError, ValueError):
            spec = None
        file = spec.origin if spec is not None and spec.has_location else None
    return Path(file).resolve() if file else None


@functools.cache
def _read(name: str) -> _File:
    path = _path(name)
    assert path is not None
    tree = ast.parse(path.read_bytes())
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    stripped = _Stripped(package)
    text = ast.dump(stripped.visit(tree))
    return _File(tuple(stripped.imports), text)


class _Stripped(ast.NodeTransformer):
    """Takes imports, docstrings and what only type checkers read out of a module.

    Args:
        package: Against which relative imports are resolved.
    """

    def __init__(self, package: str) -> None:
        self.package = package
        self.imports: list[_Import] = []

    def visit_Import(self, node: ast.Import) -> None:
        self.imports += [_Import(a.asname or a.name, a.name, "") for a in node.names]

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        home = importlib.util.resolve_name("." * node.level + (node.module or ""), self.package)
        self.imports += [_Import(a.asname or a.name, home, a.name) for a in node.names]

    def visit_If(self, node: ast.If) -> ast.AST | None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return None
        return self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else self.generic_visit(node)
