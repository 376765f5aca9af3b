"""The page of a folder of several results, such as that of a campaign: each with its answer and a link to its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bokeh.document import Document

from harness.common.errors import UserError
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.view import campaign_page
from harness.view.frame import Part, address_bar, put_parts, read_record, said
from harness.view.tables import table

_SEVERAL = {"study": "studies"}


def build(folder: Path, results: Sequence[tuple[Path, str]]) -> Callable[[Document], None]:
    """Return what puts the page of a folder into a document.

    Args:
        folder: That holds the results.
        results: Folder and kind of each; the page of number ``n`` is at ``n`` below the address, counted from 1.
    """
    listed = [(path.name, kind, *_told(path, kind)) for path, kind in results]

    def put(document: Document) -> None:
        names, kinds_, titles, answers = zip(*listed, strict=True)
        shown = table(
            {"result": titles, "kind": kinds_, "folder": names, "answer": answers},
            {"result": [str(i) for i in range(1, len(listed) + 1)]},
        )
        kinds = [kind for _, kind, *_ in listed]
        counts = {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}
        count = ", ".join(f"{n} {k if n == 1 else _SEVERAL.get(k, f'{k}s')}" for k, n in counts.items())
        parts = [Part("Results", [shown], "A title opens the page of that result.")]
        addresses = {path.name: str(i) for i, (path, _) in enumerate(results, 1)}
        for path, kind in results:
            if kind == "campaign":
                record = read_record(path / campaign_page.FILE)
                hint = "A study opens its page; of several, the first."
                parts.append(Part("What the campaign found", [campaign_page.findings(record, addresses)], hint))
        put_parts(document, f"Results in {folder.name or folder}", [count], parts, address_bar())

    return put


def refused(folder: Path, why: str) -> Callable[[Document], None]:
    """Return the page of a result that cannot be shown."""

    def put(document: Document) -> None:
        put_parts(document, folder.name, [why], [Part("No page", [said("")])], address_bar())

    return put


def _told(folder: Path, kind: str) -> tuple[str, str]:
    """Return title and answer of a result."""
    try:
        if kind == "study":
            from harness.study.report import analyse  # only where there are studies: it takes seconds to import
            from harness.study.report.opening import sentences

            analysis = analyse(folder)
            attributes = analysis.store.attributes
            title = str(attributes.get("title") or attributes.get("study_name") or folder.name)
            best, harms, counts = sentences(analysis)
            return title, " ".join((best or harms or counts)[:1])
        if kind == "campaign":
            record = read_record(folder / campaign_page.FILE)
            return str(record.get("title", folder.name)), campaign_page.in_short(record)
        file = {"trace": "trace.json", "identification": "identify.json", "check": "check.json"}[kind]
        record = read_record(folder / file)
        return folder.name, _answer(record)
    except UserError as error:
        return folder.name, f"cannot be read: {error}"


def _answer(record: dict[str, Any]) -> str:
    """Return what a record answers: a sentence, several, or the values that a fit found."""
    answer = record.get("answer") or record.get("notes") or []
    if answer:
        return answer if isinstance(answer, str) else " ".join(map(str, answer))
    numbers = [
        e for e in record.get("estimates") or [] if isinstance(e, dict) and isinstance(e.get("value"), (int, float))
    ]
    values = (
        f"{words(e['name'])} {style.with_unit(float(e['value']), print_unit(str(e.get('unit') or '')))}"
        for e in numbers
    )
    return f"{record.get('model', '')}: {', '.join(values)}"
