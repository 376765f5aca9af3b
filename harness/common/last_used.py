"""Cache in memory of the values used last; threads may share it."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from threading import Lock
from typing import Generic, TypeVar

_Value = TypeVar("_Value")


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
