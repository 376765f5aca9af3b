"""Checksums of a store's files, so that no report rests on a store that has lost some of them.

A store of scores has a group ``checksums`` with one array per design: for each unit a 64-bit BLAKE2b hash of the chunk
of every array, as it lies on the disk. It is written after everything else of the unit. What a store has before its
first unit (metadata, coordinates, values of the factors) stands with its hash in the attributes of that array, and the
runs over time in those of their group. A chunk that holds nothing but the fill value takes no file; that is a
hash of its own, so a file that is gone is noticed as well as one that has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import places, stores
from harness.common.errors import UserError
from harness.study.score_names import STATUS

GROUP = "checksums"
HISTORY = "history"

SEPARATOR = "."
"""Between the numbers in the name of a file of scores."""

_AT_ONCE = 32
"""Units whose files are read at once."""

Place = tuple[str, int, int, int]
"""A unit in the store: name of the design, band, number of its chunk along samples and repeats, drive."""


@dataclass(frozen=True)
class Fault:
    """A file of a store that is not as it was written.

    Attributes:
        file: Path within the store.
        missing: Whether it is gone; otherwise its content has changed.
        unit: The unit whose scores it holds; ``None`` if it holds none.
    """

    file: str
    missing: bool
    unit: Place | None = None

    def __str__(self) -> str:
        return f"{self.file} is {'missing' if self.missing else 'damaged'}"


def described(faults: Sequence[Fault]) -> str:
    """Return the first of some faults in words, and how many more there are."""
    more = len(faults) - 1
    return f"{faults[0]}{f' (and {more} more)' if more else ''}"


def digest(content: bytes | None) -> int:
    """Return the hash of what a file holds; that of nothing where there is none."""
    return int.from_bytes(hashlib.blake2b(content or b"", digest_size=8).digest(), "little")


def of_files(root: Path, below: str = "") -> dict[str, str]:
    """Return the hashes of the files below a group but its own metadata, by their path within the store."""
    prefix = f"{below}/" if below else ""
    files = [prefix + name for name in places.names(root / below) if name != "zarr.json"]
    return {name: _hex(content) for name, content in zip(files, places.contents(root, files), strict=True)}


def _hex(content: bytes | None) -> str:
    return f"{digest(content):016x}"


def changed_files(root: Path, hashes: Mapping[str, str]) -> list[Fault]:
    """Return the files that are not what ``of_files`` said."""
    checked = zip(hashes.items(), places.contents(root, list(hashes)), strict=True)
    return [Fault(name, content is None) for (name, wanted), content in checked if _hex(content) != wanted]


def declare(root: Path, design: str, dims: Mapping[str, Sequence[str]], units: tuple[int, int, int, int]) -> None:
    """Add the checksums of a design to a store that holds no scores yet.

    Args:
        root: The store.
        design: Name of the design, whose group is there.
        dims: Dimensions of each of its arrays of scores.
        units: How many there are: bands, chunks along the samples, chunks along the repeats, drives.
    """
    bands, samples, repeats, drives = units
    sums, own = stores.group(root, mode="r+").require_group(GROUP), f"{design}/zarr.json"
    sums.create_array(
        design,
        shape=(bands, samples * repeats, drives, len(dims)),
        chunks=(1, 1, 1, len(dims)),
        dtype="uint64",
        fill_value=0,
        compressors=None,
        # Names of its own: designs differ in size, and xarray reads the group as one dataset.
        dimension_names=[f"{design}_{each}" for each in ("band", "chunk", "drive", "array")],
        attributes={
            "arrays": {name: list(d) for name, d in dims.items()},
            "repeat_chunks": repeats,
            "separator": SEPARATOR,
            "files": {own: _hex((root / own).read_bytes()), **of_files(root, design)},
        },
    )


def chunk_files(about: Mapping[str, Any], unit: Place) -> dict[str, str]:
    """Return the file of a unit's chunk of each array, within the store; ``about`` are the attributes of the design."""
    design, band, chunk, drive = unit
    sample, repeat = divmod(chunk, int(about.get("repeat_chunks", 1)))  # earlier stores did not cut repeats
    at, between = {"band": band, "sample": sample, "drive": drive, "repeat": repeat}, about.get("separator", "/")
    return {
        name: f"{design}/{name}/" + between.join(["c", *(str(at.get(d, 0)) for d in dims)])
        for name, dims in about["arrays"].items()
    }


def row_file(unit: Place) -> str:
    """Return the file of a unit's checksums, within the store."""
    return "/".join([GROUP, unit[0], "c", *map(str, unit[1:]), "0"])


