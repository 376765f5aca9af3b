"""The options of every kind of drive, as its file declares them."""

from __future__ import annotations

from harness.models.contracts import Option
from harness.models.drives._shapes import LIMIT
from harness.models.roles import DRIVES


def kinds() -> dict[str, tuple[Option, ...]]:
    """Return every kind of drive with its options."""
    return {name: options_of(name) for name in DRIVES.names()}


def options_of(kind: str) -> tuple[Option, ...]:
    """Return the options of a kind; the lateral acceleration limit is one of every kind.

    Raises:
        ModelError: If there is no such kind (with the closest names).
    """
    declared: tuple[Option, ...] = tuple(DRIVES.load(kind).OPTIONS)
    return declared if any(o.name == LIMIT.name for o in declared) else (*declared, LIMIT)
