"""Folders of results in a file system or behind a URL such as ``s3://bucket/results/joint``.

A folder behind a URL is a path of universal_pathlib, which does what pathlib does over any file system of fsspec, so
one code reads and writes both. What differs is here: what is whole or not at all (a file system moves a finished file
into place, an object store shows an object once it is whole), what is faster asked for at once, and what a folder must
not hold.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
import uuid
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit

from harness.common.errors import ModelError, UserError, WorkError

_URL = re.compile(r"(?P<scheme>[a-z][a-z0-9+.-]+)://", re.IGNORECASE)  # one letter is a drive of Windows

_UNFINISHED = ".partial"

_ABSENT = (FileNotFoundError, IsADirectoryError, NotADirectoryError)

_REMOTE = ("botocore", "aiobotocore", "aiohttp", "fsspec", "s3fs", "gcsfs", "adlfs", "google", "azure", "paramiko")
"""Packages whose errors are those of a place behind a URL."""


def place(given: str | Path) -> Path:
    """Return a folder from its path or URL; that of ``file://`` is a plain path.

    Raises:
        UserError: If it is empty, nothing is installed that knows such a URL, or nothing does.
    """
    if not isinstance(given, str):
        return given
    if not given.strip():  # a variable of a script that is not set
        raise UserError("the path is empty; name a folder, '.' for this one")
    match = _URL.match(given)
    if match is None:
        return Path(given)
    scheme = match["scheme"].lower()
    if scheme in ("file", "local"):
        host, path = urlsplit(given).netloc, urlsplit(given).path
        if not path or host not in ("", "localhost"):
            raise UserError(f"{given}: write the whole path behind three strokes: {scheme}:///results/joint")
        from urllib.request import url2pathname  # which brings a client of HTTP with it

        return Path(url2pathname(path))
    try:
        import fsspec
        from upath import UPath
    except ImportError:
        raise UserError(
            f"{given}: results behind a URL need the extra 'remote': pip install 'robustness-harness[remote]'"
        ) from None
    try:
        is_async = fsspec.get_filesystem_class(scheme).async_impl
        # Others write there as well, so nothing that was listed before is believed.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of file systems that upath has no class of its own for
            made: Any = UPath(given, **({"use_listings_cache": False} if is_async else {}))
            made.fs  # noqa: B018 - connects
    except (ImportError, ValueError, TypeError, OSError) as error:
        raise UserError(f"{given}: cannot be opened: {_words(error)} (docs/cluster.md)") from None
    return made


def is_url(folder: Path) -> bool:
    """Return whether a place is behind a URL."""
    return not isinstance(folder, Path)


def refuse_links(folder: Path, names: Iterable[str]) -> None:
    """Refuse what would lead out of a folder, or never answer, in place of a file or folder in it.

    Args:
        folder: Itself it may be a link, as whoever names it likes.
        names: Of files, within it; those of their folders are looked at as well. They need not be there.

    Raises:
        UserError: If one is a link, a pipe or a device, or lies outside.
    """
    seen: set[str] = set()
    for name in names:
        path = str(folder)
        for part in name.split("/"):
            if part == "..":
                raise UserError(f"{folder}: names a file outside of it, {name}; do not use it")
            path = f"{path}/{part}"
            if path in seen:
                continue
            seen.add(path)
            try:
                mode = os.lstat(path).st_mode
            except _ABSENT:
                break
            if stat.S_ISLNK(mode):
                raise UserError(f"{path}: is a link, and none is followed; put there what it leads to, or remove it")
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise UserError(f"{path}: is no file but a pipe or a device; remove it")


def times(folder: Path) -> dict[str, float]:
    """Return when each file below a folder was last written, by its name within; nothing where there is no folder."""
    if not is_url(folder):
        times = {}
        for path in folder.rglob("*"):
            with contextlib.suppress(FileNotFoundError):  # renamed meanwhile
                if path.is_file():
                    times[path.relative_to(folder).as_posix()] = path.stat().st_mtime
        return dict(sorted(times.items()))
    listed = _remote(folder).find(_within(folder), detail=True)
    skip = len(_within(folder).rstrip("/")) + 1
    return {name[skip:]: _time(about) for name, about in sorted(listed.items())}


def time_of(file: Path) -> float:
    """Return when a file behind a URL was last written, by the clock there."""
    return _time(_remote(file).info(_within(file)))


def _time(about: dict[str, Any]) -> float:
    stamp = next((about[key] for key in ("LastModified", "mtime", "modified", "updated", "created") if key in about), 0)
    return float(stamp.timestamp() if hasattr(stamp, "timestamp") else stamp)


def names(folder: Path) -> list[str]:
    """Return the names of all files below a folder, within it and in order."""
    return list(times(folder))


def contents(folder: Path, wanted: Sequence[str]) -> list[bytes | None]:
    """Return the contents of files below a folder, ``None`` for those that are not there; far away all at once.

    Raises:
        UserError: If the folder, or a file or folder in it, is a link, a pipe or a device.
    """
    if not is_url(folder):
        refuse_links(folder.parent, (f"{folder.name}/{name}" for name in wanted))
        return [_content(f"{folder}/{name}") for name in wanted]
    paths = [f"{_within(folder)}/{name}" for name in wanted]
    replies = _remote(folder).cat_ranges(paths, None, None, on_error="return") if paths else []
    for error in replies:
        if isinstance(error, Exception) and not isinstance(error, _ABSENT):
            raise error
    return [None if isinstance(content, Exception) else content for content in replies]


def _content(file: str) -> bytes | None:
    """Return the content of a file, ``None`` if there is none; for a small one, a Path takes as long to make."""
    try:
        with open(file, "rb") as opened:
            return opened.read()
    except _ABSENT:
        return None


def write(file: Path, content: bytes | None) -> None:
    """Write a file whole, with its folders, or not at all; without content it is removed."""
    if content is None:
        file.unlink(missing_ok=True)
        return
    if is_url(file):
        file.write_bytes(content)  # an object is there when it is whole
        return
    try:
        with unfinished(file) as stream:
            stream.write(content)
    except FileNotFoundError:
        file.parent.mkdir(parents=True, exist_ok=True)
        with unfinished(file) as stream:
            stream.write(content)


def inside(folder: Path, name: str) -> Path:
    """Return a folder within that of a result, to be filled.

    Raises:
        UserError: If it is a link, and so outside.
    """
    refuse_links(folder, [name])
    return folder / name


@contextlib.contextmanager
def unfinished(file: Path, name: str | None = None) -> Iterator[BinaryIO]:
    """Give a new file to be filled that becomes this one when the block ends; a half filled one is never seen.

    Everything that is written into a folder is written so, or as ``whole``: what stands there already, be it a link,
    is replaced and never written through.

    Args:
        file: What it becomes.
        name: What it is called meanwhile, in place of a name that no other writer has.
    """
    path = file.with_name(name or f"{file.name}.{uuid.uuid4().hex}{_UNFINISHED}")
    if name is not None:
        path.unlink(missing_ok=True)
    try:
        with open(path, "xb") as stream:  # which follows no link
            yield stream
        os.replace(path, file)
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def remove_unfinished(folder: Path) -> None:
    """Delete what writers that were killed have left below a folder; behind a URL they leave nothing."""
    if is_url(folder):
        return
    for parent, _, files in os.walk(folder):
        for name in files:
            if name.endswith(_UNFINISHED):
                Path(parent, name).unlink(missing_ok=True)


def created(file: Path, content: bytes) -> bool:
    """Write a file behind a URL if there is none of that name, and return whether this was so; one writer succeeds."""
    try:
        _remote(file).pipe_file(_within(file), content, mode="create")
    except FileExistsError:
        return False
    return True


@contextlib.contextmanager
def whole(folder: Path, last: Sequence[str]) -> Iterator[Path]:
    """Give a folder to be filled that becomes this one when the block ends; a half filled one is never seen.

    Args:
        folder: What it becomes.
        last: Names of files, those that are written last behind a URL: without them the folder counts as absent.
    """
    if not is_url(folder):
        filled = folder.with_name(folder.name + ".new")
        remove(filled)
        try:
            yield filled
        except BaseException:
            with contextlib.suppress(OSError):
                remove(filled)
            raise
        remove(folder)
        filled.rename(folder)
        return
    with tempfile.TemporaryDirectory() as here:
        filled = Path(here) / folder.name
        yield filled
        for name in sorted(names(filled), key=lambda name: (last.index(name) if name in last else -1, name)):
            write(folder / name, (filled / name).read_bytes())


def remove(folder: Path) -> None:
    """Delete a folder with all that is in it, if it is there; of a link or a file in its place that alone."""
    if is_url(folder):
        _remote(folder).rm(_within(folder), recursive=True)
    elif folder.is_dir() and not folder.is_symlink():
        shutil.rmtree(folder)
    else:
        folder.unlink(missing_ok=True)


@contextlib.contextmanager
def reached(folder: Path) -> Iterator[None]:
    """Turn errors on the way to a place behind a URL into words.

    Raises:
        WorkError: If it does not answer, or refuses.
    """
    try:
        yield
    except (UserError, ModelError, WorkError):
        raise
    except Exception as error:
        if not is_url(folder) or not is_of_place(folder, error):
            raise
        raise WorkError(
            f"{folder}: {_words(error)}; what is finished is kept, and the same command continues from there"
        ) from error


def is_of_place(folder: Path, error: Exception) -> bool:
    """Return whether an error is of the way to a place or of its machine, and not of what a file there holds."""
    if is_url(folder):
        return isinstance(error, OSError) or type(error).__module__.partition(".")[0] in _REMOTE
    return isinstance(error, OSError) and error.errno is not None and not isinstance(error, _ABSENT)


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _remote(folder: Any) -> Any:
    return folder.fs


def _within(folder: Any) -> str:
    """Return the name of a folder or file in its file system."""
    return str(folder.path)
