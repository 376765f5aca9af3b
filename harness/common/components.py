"""Components: the files of a role, wherever they come from, under one mechanism.

A component is a vehicle, tyre, effect, set of sensors, degradation of them, set of parameters, kind of drive,
estimator or reader. It comes

1. with the harness (the folder is the registry),
2. by ``register`` in a script or notebook,
3. from the project folder in force (``harness.common.locations``), a Python file in the folder named after the role,
4. from an installed package that declares an entry point in the group ``harness.<role>``.

Nothing is imported, and no entry point scanned, before a role is listed or a name looked up. A name that two places
claim is refused with both; the same file by two ways is one component.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import os
import pkgutil
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from harness.common import locations
from harness.common.errors import ModelError, UserError
from harness.common.files import LIMITED

WORDS = (
    "vehicles", "tyres", "effects", "sensors", "degradations", "parameters", "drives", "estimators", "readers",
)  # fmt: skip
"""Roles that components may come for from outside: names of folders, of entry-point groups and of ``register``."""

OURS = "harness"
"""Origin of what comes with the package."""

_REGISTERED = "harness_registered"
_Remembered = TypeVar("_Remembered", bound=Callable[..., Any])


@dataclass(frozen=True)
class Component:
    """One component, not yet imported unless it was registered.

    Attributes:
        name: What studies and commands call it.
        origin: Where it comes from, for people.
        home: Dotted name of the module; empty for an object without one.
        path: Its file; ``None`` where there is none or nobody knows it before importing.
        attribute: Name of the object within the module, if it is not the module itself.
        module: The module, if it was registered.
    """

    name: str
    origin: str
    home: str
    path: Path | None
    attribute: str = ""
    module: ModuleType | None = None

    @property
    def place(self) -> str:
        """Where it stands, for messages."""
        return str(self.path) if self.path is not None else f"{self.home or 'an object'} ({self.origin})"

    def load(self) -> ModuleType:
        """Import it.

        Raises:
            ModelError: If it cannot be imported, with file and line.
        """
        if self.module is not None:
            return self.module
        if self.origin == OURS:
            return importlib.import_module(self.home)
        if (self.home, self.attribute) in _loaded:
            return _loaded[self.home, self.attribute]
        try:
            imported: Any = importlib.import_module(self.home)
            for part in filter(None, self.attribute.split(".")):
                imported = getattr(imported, part)
        except Exception as error:
            raise ModelError(
                f"{self.place}: cannot be imported: {type(error).__name__}: {error}{_at(error)}"
            ) from error
        if not isinstance(imported, ModuleType):
            imported = _as_module(self.name, imported)
        _loaded[self.home, self.attribute] = imported
        _note(imported, self)
        return imported


_registered: dict[tuple[str, str], Component] = {}
_loaded: dict[tuple[str, str], ModuleType] = {}
_names: dict[int, tuple[ModuleType, Component]] = {}
_outside: set[str] = set()
_caches: list[Callable[[], None]] = []
_in_force: list[Path | None] = [None]
_changes = [0]
_listed: dict[tuple[str, str, str], tuple[int, tuple[Component, ...]]] = {}

_SETTLED = 2.0
"""s without a change after which a folder's time of change says that it is as it was; file systems count coarsely."""


def outside_packages() -> frozenset[str]:
    """Return the top-level packages of the components from outside that this process has imported."""
    return frozenset(_outside)


def name_of(module: ModuleType) -> str:
    """Return the name that a component is found by; the stem of any other module."""
    named = _names.get(id(module))
    return module.__name__.rpartition(".")[2] if named is None else named[1].name


def is_component(module: ModuleType) -> bool:
    """Return whether a module came from outside as a component."""
    return id(module) in _names


def place_of(module: ModuleType) -> str:
    """Return where a component stands, for messages."""
    named = _names.get(id(module))
    return named[1].place if named is not None else getattr(module, "__file__", None) or module.__name__


def remembered(function: _Remembered) -> _Remembered:
    """Let a cached function, which finds components by name, forget when other ones are registered or in force."""
    _caches.append(function.cache_clear)  # type: ignore[attr-defined]
    return function


def generation() -> tuple[Path | None, int]:
    """Return what changes whenever other components may be found."""
    root = locations.project()
    if root != _in_force[0]:
        _in_force[0] = root
        _forget()
    return root, _changes[0]


def _forget() -> None:
    _changes[0] += 1
    for clear in _caches:
        clear()


def _note(module: ModuleType, component: Component) -> None:
    _names.setdefault(id(module), (module, component))
    _outside.add(module.__name__.partition(".")[0])


