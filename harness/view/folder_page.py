"""The pages of a folder of several results, each with its answer and a link to its page, and of a campaign."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bokeh.document import Document

from harness.common.errors import UserError
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.view.frame import Part, address_bar, put_parts, read_record, said
from harness.view.tables import table

_SEVERAL = {"study": "studies"}


def of_several(folder: Path, results: Sequence[tuple[Path, str]]) -> Callable[[Document], None]:
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
                record = read_record(path / FILE)
                hint = "A study opens its page; of several, the first."
                parts.append(Part("What the campaign found", [findings(record, addresses)], hint))
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
            record = read_record(folder / FILE)
            return str(record.get("title", folder.name)), in_short(record)
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


FILE = "campaign.json"


def of_campaign(folder: Path) -> Callable[[Document], None]:
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
