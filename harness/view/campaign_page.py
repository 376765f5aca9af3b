"""The page of a campaign: its findings, with the verdict and numbers of each, and links to the studies behind them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bokeh.document import Document

from harness.models.quantities import words
from harness.view.frame import Part, address_bar, put_parts, read_record
from harness.view.tables import table

FILE = "campaign.json"


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of a campaign into a document.

    Args:
        folder: With ``campaign.json``.

    Raises:
        UserError: If it cannot be read.
    """
    record = read_record(folder / FILE)

    def put(document: Document) -> None:
        title = str(record.get("title", folder.name))
        put_parts(document, title, [in_short(record)], [Part("What was found?", [findings(record, {})])], address_bar())

    return put


def in_short(record: Mapping[str, Any]) -> str:
    """Return how many findings have which verdict."""
    verdicts = [str(f["verdict"]) for f in record.get("findings") or []]
    return f"{len(verdicts)} findings: " + ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)) + "."


def findings(record: Mapping[str, Any], pages: Mapping[str, str]) -> Any:
    """Return the table of findings.

    Args:
        record: The record.
        pages: Address of the page of a result, by the name of its folder.
    """
    rows = record.get("findings") or []
    columns = {
        "finding": [str(f["finding"]) for f in rows],
        "source": [str(f["place"]) for f in rows],
        "verdict": [str(f["verdict"]) for f in rows],
        "ours": [str(f["ours"]) for f in rows],
        "studies": [", ".join(words(str(s)) for s in f["studies"]) for f in rows],
    }
    return table(columns, {"studies": [next((pages[s] for s in f["studies"] if s in pages), "") for f in rows]})
