"""Runs that foreign code lost, counted by reason."""

from __future__ import annotations

import threading
from collections import Counter


class Losses:
    """Runs lost by one plant or estimator; any thread may add one.

    Args:
        name: Of the plant or estimator.
    """

    def __init__(self, name: str) -> None:
        self._name, self._counts, self._lock = name, Counter[str](), threading.Lock()

    def add(self, reason: str) -> None:
        """Count one run."""
        self.add_all(Counter([reason]))

    def add_all(self, counts: Counter[str]) -> None:
        """Count runs by reason, such as those of another process."""
        with self._lock:
            self._counts.update(counts)

    def taken_counts(self) -> Counter[str]:
        """Return the runs by reason, and begin to count anew."""
        with self._lock:
            counts, self._counts = self._counts, Counter()
        return counts

    def taken(self) -> list[str]:
        """Return a line for each reason, the most frequent first, and begin to count anew."""
        counts = self.taken_counts().most_common()
        return [f"{self._name}: {n} run{'s' if n > 1 else ''} lost: {reason}" for reason, n in counts]
