"""Lookup of files by a bare name, in the user's project folder first, then in the package.

A *project folder* holds a file ``harness.toml``; the nearest one upwards from the working directory is in force. It has
a folder for each kind of file:

=====================================  ============================================================================
``vehicles/ tyres/ effects/ sensors/   components: Python files that are imported when their name is looked up
parameters/ drives/ estimators/        (``harness.common.components``)
readers/``
``studies/``, ``studies/drives/``,     studies, sets of drives and tuned noise
``studies/tuned/``
``channels/``                          channel maps
``networks/``                          trained networks
=====================================  ============================================================================

Files of the last rows, from the studies on, are data: they are read, never run.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from harness.common.errors import MissingFileError, UserError, closest
from harness.common.files import BUNDLED_STUDIES, read_toml

MARK = "harness.toml"
"""The file that makes a folder a project."""

_KEYS = ("name",)
_said: set[Path] = set()
_chosen: list[Path] = []


@dataclass(frozen=True)
class Kind:
    """A kind of data file.

    Attributes:
        what: What one file is, as messages call it.
        suffix: Of the files.
        in_project: Folder within a project.
        in_package: Folder within the package.
    """

    what: str
    suffix: str
    in_project: str
    in_package: Path


STUDIES = Kind("study", ".toml", "studies", BUNDLED_STUDIES)
DRIVE_SETS = Kind("set of drives", ".toml", "studies/drives", BUNDLED_STUDIES / "drives")
TUNINGS = Kind("file of tuned noise", ".toml", "studies/tuned", BUNDLED_STUDIES / "tuned")
CHANNELS = Kind("channel map", ".toml", "channels", BUNDLED_STUDIES / "channels")
NETWORKS = Kind("network", ".npz", "networks", Path(__file__).parents[1] / "estimation" / "networks")


def project() -> Path | None:
    """Return the project folder in force, or ``None``: the nearest with a ``harness.toml`` upwards from here."""
    if _chosen:
        return _chosen[-1]
    try:
        folder = os.getcwd()
    except OSError:  # the working directory was deleted
        return None
    while not os.path.isfile(os.path.join(folder, MARK)):  # asked with every component, so as text
        above = os.path.dirname(folder)
        if above == folder:
            return None
        folder = above
    return Path(folder)


def use_project(folder: Path | None) -> None:
    """Let a project be in force wherever the process works, as a worker of a cluster needs; ``None`` ends that."""
    _chosen[:] = [] if folder is None else [folder]


def project_name(folder: Path) -> str:
    """Return the name of a project: what its file says, or the folder's.

    Raises:
        UserError: If the file is no TOML or holds anything else.
    """
    content = read_toml(folder / MARK)
    unknown = [key for key in content if key not in _KEYS]
    if unknown:
        raise UserError(f"{folder / MARK}: unknown key '{unknown[0]}'; it may say {', '.join(_KEYS)}, or nothing")
    name = content.get("name", folder.name)
    if not isinstance(name, str) or not name.strip():
        raise UserError(f"{folder / MARK}: name: expected text, got {name!r}")
    return name


def folders(kind: Kind, nearest: Path | None = None) -> list[Path]:
    """Return the folders in which files of a kind are found by name, the first that has it wins.

    Args:
        kind: The kind.
        nearest: Folder that comes first unless it is the package's own, such as that of the file that names it.
    """
    root = project()
    further = [] if root is None else [root / kind.in_project]
    if nearest is not None and _same(nearest, kind.in_package):
        return [*further, nearest]
    return [*([] if nearest is None else [nearest]), *further, kind.in_package]


def files(kind: Kind, nearest: Path | None = None) -> dict[str, Path]:
    """Return every file of a kind by its name."""
    by_name: dict[str, Path] = {}
    for folder in reversed(folders(kind, nearest)):
        by_name |= {p.stem: p for p in sorted(folder.glob(f"*{kind.suffix}"))}
    return dict(sorted(by_name.items()))


def find(kind: Kind, name: str, nearest: Path | None = None) -> Path:
    """Return the file of a name; say once, on stderr, where it takes the place of one of the package.

    Args:
        kind: Which kind.
        name: Stem of the file.
        nearest: As in ``folders``.

    Raises:
        UserError: If there is none, with the closest names and where they were looked for.
    """
    there = folders(kind, nearest)
    candidates = [folder / f"{name}{kind.suffix}" for folder in there]
    file = next((path for path in candidates if path.is_file()), None) if Path(name).name == name else None
    if file is None:
        near = closest(name, list(files(kind, nearest)))
        where = ", ".join(map(shown, there))
        raise MissingFileError(f"there is no {kind.what} '{name}'{near} (looked in {where})")
    root, ours = project(), kind.in_package / file.name
    theirs = root is not None and file.parent == root / kind.in_project
    if theirs and ours.is_file() and not _same(file, ours) and file not in _said:
        _said.add(file)
        print(f"note: {kind.what} '{name}' is that of {shown(file)}, in place of the package's", file=sys.stderr)
    return file


def shown(path: Path) -> str:
    """Write a path as short as it may be: relative to the working directory where it lies below it."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def _same(first: Path, second: Path) -> bool:
    return first.resolve() == second.resolve()
