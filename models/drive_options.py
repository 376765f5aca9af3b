"""The options of every kind of drive, as its file declares them."""

from __future__ import annotations

from harness.common import registry
from harness.models.contracts import Option
from harness.models.drives._shapes import LIMIT

PACKAGE = "harness.models.drives"


def kinds() -> dict[str, tuple[Option, ...]]:
    """Return every kind of drive with its options."""
    return {name: options_of(name) for name in registry.names(PACKAGE)}


def options_of(kind: str) -> tuple[Option, ...]:
    """Return the options of a kind; the lateral acceleration limit is one of every kind.

    Raises:
        ModelError: If there is no such kind (with the closest names).
    """
    declared: tuple[Option, ...] = tuple(registry.load(PACKAGE, kind).OPTIONS)
    return declared if any(o.name == LIMIT.name for o in declared) else (*declared, LIMIT)
