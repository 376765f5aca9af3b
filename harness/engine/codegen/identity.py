"""What the kernels of a model follow from, as text: a name under which their source can be kept."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import fields

import sympy as sp

from harness.common.sources import digest, has_file, is_own
from harness.models.assembly.assemble import StateSpaceModel


def identity(model: StateSpaceModel) -> str | None:
    """Return a text that two models share only if they are equal, whatever process assembled them.

    It takes a tenth of the time in which their equations are derived. Functions are told apart by the source of their
    classes, because printer and derivatives ask those.

    Args:
        model: The model.

    Returns:
        The text; ``None`` if an expression holds a function that stands in no file.
    """
    expressions = _Expressions()
    parts = []
    for each in fields(model):
        value = getattr(model, each.name)
        listed = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, tuple) else []
        held = [(key, expressions.place(e)) for key, e in listed if isinstance(e, sp.Basic)]
        parts.append(f"{each.name} = {held or repr(value)}")
    sources = _sources(expressions.classes)
    return None if sources is None else "\n".join([*sources, *expressions.lines, *parts])


class _Expressions:
    """Expressions written down, each part once.

    Attributes:
        lines: One for each part, after those of its arguments.
        classes: Of all parts.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.classes: set[type] = set()
        self._places: dict[sp.Basic, int] = {}

    def place(self, expression: sp.Basic) -> int:
        """Return the number of an expression's line."""
        if expression not in self._places:
            arguments = [self.place(part) for part in expression.args]
            kind = type(expression)
            name = f"{kind.__module__}.{kind.__qualname__}"
            self.lines.append(f"{name}{arguments}" if arguments else sp.srepr(expression))
            self.classes.add(kind)
            self._places[expression] = len(self._places)
        return self._places[expression]


def _sources(classes: Iterable[type]) -> list[str] | None:
    """Return a line for each class that is not SymPy's: its name and the digest of its source."""
    sources = []
    for each in classes:
        if (each.__module__ or "sympy").partition(".")[0] == "sympy":  # of a function without definition it is None
            continue
        home = sys.modules[each.__module__]
        if not (has_file(home) and is_own(home)):
            return None
        sources.append(f"{each.__qualname__} of {digest([home])}")
    return sorted(sources)