def finished(root: Path, design: str) -> dict[Place, float]:
    """Return the units of a design whose checksums, which are written last, are there, and when they were written."""
    times = {}
    for name, time in places.times(root / GROUP / design / "c").items():
        place = name.split("/")
        if len(place) == 4 and all(each.isdecimal() for each in place):
            times[design, int(place[0]), int(place[1]), int(place[2])] = time
    return times


def row(names: Iterable[str], written: Mapping[str, bytes | None]) -> bytes:
    """Return the checksums of a unit as they lie in their file.

    Args:
        names: Of all arrays of scores, in their order.
        written: Content of the unit's chunk by array, ``None`` where it takes no file; other units may share the
            chunks of arrays that are not here.
    """
    digests = [digest(written[name]) if name in written else 0 for name in names]
    return np.array(digests, dtype="<u8").tobytes()


def is_verifiable(attributes: Mapping[str, Any]) -> bool:
    """Return whether a store with these root attributes has checksums; earlier ones have none."""
    return GROUP in attributes


def faults(root: Path) -> list[Fault]:
    """Return the files of a store of scores that are not as they were written; units that are to come have none.

    A unit without status is to come, unless it has checksums, which are written after the status.

    Args:
        root: The store. One without checksums is not looked at.

    Raises:
        ValueError, KeyError, OSError: If the root of the store cannot be read.
    """
    attributes: dict[str, Any] = dict(stores.group(root).attrs)
    if not is_verifiable(attributes):
        return []
    faulty_files: list[Fault] = []
    complete = True
    for design in names(attributes["designs"]):
        sums = opened(root, f"{GROUP}/{design}")
        if sums is None or not hasattr(sums, "shape"):
            faulty_files.append(Fault(f"{GROUP}/{design}", not (root / GROUP / design / "zarr.json").exists()))
            continue
        about = dict(sums.attrs)
        faulty_files += changed_files(root, about["files"])
        units = [(design, *unit) for unit in np.ndindex(*sums.shape[:3])]
        for first in range(0, len(units), _AT_ONCE):
            for faulty in _of_units(root, about, units[first : first + _AT_ONCE]):
                complete = complete and faulty is not None
                faulty_files += faulty or []
    return faulty_files + _of_histories(root, int(attributes[GROUP]["histories"]), complete)


def names(designs: Any) -> list[str]:
    """Return the names of the designs as the root of a store has them."""
    return [str(name) for name in (json.loads(designs) if isinstance(designs, str) else designs)]


def opened(root: Path, path: str) -> Any:
    """Return a node of the store; ``None`` where it cannot be read, whatever damage makes of it.

    Raises:
        UserError: If a link, a pipe or an array of objects is in its place.
    """
    try:
        return stores.node(root, path)
    except UserError:
        raise
    except (KeyError, FileNotFoundError):  # no such node, also behind a URL that answers
        return None
    except Exception as error:
        if places.is_of_place(root, error):
            raise
        return None


def _of_units(root: Path, about: Mapping[str, Any], units: Sequence[Place]) -> Iterator[list[Fault] | None]:
    """Return what is wrong with the files of each unit; ``None`` for one that is to come."""
    files = [chunk_files(about, unit) for unit in units]
    wanted = [name for unit, own in zip(units, files, strict=True) for name in (row_file(unit), *own.values())]
    contents = dict(zip(wanted, places.contents(root, wanted), strict=True))
    for unit, own in zip(units, files, strict=True):
        is_to_come = contents[own[STATUS]] is None and contents[row_file(unit)] is None
        yield None if is_to_come else list(_of_unit(unit, own, contents))


def _of_unit(unit: Place, files: Mapping[str, str], contents: Mapping[str, bytes | None]) -> Iterator[Fault]:
    """Return what is wrong with the files of a finished unit."""
    content = contents[row_file(unit)] or b""
    row = np.frombuffer(content, dtype="<u8") if len(content) == 8 * len(files) else np.zeros(len(files), np.uint64)
    wanted = {name: int(value) for name, value in zip(files, row, strict=True)}
    if not wanted[STATUS]:
        yield Fault(row_file(unit), contents[row_file(unit)] is None, unit)
        return
    for name, file in files.items():
        if wanted[name] and digest(contents[file]) != wanted[name]:
            yield Fault(file, contents[file] is None, unit)


def _of_histories(root: Path, wanted: int, complete: bool) -> list[Fault]:
    """Return what is wrong with the runs over time, which are written after all units."""
    group = opened(root, HISTORY)
    attributes = {} if group is None else dict(group.attrs)
    is_there = places.contents(root, [f"{HISTORY}/zarr.json"])[0] is not None
    if complete and (wanted or is_there) and attributes.get("runs") != wanted:
        return [Fault(HISTORY, not is_there)]
    return changed_files(root, attributes.get("files", {}))
