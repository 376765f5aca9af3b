"""What takes longer to make than to read: kept in a folder from one process to the next, as compiled kernels are.

Nothing depends on it. Whatever cannot be read whole is made again, and a folder that cannot be written keeps nothing.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from harness.common import places
from harness.common.errors import UserError

_SIZE = hashlib.sha256().digest_size


def cache_folder() -> Path:
    """Return the folder of generated modules: ``$HARNESS_CACHE`` or ``~/.cache/robustness-harness``.

    Whoever may write to it decides what is run: it is made for its user alone, and one of others is refused.

    Raises:
        UserError: If somebody else may write to it, or to that of numba.
    """
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "robustness-harness"
    folder = Path(os.environ.get("HARNESS_CACHE", default))
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True)
    _refuse_others(str(folder), "HARNESS_CACHE")
    if elsewhere := os.environ.get("NUMBA_CACHE_DIR"):
        _refuse_others(elsewhere, "NUMBA_CACHE_DIR")
    return folder


@functools.cache
def _refuse_others(folder: str, name: str) -> None:
    """Refuse a cache, named by a variable, to which others may write; one that is closed to them is not looked into."""
    if not hasattr(os, "geteuid"):  # Windows, where modes say nothing
        return
    within = (os.path.join(at, file) for at, folders, files in os.walk(folder) for file in (*folders, *files))
    for path in (folder, *within):
        try:
            found = os.stat(path)
        except OSError:  # gone meanwhile, or none yet
            continue
        if found.st_uid not in (os.geteuid(), 0):
            raise UserError(
                f"{path}: belongs to another user, and what the cache of compiled kernels holds is run; set {name} to "
                "a folder of your own (docs/cluster.md)"
            )
        if found.st_mode & 0o022:
            raise UserError(
                f"{path}: others may write to it, and what the cache of compiled kernels holds is run; if nobody has, "
                f"close it: 'chmod 700 {folder}', or set {name} to a folder of your own (docs/cluster.md)"
            )
        if path == folder and not found.st_mode & 0o077:
            return


def kept(kind: str, key: str, make: Callable[[], bytes]) -> bytes:
    """Return what is kept under a key, made if it is not there or damaged.

    Args:
        kind: Folder within the cache.
        key: Everything that the content depends on.
        make: Makes the content.
    """
    path = cache_folder() / kind / hashlib.sha256(key.encode()).hexdigest()[:32]
    found = places.contents(path.parent, [path.name])[0] or b""
    content = found[_SIZE:]
    if found[:_SIZE] == hashlib.sha256(content).digest():
        return content
    content = make()
    with contextlib.suppress(OSError):
        places.write(path, hashlib.sha256(content).digest() + content)
    return content
