"""Components outside the tree: the whole example of docs/plugins.md, and the three ways in which it may come."""

import multiprocessing
import os
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import harness
from harness.common import components, locations

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^\*\*`([\w/.-]+)`\*\*\n\n```\w+\n(.*?)^```", re.DOTALL | re.MULTILINE)

TINY = '"""A vehicle that falls asleep."""\nSTATES = ("yaw_rate",)\nINPUTS = ("speed",)\nPARAMETERS = ()\nAXLES = {}\n'
TINY += 'VALID = {"yaw_rate": 1.0}\ndef equations(v):\n    v.derivative("yaw_rate", 0)\n'


def example() -> dict[str, str]:
    """Return the files of the page by their paths in a project."""
    return dict(BLOCK.findall((ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")))


def write(folder: Path, files: dict[str, str]) -> Path:
    """Write files into a folder."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def project(folder: Path, files: dict[str, str]) -> Path:
    """Write a project folder."""
    return write(folder, {"harness.toml": "", **files})


def package(folder: Path, files: dict[str, str], name: str = "acme", version: str = "1.0") -> Path:
    """Write an installed package with the same files, and entry points for its components."""
    groups: dict[str, list[str]] = {}
    for path in files:
        role, _, file = path.partition("/")
        if role in components.WORDS and file.endswith(".py"):
            stem = file.removesuffix(".py")
            groups.setdefault(role, []).append(f"{stem} = {name}.{role}.{stem}")
    points = "\n".join(f"[harness.{role}]\n" + "\n".join(lines) for role, lines in groups.items())
    inside = {f"{name}/{path}": text for path, text in files.items() if path.endswith(".py")}
    roles = {f"{name}/{path.partition('/')[0]}/__init__.py": "" for path in files if path.endswith(".py")}
    about = {
        "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        "entry_points.txt": points + "\n",
    }
    info = {f"{name}-{version}.dist-info/{file}": text for file, text in about.items()}
    return write(folder, {f"{name}/__init__.py": "", **roles, **inside, **info})


def register(folder: Path, files: dict[str, str]) -> None:
    """Register the components among files in a folder, as a notebook does."""
    for path in write(folder, files) and files:
        role, _, file = path.partition("/")
        if role in components.WORDS and file.endswith(".py"):
            harness.register(role, folder / path)


def forget() -> None:
    """Take everything back that a test has made known."""
    for role, name in list(components.registered()):
        components.unregister(role, name)
    components._installed.cache_clear()
    locations.use_project(None)
    locations._said.clear()
    for name in [n for n in sys.modules if n.partition(".")[0] in ("acme", "other")]:
        del sys.modules[name]
    for key in [k for k in components._loaded if k[0].partition(".")[0] in ("acme", "other")]:
        del components._loaded[key]
    components._forget()


class OneProcess:
    """What ``check_workers`` needs of a cluster's client: one worker, a process that was started elsewhere.

    Args:
        folder: Where it works.
        lacks: Entry of the module path that it does not have.
    """

    def __init__(self, folder: Path, lacks: str = "") -> None:
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, mp_context=context, initializer=_elsewhere, initargs=(str(folder), lacks))

    def run(self, function, *arguments):
        return {"tcp://there": self._pool.submit(function, *arguments).result()}

    def close(self) -> None:
        self._pool.shutdown()


def _elsewhere(folder: str, lacks: str) -> None:
    os.chdir(folder)
    sys.path[:] = [entry for entry in sys.path if entry != lacks]
