"""How a command's process is set up, and what the operating system counts of it, where it does; Windows does not."""

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
