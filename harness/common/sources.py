"""The source files that a computation really runs, and a digest of them.

What a computation runs is the modules that it begins with and all that these import: not a list of folders, which
forgets what is moved, and not the whole tree, which counts the wording of a report. Packages other than the
project are left out; their versions are recorded. A module that only re-exports a name is replaced by the one that
defines it.

The digest is of what the files say. Modules count by the place that they have among those imported, not by their
names, and the order of import statements does not matter, so that it stays the same where a file is only renamed or
moved. Docstrings do not count either; comments and layout do.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import inspect
import sys
import sysconfig
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

from harness.common import components
from harness.common.cache import JSON, kept

_PROJECT = frozenset({__name__.partition(".")[0]})
_STANDARD = tuple(Path(sysconfig.get_path(key)).resolve() for key in ("stdlib", "platstdlib"))
_INSTALLED = {"site-packages", "dist-packages"}  # and any folder that pip installed into, with its records


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
    """A module as read: its imports at whatever depth, and the lines of all else but docstrings."""

    imports: tuple[_Import, ...]
    text: str


def is_own(module: ModuleType) -> bool:
    """Return whether a module is of the project or of its user, and not of an installed package or of Python."""
    return _is_own(module.__name__, _PROJECT | components.outside_packages())


def has_file(module: ModuleType) -> bool:
    """Return whether a module stands in a file; one made of an object does not."""
    return sys.modules.get(module.__name__) is module and _path(module.__name__) is not None


def modules(roots: Iterable[ModuleType], without: Collection[str] = ()) -> list[str]:
    """Return the names of the modules that the roots consist of: themselves and all they import, in a fixed order.

    Args:
        roots: Where to begin.
        without: Names of modules and packages that are left out, with what only they import: those that write down a
            result and do not decide it.
    """
    names = [m.__name__ for m in roots]
    inside = _PROJECT | {name.partition(".")[0] for name in names}
    ordered: dict[str, None] = {}
    # the last in is the first out, so that each is followed by what it imports
    waiting = list(reversed(names))
    while waiting:
        name = waiting.pop()
        if name not in ordered and not _lies_in(name, without):
            ordered[name] = None
            homes = [home for _, home, _ in _resolved(name, inside)]
            waiting += [home for home in reversed(homes) if _is_own(home, inside)]
    return list(ordered)


def digest(roots: Sequence[ModuleType], without: Collection[str] = ()) -> str:
    """Return the SHA-256 of what ``modules`` say; the order of the roots counts."""
    return _digest(tuple(m.__name__ for m in roots), tuple(without))


def _lies_in(name: str, packages: Collection[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def object_digest(module: ModuleType) -> str:
    """Return the SHA-256 of a component that stands in no file, such as one made in a cell of a notebook.

    It is of the source of its functions, of those from no file either that they call, and of its values as they print;
    what it takes from files counts by these files.
    """
    total = hashlib.sha256()
    seen: set[int] = set()

    def add(name: str, value: object) -> None:
        if id(value) in seen:
            return
        seen.add(id(value))
        total.update(f"{name} = ".encode())
        home = sys.modules.get(getattr(value, "__module__", None) or "")
        if isinstance(value, ModuleType):
            total.update(value.__name__.encode())
        elif home is not None and home.__name__ != "__main__" and callable(value) and _path(home.__name__) is not None:
            own = _is_own(home.__name__, _PROJECT)
            total.update((digest([home]) if own else f"{home.__name__}.{name}").encode())
        elif isinstance(value, FunctionType):
            total.update(_source(value).encode())
            for other in _named(value.__code__):
                if other in value.__globals__:
                    add(other, value.__globals__[other])
        else:
            total.update(repr(value).encode())

    for name in sorted(n for n in vars(module) if not n.startswith("__")):
        add(name, vars(module)[name])
    return total.hexdigest()


def _source(function: FunctionType) -> str:
    try:
        return inspect.getsource(function)
    except OSError:  # typed at a prompt
        return f"{function.__code__.co_code.hex()} {function.__code__.co_consts} {function.__code__.co_names}"


def _named(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _named(part)


@functools.cache  # of the code that this process runs, whatever becomes of the files
def _digest(names: tuple[str, ...], without: tuple[str, ...]) -> str:
    inside = _PROJECT | {name.partition(".")[0] for name in names}
    places = {name: str(place) for place, name in enumerate(modules((sys.modules[n] for n in names), without))}
    total = hashlib.sha256()
    for name in places:
        imports = [(local, places.get(home, home), attribute) for local, home, attribute in _resolved(name, inside)]
        total.update(f"{imports}\n{_read(name).text}\n".encode())
    return total.hexdigest()


def _resolved(name: str, inside: frozenset[str]) -> list[tuple[str, str, str]]:
    """Return what a module imports as (name there, home, name at home), sorted, from the modules that define it."""
    definitions = {(i.name, *_definition(i.home, i.attribute, inside)) for i in _read(name).imports}
    return sorted(definitions, key=lambda entry: (entry[0], entry[2]))


def _definition(home: str, attribute: str, inside: frozenset[str]) -> tuple[str, str]:
    """Return the module that defines a name, and what it is there, past packages that re-export it."""
    while attribute and (home.partition(".")[0] in inside or _is_own(home, inside)):
        path = _path(home)
        if path is not None and path.name != "__init__.py":
            break
        if _path(f"{home}.{attribute}") is not None:
            return f"{home}.{attribute}", ""
        if path is None:  # a folder without a file of its own
            break
        handed_on = next((i for i in _read(home).imports if i.name == attribute), None)
        if handed_on is None:
            break
        home, attribute = handed_on.home, handed_on.attribute
    return home, attribute


def _is_own(name: str, inside: frozenset[str]) -> bool:
    top = name.partition(".")[0]
    if top not in inside:
        path = _path(top)  # looked at first, because looking for a module imports the packages that it lies in
        if path is None or _is_installed(path.parent.parent if path.name == "__init__.py" else path.parent):
            return False
    path = _path(name)
    return path is not None and path.suffix == ".py"


@functools.cache
def _is_installed(folder: Path) -> bool:
    """Return whether a folder holds Python's own packages or packages that were installed."""
    if _INSTALLED & set(folder.parts) or any(folder.is_relative_to(s) for s in _STANDARD):
        return True
    return next(folder.glob("*.dist-info"), None) is not None


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
    source = path.read_text(encoding="utf-8")
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    key = f"{sys.version} {package}\n{source}"
    imports, text = kept("sources", key, lambda: astuple(_parsed(source, package)), JSON)
    return _File(tuple(_Import(*each) for each in imports), text)


