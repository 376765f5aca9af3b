"""What takes longer to make than to read: kept in a folder from one process to the next, as compiled kernels are.

Nothing depends on it. Whatever cannot be read whole is made again, and a folder that cannot be written keeps nothing.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from harness.common import places

_SIZE = hashlib.sha256().digest_size


def cache_folder() -> Path:
    """Return the folder of generated modules: ``$HARNESS_CACHE`` or ``~/.cache/robustness-harness``."""
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "robustness-harness"
    return Path(os.environ.get("HARNESS_CACHE", default))


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
