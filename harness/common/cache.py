"""Cache on disk, from one process to the next, of values that take longer to make than to read.

Nothing depends on it. Whatever cannot be read whole is made again, and a folder that cannot be written keeps nothing.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import json
import os
import stat
import tempfile
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from threading import Lock
from typing import Any, Generic, NamedTuple, TypeVar

from harness.common import places
from harness.common.errors import UserError

_SIZE = hashlib.sha256().digest_size
_Value = TypeVar("_Value")


class Codec(NamedTuple, Generic[_Value]):
    """Conversion of a kind of value to bytes and back."""

    encode: Callable[[_Value], bytes]
    decode: Callable[[bytes], _Value]


def _array_bytes(values: Any) -> bytes:
    import numpy as np  # not where help is shown

    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=False)
    return stream.getvalue()


def _array(content: bytes) -> Any:
    import numpy as np

    return np.load(io.BytesIO(content), allow_pickle=False)


TEXT = Codec[str](str.encode, bytes.decode)
JSON = Codec[Any](lambda value: json.dumps(value).encode(), json.loads)
ARRAY = Codec[Any](_array_bytes, _array)


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
            status = os.stat(path)
        except OSError:  # gone meanwhile, or none yet
            continue
        if path == folder and not (stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)):
            raise UserError(f"{folder}: is no folder; set {name} to a folder of your own (docs/cluster.md)")
        if status.st_uid not in (os.geteuid(), 0):
            raise UserError(
                f"{path}: belongs to another user, and what the cache of compiled kernels holds is run; set {name} to "
                "a folder of your own (docs/cluster.md)"
            )
        if status.st_mode & 0o022:
            _refuse_no_place(folder, name)
            raise UserError(
                f"{path}: others may write to it, and what the cache of compiled kernels holds is run; if nobody has, "
                f"close it: 'chmod 700 {folder}', or set {name} to a folder of your own (docs/cluster.md)"
            )
        if path == folder and not status.st_mode & 0o077:
            return


def _refuse_no_place(folder: str, name: str) -> None:
    """Refuse a folder that takes no file, such as those of ``/proc``, where closing it would not help."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        raise UserError(
            f"{folder}: is no place to write in; set {name} to a folder of your own (docs/cluster.md)"
        ) from None


def kept(kind: str, key: str, make: Callable[[], _Value], codec: Codec[_Value]) -> _Value:
    """Return the value kept under a key, made if it is not there or damaged.

    Args:
        kind: Folder within the cache.
        key: Everything that the value depends on.
        make: Makes the value.
        codec: Of the value; it is returned as decoded, whether it was made now or before.
    """
    path = cache_folder() / kind / hashlib.sha256(key.encode()).hexdigest()[:32]
    stored = places.contents(path.parent, [path.name])[0] or b""
    content = stored[_SIZE:]
    if stored[:_SIZE] != hashlib.sha256(content).digest():
        content = codec.encode(make())
        with contextlib.suppress(OSError):
            places.write(path, hashlib.sha256(content).digest() + content)
    return codec.decode(content)


class LastUsed(Generic[_Value]):
    """Values by key, of which those that were kept last stay.

    Args:
        most: How many stay; all that are kept at once do.
    """

    def __init__(self, most: int) -> None:
        self._most, self._lock = most, Lock()
        self._values: dict[Hashable, _Value] = {}

    def __len__(self) -> int:
        return len(self._values)

    def get(self, keys: Sequence[Hashable]) -> list[_Value | None]:
        """Return the values of some keys, ``None`` where there is none."""
        with self._lock:
            return [self._values.get(key) for key in keys]

    def keep(self, keys: Sequence[Hashable], values: Sequence[_Value]) -> None:
        """Keep values, and forget those that were not used for longest."""
        with self._lock:
            for key, value in zip(keys, values, strict=True):
                self._values.pop(key, None)  # the last used come last
                self._values[key] = value
            for key in list(self._values)[: -max(self._most, len(keys))]:
                del self._values[key]
