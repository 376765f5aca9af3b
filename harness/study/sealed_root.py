"""The attributes of a store's root, which say what every score is of, kept twice so that neither is believed alone.

The root names study, code and limits, and changes while a store lives: its words are renewed, its metadata
consolidated. So it is no file with one checksum. Its attributes and their hash stand in the group of the checksums a
second time.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.common import places, stores
from harness.common.errors import UserError, WorkError
from harness.study import checksums
from harness.study.checksums import GROUP, Fault

_COPY, _HASH = "root", "root_hash"

LAST = (f"{GROUP}/zarr.json", "zarr.json")
"""The root's copy and the root, which are written last where a store cannot be moved into place whole."""


@contextmanager
def told_as_no_store(root: Path) -> Iterator[None]:
    """Refuse a store that cannot be read as one that a study wrote; behind a URL that does not answer it is none.

    Raises:
        UserError: If it cannot be read.
        OSError: If the machine fails; behind a URL whatever a place there raises.
    """
    try:
        yield
    except (UserError, WorkError, MemoryError):
        raise
    except Exception as error:  # damaged or foreign content ends in errors of every kind
        if places.is_of_place(root, error):
            raise
        why = "" if isinstance(error, FileNotFoundError) else f" ({type(error).__name__}: {error})"
        raise UserError(
            f"{root}: not a store that a study wrote{why}; run the study again into an empty folder"
        ) from error


def is_there(root: Path) -> bool:
    """Return whether there is a store, or behind a URL one that was written to its end."""
    if places.is_url(root):
        return any((root / name).exists() for name in LAST)
    return os.path.lexists(root)  # a link, even one that leads nowhere, is in its place


def seal(root: Path) -> None:
    """Copy the attributes of the root to the group of the checksums; afterwards each protects the other."""
    attributes = dict(stores.group(root).attrs)
    sums: Any = stores.group(root, GROUP, "r+")
    sums.attrs.update({_COPY: attributes, _HASH: _hash(attributes)})


def _fault(root: Path) -> Fault | None:
    """Return what is wrong with the root or its copy; ``None`` where they agree, and in stores that have no copy."""
    copy, own = _attributes(root, GROUP), _attributes(root)
    if copy is None and (own is None or not checksums.is_verifiable(own)):
        return None  # of an earlier harness, or no store at all
    if copy is None:
        return Fault(f"{GROUP}/zarr.json", not (root / GROUP / "zarr.json").exists())
    if _COPY not in copy:
        return None
    if _hash(copy[_COPY]) != copy.get(_HASH):
        return Fault(f"{GROUP}/zarr.json", False)
    if own != copy[_COPY]:
        return Fault("zarr.json", not (root / "zarr.json").exists())
    return None


def faults(root: Path) -> list[Fault]:
    """Return all files of a store of scores that are not as they were written, the root first.

    Raises:
        ValueError, KeyError, OSError: If neither the root nor its copy can be read.
    """
    own = _fault(root)
    if own is not None and own.file == "zarr.json":
        return [own]  # nothing below can be trusted to be of this store
    faulty = checksums.faults(root) + ([own] if own else [])
    return faulty or ([] if _has_true_copies(root) else [Fault("zarr.json", False)])


def study_name(root: Path) -> str:
    """Return the name of the study that a store is of, from the copy where the root is damaged."""
    for group in (GROUP, ""):
        attributes = _attributes(root, group) or {}
        if name := attributes.get(_COPY, attributes).get("study_name"):
            return str(name)
    return "unknown"


def restore(root: Path) -> Fault | None:
    """Mend a root that is not what its copy says, or the copy where only that is damaged; return what was mended.

    The copies of the other groups' metadata in the root go; ``consolidate_metadata`` makes them again.
    """
    fault = _fault(root)
    if fault is None:
        return None
    if fault.file == "zarr.json":
        attributes = (_attributes(root, GROUP) or {})[_COPY]
        group = {"attributes": attributes, "zarr_format": 3, "node_type": "group"}
        places.write(root / "zarr.json", json.dumps(group, indent=2).encode())
    elif _attributes(root) is not None:
        group = {"attributes": {}, "zarr_format": 3, "node_type": "group"}
        places.write(root / GROUP / "zarr.json", json.dumps(group, indent=2).encode())
        seal(root)
    return fault


def _attributes(root: Path, group: str = "") -> dict[str, Any] | None:
    content = _content(root, group)
    attributes = content.get("attributes") if content is not None else None
    return attributes if isinstance(attributes, dict) else None


def _content(root: Path, group: str = "") -> dict[str, Any] | None:
    return _parsed(places.contents(root, [f"{group}/zarr.json" if group else "zarr.json"])[0])


def _parsed(metadata: bytes | None) -> dict[str, Any] | None:
    try:
        content = json.loads(metadata or b"")
    except ValueError:
        return None
    return content if isinstance(content, dict) and content.get("zarr_format") == 3 else None


def _has_true_copies(root: Path) -> bool:
    """Return whether the metadata that the root copies from its groups are theirs; earlier stores cannot say."""
    own = _content(root) or {}
    if not checksums.is_verifiable(own.get("attributes", {})):
        return True
    copies = (own.get("consolidated_metadata") or {}).get("metadata", {})
    theirs = places.contents(root, [f"{name}/zarr.json" for name in copies])
    return all(
        (parsed := _parsed(content)) is not None and _of_itself(parsed) == _of_itself(copy)
        for content, copy in zip(theirs, copies.values(), strict=True)
    )


def _of_itself(metadata: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in metadata.items() if key != "consolidated_metadata"}


def _hash(attributes: Any) -> str:
    text = json.dumps(attributes, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
