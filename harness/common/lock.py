"""A lock on a folder that the operating system takes back when its holder ends, however it ends.

Behind a URL there is no such lock; ``harness.common.lease`` has what takes its place.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from harness.common import lease, places
from harness.common.errors import UserError
from harness.common.files import refuse_url
from harness.common.places import refuse_links

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
    import msvcrt

FILE = "run.lock"

_FAR = 1 << 30
"""Byte that is locked on Windows: beyond the text, which others may read."""

_TAKEN = {errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK}


@dataclass(frozen=True)
class Lock:
    """A lock that is held.

    Attributes:
        is_kept: Whether it keeps others out; some file systems have no locks.
        check: Raises a ``WorkError`` if it was lost meanwhile, as one behind a URL can be.
    """

    is_kept: bool
    check: Callable[[], None] = lambda: None


@contextlib.contextmanager
def locked(folder: Path, work: str, say: Callable[[str], None] = lambda _: None) -> Iterator[Lock]:
    """Hold a folder for one writer, and make it if need be; one that was made and stayed empty is removed again.

    The lock is one of the operating system on an open file (``flock``, on Windows a locked byte), never the mere
    presence of the file, so a process that is killed leaves none behind. NFS passes it on to its server; where a file
    system has no locks, nobody is kept out.

    Args:
        folder: The folder.
        work: What holds it, for the message that another one gets.
        say: Takes what a user should know where it takes time.

    Yields:
        The lock.

    Raises:
        UserError: If another process holds the folder, it cannot be written to, or the lock in it is a link.
    """
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    words = f"{work}, process {os.getpid()} on {platform.node()} since {now}"
    if places.is_url(folder):
        with lease.leased(folder / FILE, words, say) as held:
            yield Lock(True, held.check)
        return
    refuse_url(folder)
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file, has_locks = _opened(folder)
    except IsADirectoryError:
        raise UserError(f"{folder / FILE}: is a folder, where a file shows who writes here; remove it") from None
    except OSError as error:
        raise UserError(f"cannot create the result folder {folder}: {error.strerror or error}") from error
    try:
        with contextlib.suppress(OSError):  # a full disk: the words are for others
            file.truncate(0)
            file.write(f"{words}\n".encode())
            file.flush()
        yield Lock(has_locks)
    finally:
        with contextlib.suppress(OSError):
            (folder / FILE).unlink()  # Windows keeps it until it is closed
        file.close()
        if made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def holder(folder: Path) -> str | None:
    """Return who holds a folder, ``None`` for nobody."""
    if places.is_url(folder):
        return lease.holder(folder / FILE)
    refuse_links(folder, [FILE])
    try:
        with io.FileIO(folder / FILE, "r+", opener=_follow_none) as file:
            return None if _acquire(file) else _words(folder)
    except OSError:
        return None


def _opened(folder: Path) -> tuple[io.FileIO, bool]:
    """Return the file of the lock, locked if the file system has locks."""
    while True:
        refuse_links(folder, [FILE])
        file = io.FileIO(folder / FILE, "a+", opener=_follow_none)
        try:
            if not _acquire(file):
                file.close()
                raise UserError(
                    f"{folder} is being written by another process: {_words(folder)}; wait for it or stop it, or "
                    "choose another folder with --out"
                )
        except OSError as error:
            if error.errno in (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):
                return file, False
            file.close()
            raise
        if _is(file, folder / FILE):
            return file, True
        file.close()  # its last holder has removed it meanwhile


def _follow_none(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _acquire(file: io.FileIO) -> bool:
    """Try to lock an open file; raise only if that is not a question of who holds it."""
    try:
        if fcntl is not None:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            os.lseek(file.fileno(), _FAR, os.SEEK_SET)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
            os.lseek(file.fileno(), 0, os.SEEK_SET)
    except OSError as error:
        if error.errno in _TAKEN:
            return False
        raise
    return True


def _is(file: io.FileIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _words(folder: Path) -> str:
    try:
        return (folder / FILE).read_text(encoding="utf-8").strip() or "it does not say which"
    except OSError:
        return "it does not say which"
