"""Representation, comparison and spelled-out keywords of the public objects."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import pandas as pd


IN_PYTHON = "import harness, in Python"
"""How a report says that it was made, unless it is told otherwise."""

_F = TypeVar("_F", bound=Callable[..., Any])


def note(sentence: str) -> None:
    """Tell the user on stderr of something that was chosen for them or is odd about what they gave."""
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True).print(Text(f"note: {sentence}"), soft_wrap=True)


def keywords(table: type) -> Callable[[_F], _F]:
    """Spell out ``**keys: Unpack[table]`` in the signature of a function, for ``help`` and completion.

    Args:
        table: TypedDict of the keywords.
    """

    def spelled_out(function: _F) -> _F:
        signature = inspect.signature(function)
        *named, _ = signature.parameters.values()
        own = inspect.get_annotations(table).items()
        further = [inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=a) for n, a in own]
        function.__signature__ = signature.replace(parameters=[*named, *further])  # type: ignore[attr-defined]
        return function

    return spelled_out


class Shown:
    """Shows itself by a title and facts, and is equal to what is of its kind and has the same state."""

    def _title(self) -> str:
        return type(self).__name__

    def _facts(self) -> Mapping[str, Any]:
        """Return values by name; empty ones are left out."""
        return {}

    def _table(self) -> tuple[pd.DataFrame, str] | None:
        """Return a table that unfolds in a notebook, and what is in it."""
        return None

    def _state(self) -> Any:
        """Return what equal objects have in common."""
        return vars(self)

    def __repr__(self) -> str:
        """Return the object in a few lines."""
        lines = [f"  {name}: {value}" for name, value in self._facts().items() if value not in ("", None)]
        return "\n".join([self._title(), *lines])

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th>"
            f"<td style='text-align:left'>{escape(str(value))}</td></tr>"
            for name, value in self._facts().items()
            if value not in ("", None)
        )
        html = f"<div><strong>{escape(self._title())}</strong><table>{rows}</table>"
        if (shown := self._table()) is not None:
            table, summary = shown
            body = table.to_html(border=0, float_format=lambda v: f"{v:.6g}", na_rep="–")
            html += f"<details><summary>{escape(summary)}</summary>{body}</details>"
        return f"{html}</div>"

    def __eq__(self, other: object) -> bool:
        """Return whether both state the same; NaN is equal to NaN."""
        return isinstance(other, type(self)) and same(self._state(), other._state())

    __hash__ = None  # type: ignore[assignment]


def same(first: Any, second: Any) -> bool:
    """Return whether two objects hold the same, to the last bit: what pickle would write of them."""
    import numpy as np

    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray | np.generic):
        return first.dtype == second.dtype and np.array_equal(first, second, equal_nan=first.dtype.kind in "fcmM")
    if isinstance(first, float):
        return bool(first == second or (first != first and second != second))
    if hasattr(first, "identical"):  # of xarray and of an index of pandas
        return bool(first.identical(second))
    if hasattr(first, "equals"):  # of pandas
        return bool(first.equals(second))
    if isinstance(first, Mapping):
        return list(first) == list(second) and all(same(value, second[key]) for key, value in first.items())
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if dataclasses.is_dataclass(first):
        return all(same(getattr(first, f.name), getattr(second, f.name)) for f in dataclasses.fields(first))
    if type(first).__eq__ is object.__eq__:
        return same(first.__reduce_ex__(4), second.__reduce_ex__(4))
    return bool(first == second)