def register(role: str, component: ModuleType | str | os.PathLike[str] | Any, name: str | None = None) -> ModuleType:
    """Add a component for this process, as a notebook or script needs it.

    Registered again under its name it is replaced, so that a cell may be run twice.

    Args:
        role: Such as ``"vehicles"`` or ``"effects"``, see ``WORDS``.
        component: A module, the path of a Python file, or any object (a class, a ``SimpleNamespace``) whose attributes
            are what the role requires (``harness/models/contracts.py``, ``harness/estimation/contract.py``).
        name: What studies call it; by default the stem of the file or the object's ``__name__``.

    Returns:
        The component as a module.

    Raises:
        UserError: If there is no such role or file, or the object has no name.
        ModelError: If the file cannot be imported.

    Example:
        >>> import harness, types
        >>> mine = types.SimpleNamespace(OUTPUTS={"yaw_rate": "yaw_rate"}, __doc__="One gyro.")
        >>> harness.register("sensors", mine, "one_gyro").OUTPUTS
        {'yaw_rate': 'yaw_rate'}
    """
    if role not in WORDS:
        raise UserError(f"register: there is no role '{role}'; there are: {', '.join(WORDS)}")
    if isinstance(component, str | os.PathLike):
        made = _from_file(role, Path(component), name)
    else:
        called = name or getattr(component, "__name__", "").rpartition(".")[2]
        if not called.isidentifier() or called.startswith("_"):
            raise UserError(f"register: what shall the component be called? register({role!r}, ..., name='my_one')")
        module = component if isinstance(component, ModuleType) else _as_module(called, component)
        file = getattr(module, "__file__", None)
        made = Component(
            called, "registered", module.__name__ if file else "", Path(file) if file else None, "", module
        )
    assert made.module is not None
    _registered[role, made.name] = made
    _note(made.module, made)
    _forget()
    return made.module


def unregister(role: str, name: str) -> None:
    """Take back what ``register`` added; nothing happens if it did not."""
    if _registered.pop((role, name), None) is not None:
        _forget()


def registered() -> tuple[tuple[str, str], ...]:
    """Return role and name of everything registered."""
    return tuple(_registered)


@dataclass(frozen=True)
class Carried:
    """Components and settings that another process takes over, by files that it sees as well.

    Attributes:
        project: Project folder in force.
        files: Files of what was registered, by role and name.
        limited: Whether tables larger than any recording are refused.
    """

    project: Path | None
    files: dict[tuple[str, str], Path]
    limited: bool


def carried() -> Carried:
    """Return the project and what was registered in this process; an object without a file stays behind."""
    root = locations.project()
    files = {key: c.path.resolve() for key, c in _registered.items() if c.path is not None}
    return Carried(None if root is None else root.resolve(), files, LIMITED[0])


def take_over(other: Carried) -> None:
    """Let this process find what another one finds.

    Raises:
        UserError: If it does not see the project or a file.
        ModelError: If a file cannot be imported.
    """
    if other.project is not None and not (other.project / locations.MARK).is_file():
        raise UserError(f"there is no project folder {other.project}")
    LIMITED[0] = other.limited
    locations.use_project(other.project)
    for role, name in [key for key in _registered if key not in other.files]:
        unregister(role, name)
    for (role, name), path in other.files.items():
        there = _registered.get((role, name))
        if there is None or there.path != path:
            register(role, path, name)


def _from_file(role: str, path: Path, name: str | None) -> Component:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"register: {path}: cannot be read: {error.strerror}") from None
    called = name or path.stem
    # the content is in the name, so that what is remembered by a module's name cannot be that of an earlier text
    mark = hashlib.sha256(str(path.resolve()).encode() + content).hexdigest()[:12]
    home = f"{_REGISTERED}_{mark}.{called}"
    if home not in sys.modules:
        parent = _package(f"{_REGISTERED}_{mark}", path.resolve().parent)
        spec = importlib.util.spec_from_file_location(home, path.resolve())
        if spec is None or spec.loader is None or not called.isidentifier():
            raise UserError(f"register: {path}: no Python file with a name that can be imported")
        module = importlib.util.module_from_spec(spec)
        sys.modules[home] = module
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            del sys.modules[home]
            at = _at(error)
            raise ModelError(f"{path}: cannot be imported: {type(error).__name__}: {error}{at}") from error
        setattr(parent, called, module)
    return Component(called, "registered", home, path.resolve(), "", sys.modules[home])


