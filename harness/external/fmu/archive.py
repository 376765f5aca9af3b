"""Safe look into an FMU, which is a zip: nothing is unpacked or loaded before its entries have been checked."""

from __future__ import annotations

import os
import posixpath
import re
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.common.errors import UserError

LARGEST = 2 * 2**30
"""Bytes that an FMU may have when unpacked."""

ENTRIES = 20_000
"""Files that it may have."""

LARGEST_DESCRIPTION = 2**28
"""Bytes that its description may have."""

DESCRIPTION = "modelDescription.xml"

_DRIVE = re.compile(r"[A-Za-z]:")
_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError, RuntimeError, OSError)


@contextmanager
def opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open an FMU whose entries do no harm when unpacked.

    Raises:
        UserError: If it is no whole zip, or an entry is a link, lies outside, is there twice or encrypted, or they
            are too many or too large.
    """
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):  # a pipe would be waited for
            raise UserError(f"{path}: is no regular file; an FMU is one")
        size = about.st_size
        archive = zipfile.ZipFile(path)
    except FileNotFoundError:
        raise UserError(f"{path}: there is no such FMU") from None
    except zipfile.BadZipFile:
        cut = "; it may be cut short" if _begins_as_zip(path) else ""
        raise UserError(f"{path}: is no FMU, which is a zip file{cut}") from None
    except UserError:
        raise
    except (OSError, ValueError, NotImplementedError) as error:
        raise UserError(f"{path}: cannot be read as a zip file: {_words(error)}") from None
    with archive:
        _refuse_harmful(archive, size, path)
        yield archive


def _begins_as_zip(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(2) == b"PK"


def _refuse_harmful(archive: zipfile.ZipFile, size: int, path: Path) -> None:
    entries = archive.infolist()
    if len(entries) > ENTRIES:
        raise UserError(f"{path}: has {len(entries)} entries, more than the {ENTRIES} that an FMU may have")
    unpacked = sum(entry.file_size for entry in entries)
    if unpacked > LARGEST:
        raise UserError(
            f"{path}: has {size / 2**20:.3g} MiB and would have {unpacked / 2**30:.3g} GiB when unpacked; "
            f"an FMU may have {LARGEST / 2**30:g} GiB"
        )
    names: set[str] = set()
    for entry in entries:
        name = entry.orig_filename
        if reason := _harm(entry, name):
            raise UserError(f"{path}: its entry {name[:200]!r} {reason}; nothing of it is unpacked")
        whole = posixpath.normpath(name)
        if whole in names:
            raise UserError(f"{path}: its entry {name[:200]!r} is there twice; nothing of it is unpacked")
        names.add(whole)


def _harm(entry: zipfile.ZipInfo, name: str) -> str:
    """Return what is wrong with an entry; empty if nothing."""
    parts = re.split(r"[/\\]", name)
    mode = entry.external_attr >> 16
    if name.startswith(("/", "\\")) or _DRIVE.match(name):
        return "has an absolute path"
    if ".." in parts:
        return "leads out of its folder by '..'"
    if not name or "\0" in name or "\\" in name:
        return "has a name that no file has"
    if stat.S_ISLNK(mode):
        return "is a link"
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "is no plain file"
    if entry.flag_bits & 1:
        return "is encrypted"
    return ""


def contents(archive: zipfile.ZipFile, name: str, path: Path, largest: int = LARGEST) -> bytes:
    """Return the content of an entry.

    Raises:
        UserError: If there is none, or it is damaged or too large.
    """
    try:
        entry = archive.getinfo(name)
    except KeyError:
        raise UserError(f"{path}: is no FMU: there is no {name} in it") from None
    if entry.file_size > largest:
        raise UserError(f"{path}: {name} has {entry.file_size / 2**20:.3g} MiB, more than {largest / 2**20:g} MiB")
    try:
        return archive.read(entry)
    except _DAMAGED as error:
        raise UserError(f"{path}: {name} in it is damaged: {_words(error)}") from None


def unpack(path: Path, folder: Path) -> None:
    """Write the files of an FMU to a folder, after ``opened`` has checked them.

    Raises:
        UserError: If one is damaged, or cannot be written.
    """
    with opened(path) as archive:
        for entry in archive.infolist():
            try:
                target = archive.extract(entry, folder)
                if target.endswith((".so", ".dylib")) or (entry.external_attr >> 16) & stat.S_IXUSR:
                    os.chmod(target, 0o700)  # programs that an FMU starts
            except _DAMAGED as error:
                raise UserError(f"{path}: {entry.filename} cannot be unpacked: {_words(error)}") from None


def _words(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return " ".join(str(error).split()) or type(error).__name__
