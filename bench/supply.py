"""Audit of the packages of the project against its locks, and of their licences; ``python -m bench.supply``.

Works without a network. Every pin of the lock files must be installed in its version, with every file as its wheel
recorded it; every requirement of what is pinned must be pinned; every licence must be one of ``ALLOWED``.
``--advisories FOLDER`` takes a copy of the PyPA advisory database (files of the OSV format) and names the pins that it
warns of.
``--page`` renews the list of licences in docs/tables/licences.md.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import importlib.metadata as metadata
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from harness.common.arguments import Parser

ROOT = Path(__file__).resolve().parents[1]
LOCKS = {
    "requirements.lock": "the package",
    "requirements-dev.lock": "its extras, tests and checks, besides",
    "requirements-docs.lock": "the site and the notebooks, besides",
}
PAGE, BEGIN, END = ROOT / "docs" / "tables" / "licences.md", "<!-- licences -->\n", "<!-- end of licences -->\n"

ALLOWED = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD", "CC0-1.0", "ISC", "LGPL-3.0-only", "LGPL-3.0-or-later",
    "MIT-0", "LLVM-exception", "MIT", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Zlib",
}  # fmt: skip
"""SPDX names; ``BSD`` where a package does not say which. The LGPL and the MPL bind changes to their own files."""

_SPELLED = (
    (r"^any-OSI$", "Zlib"),  # any licence that the OSI approves, at choice; of these the one that its own text names
    (r"LGPLv3\+|Lesser General Public License v3 or later", "LGPL-3.0-or-later"),
    (r"Mozilla Public License 2|MPL.2\.0", "MPL-2.0"),
    (r"Apache", "Apache-2.0"),
    (r"Python Software Foundation|PSF", "PSF-2.0"),
    (r"BSD.3|3-Clause", "BSD-3-Clause"),
    (r"BSD.2|2-Clause", "BSD-2-Clause"),
    (r"\bBSD\b", "BSD"),
    (r"\bISC\b", "ISC"),
    (r"\bMIT\b", "MIT"),
)
"""How packages without an SPDX expression spell their licence."""


def pins(lock: Path) -> dict[str, str]:
    """Return the versions of a lock file by name of the package."""
    lines = (line.partition("#")[0].strip() for line in lock.read_text(encoding="utf-8").splitlines())
    requirements = (Requirement(line) for line in lines if line)
    return {canonicalize_name(r.name): next(iter(r.specifier)).version for r in requirements}


def licence(about: metadata.PackageMetadata) -> str:
    """Return the licence of a package as an SPDX expression; ``unknown`` if nothing says it.

    Args:
        about: Its metadata: the expression, else what the classifiers, the free text or the head of the licence spell.
    """
    if expression := about.get("License-Expression"):
        return str(expression)
    spelled = [c for c in about.get_all("Classifier") or [] if c.startswith("License ::")]
    first = str(about.get("License") or "").strip().partition("\n")[0]
    for text in (first, *spelled, *_heads(about)):  # a text may say which BSD licence it is
        for pattern, name in _SPELLED:
            if re.search(pattern, text):
                return name
    return "unknown"


def _heads(about: metadata.PackageMetadata) -> Iterator[str]:
    """Yield the beginnings of the licence files of an installed package."""
    for file in about.get_all("License-File") or []:
        with contextlib.suppress(metadata.PackageNotFoundError):
            yield (metadata.distribution(about["Name"]).read_text(f"licenses/{file}") or "")[:200]


def is_allowed(expression: str) -> bool:
    """Return whether every part of an SPDX expression is among ``ALLOWED``; of alternatives one is enough."""
    alternatives = re.split(r"\s+OR\s+", expression.strip("() "))
    return any(all(p.strip("() ") in ALLOWED for p in re.split(r"\s+(?:AND|WITH)\s+", a)) for a in alternatives)


def faults_of_pins(pinned: Mapping[str, str], where: str) -> Iterator[str]:
    """Go through what is wrong with pins and what is installed of them.

    Args:
        pinned: Versions by name.
        where: Name of the lock file.
    """
    for name, version in pinned.items():
        try:
            package = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            yield f"{where}: {name} is not installed"
            continue
        if Version(package.version) != Version(version):
            yield f"{where}: {name} {version} is pinned, {package.version} is installed"
        if not is_allowed(expression := licence(package.metadata)):
            yield f"{where}: {name} has the licence '{expression}', which nobody has looked at"
        for text in package.requires or []:
            wanted = Requirement(text)
            if wanted.marker is not None and not wanted.marker.evaluate({"extra": ""}):
                continue
            there = pinned.get(canonicalize_name(wanted.name))
            if there is None:
                yield f"{where}: {name} needs {wanted.name}, which is not pinned"
            elif not wanted.specifier.contains(there, prereleases=True):
                yield f"{where}: {name} needs {wanted.name}{wanted.specifier}, {there} is pinned"
        yield from (f"{name}: {fault}" for fault in changed_files(package))


def changed_files(package: metadata.Distribution) -> Iterator[str]:
    """Go through the files of a package that are missing or not as its wheel recorded them."""
    for file in package.files or []:
        if file.hash is None or file.suffix == ".pyc" or file.parts[0] == "..":  # programs: written at installation
            continue
        path = Path(str(file.locate()))
        if not path.is_file():
            yield f"{file} is missing"
            continue
        digest = base64.urlsafe_b64encode(hashlib.new(file.hash.mode, path.read_bytes()).digest()).rstrip(b"=").decode()
        if digest != file.hash.value.rstrip("="):
            yield f"{file} is not as it was installed"


def warned(pinned: Mapping[str, str], folder: Path) -> Iterator[str]:
    """Go through the advisories of a folder (OSV format, JSON or YAML) that concern a pinned version."""
    for path in sorted(p for p in folder.rglob("*") if p.suffix in (".json", ".yaml", ".yml")):
        advisory = _read(path)
        if not isinstance(advisory, dict) or advisory.get("withdrawn"):
            continue
        for affected in advisory.get("affected") or []:
            package = affected.get("package") or {}
            name = canonicalize_name(str(package.get("name", "")))
            if package.get("ecosystem") == "PyPI" and name in pinned and _is_affected(pinned[name], affected):
                said = str(advisory.get("summary") or advisory.get("details") or "").strip().partition("\n")[0]
                yield f"{name} {pinned[name]}: {advisory.get('id', path.stem)}: {said}"


def _read(path: Path) -> Any:
    if path.suffix == ".json":
        return json.loads(path.read_text(encoding="utf-8"))
    import yaml

    return yaml.safe_load(path.read_text(encoding="utf-8"))


def _is_affected(version: str, affected: Mapping[str, Any]) -> bool:
    here = Version(version)
    listed = [v for v in map(_version, affected.get("versions") or []) if v is not None]
    if here in listed:
        return True
    for span in affected.get("ranges") or []:
        if span.get("type") != "ECOSYSTEM":
            continue
        inside = False
        for event in span.get("events") or []:
            (kind, text), *_ = event.items()
            bound = _version(text)
            if bound is None:
                continue
            if kind == "introduced":
                inside = inside or here >= bound
            elif (kind == "fixed" and here >= bound) or (kind == "last_affected" and here > bound):
                inside = False
        if inside:
            return True
    return False


def _version(text: object) -> Version | None:
    try:
        return Version(str(text))
    except InvalidVersion:
        return None


def listed_licences() -> str:
    """Return the table of licences: of each lock what the ones before it do not pin, by licence."""
    rows, before = ["| of | licence | packages |", "|---|---|---|"], set[str]()
    for name, what in LOCKS.items():
        by: dict[str, list[str]] = {}
        for package in pins(ROOT / name):
            if package not in before:
                by.setdefault(licence(metadata.metadata(package)), []).append(package)
        before |= set(pins(ROOT / name))
        rows += [f"| {what} | {expression} | {', '.join(packages)} |" for expression, packages in sorted(by.items())]
    return "\n".join(rows) + "\n"


def renewed(page: str, table: str) -> str:
    """Return a page with another table between the marks of the list of licences."""
    head, _, rest = page.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n{table}\n{END}{tail}"


def main(arguments: Sequence[str]) -> int:
    """Say what is wrong; 1 if anything is."""
    parser = Parser(prog="python -m bench.supply", description="Audit the locks, without a network.")
    parser.add_argument("--advisories", type=Path, help="copy of the PyPA advisory database, or of a part of it")
    parser.add_argument("--page", action="store_true", help="renew the list of licences in docs/tables/licences.md")
    given = parser.parse_args(arguments)
    faults: dict[str, None] = {}
    every: dict[str, str] = {}
    for name in LOCKS:
        pinned = pins(ROOT / name)
        faults |= dict.fromkeys(faults_of_pins({**every, **pinned}, name))
        for package in every.keys() & pinned.keys():
            if every[package] != pinned[package]:
                faults[f"{name}: {package} {pinned[package]}, but {every[package]} in the locks before"] = None
        every |= pinned
    if given.advisories is not None:
        faults |= dict.fromkeys(warned(every, given.advisories))
    if given.page:
        PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8"), listed_licences()), encoding="utf-8")
    for fault in faults:
        print(fault)
    advisories = "" if given.advisories is None else f", advisories of {given.advisories}"
    print(f"{len(every)} pins: installed, whole, complete, licences{advisories}: {len(faults)} findings")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