def _as_module(name: str, thing: Any) -> ModuleType:
    """Return a module with the attributes of an object."""
    module = ModuleType(name)
    for attribute in dir(thing):
        if attribute == "__doc__" or not attribute.startswith("__"):
            setattr(module, attribute, getattr(thing, attribute))
    return module


def find(word: str, package: ModuleType) -> dict[str, Component]:
    """Return every component of a role by name, sorted.

    Args:
        word: Of the role, one of ``WORDS``; empty for a role that nothing may be added to from outside.
        package: With the role's own files.

    Raises:
        ModelError: If two places claim one name.
    """
    generation()
    by_name: dict[str, Component] = {}
    for component in (*_in_folder(package.__path__, package.__name__, OURS), *_from_outside(word)):
        first = by_name.setdefault(component.name, component)
        if first is not component and not _same_file(first, component):
            raise ModelError(
                f"two of the {word} are called '{component.name}': {first.place} ({first.origin}) and "
                f"{component.place} ({component.origin}); rename one of the two"
            )
    return dict(sorted(by_name.items()))


def _from_outside(word: str) -> Iterator[Component]:
    if word not in WORDS:
        return
    yield from (component for (role, _), component in _registered.items() if role == word)
    root = locations.project()
    if root is not None and (root / word).is_dir():
        top = f"harness_project_{hashlib.sha256(str(root.resolve()).encode()).hexdigest()[:12]}"
        _package(top, root)
        yield from _in_folder([str(root / word)], f"{top}.{word}", f"project {locations.project_name(root)}")
    yield from _installed().get(word, ())


def _in_folder(folders: Iterable[str], package: str, origin: str) -> Iterator[Component]:
    """Yield what lies in folders, each read again only where it has changed: names are looked up thousands of times."""
    for folder in folders:
        key = folder, package, origin
        try:
            changed = os.stat(folder).st_mtime_ns
        except OSError:
            continue
        if key not in _listed or _listed[key][0] != changed:
            components = tuple(_read_folder(*key))
            if not _shows_changes(folder, changed):
                yield from components
                continue
            _listed[key] = changed, components
        yield from _listed[key][1]


def _shows_changes(folder: str, changed: int) -> bool:
    """Whether a folder's time of change says that nothing else is in it; a folder in it may become a package unseen."""
    if time.time() - changed / 1e9 < _SETTLED:
        return False
    with os.scandir(folder) as entries:
        return not any(e.is_dir() and not e.name.startswith(("_", ".")) for e in entries)


def _read_folder(folder: str, package: str, origin: str) -> Iterator[Component]:
    for info in pkgutil.iter_modules([folder]):
        if not info.name.startswith("_"):
            base = Path(folder) / info.name
            path = base / "__init__.py" if info.ispkg else base.with_suffix(".py")
            yield Component(info.name, origin, f"{package}.{info.name}", path)


@functools.cache
def _installed() -> dict[str, tuple[Component, ...]]:
    """Return what installed packages declare, by role; scanned once, because every package's files are read for it."""
    from importlib.metadata import distributions, entry_points  # which bring the package email with them

    groups = {p.group for d in distributions() for p in d.entry_points if p.group.startswith("harness.")}
    by_role = dict[str, tuple[Component, ...]]()
    for group in groups:
        components = []
        for point in entry_points(group=group):
            by = f"package {point.dist.name} {point.dist.version}" if point.dist is not None else "an installed package"
            components.append(Component(point.name, by, point.module, None, point.attr or ""))
        by_role[group.partition(".")[2]] = tuple(components)
    return by_role


def file_of(component: Component) -> Path | None:
    """Return the file of a component, found without running it; packages that it lies in are imported."""
    if component.path is not None or not component.home:
        return component.path
    try:
        spec = importlib.util.find_spec(component.home)
    except Exception:  # whatever the packages that it lies in do
        return None
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None


def _same_file(first: Component, second: Component) -> bool:
    paths = file_of(first), file_of(second)
    return paths[0] is not None and paths[1] is not None and paths[0].resolve() == paths[1].resolve() and (
        first.attribute == second.attribute
    )  # fmt: skip


def _package(name: str, folder: Path) -> ModuleType:
    """Return a package of this name that consists of a folder, so that its files may import each other relatively."""
    if name not in sys.modules:
        package = ModuleType(name)
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = package.__path__ = [str(folder)]
        package.__spec__ = spec
        sys.modules[name] = package
    return sys.modules[name]


def _at(error: Exception) -> str:
    """Return where an error came from, if it was not the statement that says so already."""
    if isinstance(error, SyntaxError):
        return ""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename]
    return f" (line {frames[-1].lineno} of {frames[-1].filename})" if len(frames) > 1 else ""
