"""How the objects show themselves in a notebook and on the console."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


IN_PYTHON = "import harness, in Python"
"""How a report says that it was made, unless it is told otherwise."""


def note(sentence: str) -> None:
    """Tell the user on stderr of something that was chosen for them or is odd about what they gave."""
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True).print(Text(f"note: {sentence}"), soft_wrap=True)


def html(title: str, facts: Mapping[str, Any], table: pd.DataFrame | None = None, summary: str = "") -> str:
    """Return a title, a line per fact and a table that unfolds.

    Args:
        title: What it is.
        facts: Value by name; empty ones are left out.
        table: Shown below, if any.
        summary: What is in it.
    """
    rows = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in facts.items()
        if value not in ("", None)
    )
    shown = f"<div><strong>{escape(title)}</strong><table>{rows}</table>"
    if table is not None:
        body = table.to_html(border=0, float_format=lambda v: f"{v:.6g}", na_rep="–")
        shown += f"<details><summary>{escape(summary)}</summary>{body}</details>"
    return f"{shown}</div>"


def text(title: str, facts: Mapping[str, Any]) -> str:
    """Return the same as plain text."""
    lines = [f"  {name}: {value}" for name, value in facts.items() if value not in ("", None)]
    return "\n".join([title, *lines])
