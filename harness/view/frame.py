"""Template, style and address bar of all pages."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import CustomJS, Div, TextInput
from jinja2 import Environment

from harness.common.errors import UserError
from harness.common.files import read_text
from harness.view import tables

_ADDRESS = """
const was = new URLSearchParams(location.search), now = new URLSearchParams(cb_obj.value);
for (const name of ['time', 'colour'])  // of what the browser alone moves
    if (was.has(name)) now.set(name, was.get(name));
history.replaceState(null, '', '?' + now);
"""


@dataclass(frozen=True)
class Part:
    """One section of a page of a stored result.

    Attributes:
        heading: Words of this package, never a name out of a result.
        models: What is in it, one below the other.
        hint: How it is used; of this package as well.
    """

    heading: str
    models: Sequence[Any]
    hint: str = ""


def said(text: str, **further: Any) -> Div:
    """Return a text that is shown as it is, whatever characters it has."""
    styles = {"font-size": "15px", "line-height": "1.4", **further.pop("styles", {})}
    return Div(text=text, render_as_text=True, sizing_mode="stretch_width", styles=styles, **further)


def line(*widgets: Any) -> Any:
    """Return widgets next to each other, and below where a page is too narrow for that."""
    return row(*widgets, styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width")


def address_bar() -> TextInput:
    """Return a hidden text that becomes the query of the address whenever it is set."""
    bar = TextInput(value="", visible=False)
    bar.js_on_change("value", CustomJS(code=_ADDRESS))
    return bar


def arguments_of(document: Document) -> dict[str, str]:
    """Return what the query of the address asked for, the last of each name."""
    context = document.session_context
    given = {} if context is None else context.request.arguments
    return {name: values[-1].decode("utf-8", "replace") for name, values in given.items() if values}


def index_of(given: str | None, count: int) -> int | None:
    """Return an index that an address asks for; ``None`` if there is none such."""
    return int(given) if given and given.isascii() and given.isdigit() and int(given[:9]) < count else None


def indices_of(given: str | None, count: int) -> tuple[int, ...]:
    """Return the indices that an address asks for, those that there are."""
    indices = [index_of(part, count) for part in (given or "").split(".")]
    return tuple(dict.fromkeys(i for i in indices if i is not None))


def seconds_of(given: str | None) -> float:
    """Return a time that an address asks for; 0 if it asks for none."""
    try:
        seconds = float(given or 0.0)
    except ValueError:
        return 0.0
    return seconds if 0.0 <= seconds < 1e9 else 0.0


def fill(document: Document, template: str, title: str, roots: dict[str, Any], **variables: Any) -> None:
    """Put models into a page.

    Args:
        document: The page.
        template: File next to this module; what it is given are names of roots and HTML of this package.
        title: Of the window; shown as text.
        roots: Models by the name that the template has for them.
        **variables: Further ones of the template.
    """
    folder = Path(__file__).parent
    for name, model in roots.items():
        model.name = name
        document.add_root(model)
    document.title = title
    document.template = Environment().from_string((folder / template).read_text(encoding="utf-8"))
    own = [(folder / f"{name}.js").read_text(encoding="utf-8") for name in ("unseen", "keyboard")]
    document.template_variables.update(
        variables, style=(folder / "page.css").read_text(encoding="utf-8"), script="\n".join([tables.script(), *own])
    )


def put_parts(document: Document, title: str, answer: Sequence[str], parts: Sequence[Part], address: TextInput) -> None:
    """Put the page of a stored result into a document: its title, the answer in words, and its sections."""
    roots = {
        "title": said(title, styles={"font-size": "1.35rem", "font-weight": "bold"}),
        "answer": column(*(said(line, styles={"font-size": "1rem"}) for line in answer), sizing_mode="stretch_width"),
        "address": address,
        **{f"part{i}": column(*part.models, sizing_mode="stretch_width") for i, part in enumerate(parts)},
    }
    fill(document, "stored.html", title, roots, parts=[(part.heading, part.hint) for part in parts])


def read_record(path: Path) -> dict[str, Any]:
    """Return the record that a command wrote.

    Raises:
        UserError: If it cannot be read.
    """
    text = read_text(path)
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path}: cannot be read ({type(error).__name__}: {error})") from error
    if not isinstance(record, dict):
        raise UserError(f"{path}: no record that the harness wrote")
    return record
