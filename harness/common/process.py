"""Set-up of a command's process, and its counters from the operating system, where there are any."""

from __future__ import annotations

import gc
import sys
from typing import Any

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]


def collect_rarely() -> None:
    """Let Python look for garbage less often: it took a seventh of a command's start, among imports, which all stay."""
    gc.set_threshold(200_000)


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Of ``mallopt``, as the header of the GNU C library numbers them."""


def keep_freed_memory() -> None:
    """Let the allocator keep what is freed, as it does by itself unless the environment sets one of its limits.

    Dask starts its workers with such a limit, so that every array above 128 KiB is mapped anew and its pages cleared:
    a third of what batches of short runs take. Nothing is done where the C library is another one.
    """
    import ctypes  # the start of a command does without

    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, TypeError, AttributeError):
        return
    mallopt(_MMAP_THRESHOLD, 2**25)
    mallopt(_TRIM_THRESHOLD, 2**28)


def peak_memory_mib() -> int | None:
    """Return the most memory that the process has held so far in MiB, ``None`` where the system does not tell."""
    if resource is None:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if sys.platform == "darwin" else 2**10))  # bytes there, KiB elsewhere


def forced_switches() -> int:
    """Return how often this thread lost its core against its will; 0 where the system does not tell."""
    thread: Any = getattr(resource, "RUSAGE_THREAD", None)  # Linux
    return 0 if thread is None else resource.getrusage(thread).ru_nivcsw