def _parsed(source: str, package: str) -> _File:
    imports: list[_Import] = []
    lines = source.splitlines()
    for statement in _set_aside(ast.parse(source)):
        imports += _imported(statement, package)
        for line in range(statement.lineno - 1, statement.end_lineno or statement.lineno):
            lines[line] = ""
    return _File(tuple(imports), "\n".join(filter(None, lines)))


def _set_aside(block: ast.AST) -> Iterator[ast.stmt]:
    """Give the imports and docstrings of a block and those inside it, and what only type checkers read."""
    for statement in ast.iter_child_nodes(block):
        if isinstance(statement, (ast.Import, ast.ImportFrom)):
            yield statement
        elif isinstance(statement, ast.Expr):
            yield from [statement] if isinstance(statement.value, ast.Constant) else []
        elif isinstance(statement, ast.If) and isinstance(statement.test, ast.Name):
            yield from [statement] if statement.test.id == "TYPE_CHECKING" else _set_aside(statement)
        elif isinstance(statement, (ast.stmt, ast.excepthandler, ast.match_case)):
            yield from _set_aside(statement)


def _imported(statement: ast.stmt, package: str) -> list[_Import]:
    if isinstance(statement, ast.Import):
        return [_Import(a.asname or a.name, a.name, "") for a in statement.names]
    if isinstance(statement, ast.ImportFrom):
        home = importlib.util.resolve_name("." * statement.level + (statement.module or ""), package)
        return [_Import(a.asname or a.name, home, a.name) for a in statement.names]
    return []
