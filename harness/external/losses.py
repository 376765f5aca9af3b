"""Runs that foreign code lost, counted by reason."""

from __future__ import annotations

import re
import threading
from collections import Counter, defaultdict

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
"""Reasons that differ by their numbers, such as a time, make one line."""


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
        alike: defaultdict[str, Counter[str]] = defaultdict(Counter)
        for reason, n in self.taken_counts().items():
            alike[_NUMBER.sub("#", reason)][reason] += n
        lines = []
        for counts in sorted(alike.values(), key=lambda counts: -counts.total()):
            (reason, _), n = counts.most_common(1)[0], counts.total()
            others = " (others with other numbers)" if len(counts) > 1 else ""
            lines.append(f"{self._name}: {n} run{'s' if n > 1 else ''} lost: {reason}{others}")
        return lines
