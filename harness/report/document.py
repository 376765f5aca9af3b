"""One list of content blocks becomes one Typst text, and that becomes the HTML and the PDF.

Typst does both: the PDF is tagged and embeds its fonts, the HTML has headings, tables, MathML and the figures
as SVG inside the one file. Its HTML export is young, so the blocks use nothing but headings, paragraphs, lists,
figures, tables, formulas and listings, and ``requirements.lock`` fixes the version.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import typst

from harness.folder import write_files


@dataclass(frozen=True)
class Heading:
    """A heading in plain text; level 1 is a section."""

    text: str
    level: int = 1


@dataclass(frozen=True)
class Prose:
    """A paragraph of Typst markup; plain text goes through ``plain`` first."""

    markup: str


@dataclass(frozen=True)
class Bullets:
    """A list of paragraphs of Typst markup."""

    items: Sequence[str]


@dataclass(frozen=True)
class Picture:
    """A figure; caption and description are plain text."""

    svg: bytes
    caption: str
    alt: str


@dataclass(frozen=True)
class Sheet:
    """A table of plain text; the first ``left`` columns hold words, the others numbers."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str
    left: int = 1


@dataclass(frozen=True)
class Listing:
    """Text shown as it is, in fixed width."""

    text: str
    language: str = "text"


Block = Heading | Prose | Bullets | Picture | Sheet | Listing


@dataclass
class Document:
    """A report: its title and its blocks."""

    title: str
    blocks: list[Block] = field(default_factory=list)


def _string(text: str) -> str:
    """Write a Typst string literal."""
    escaped = str(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{escaped}"'


def plain(text: str) -> str:
    """Write plain text so that no character of it is taken for Typst markup."""
    return f"#{_string(text)};"


def strong(text: str) -> str:
    """Write plain text in bold."""
    return f"#strong({_string(text)});"


def _array(items: Sequence[str]) -> str:
    return "(" + "".join(f"{_string(item)}, " for item in items) + ")"


def _block(block: Block, files: dict[str, bytes]) -> str:
    match block:
        case Heading(text, level):
            return f"#heading(level: {level}, {_string(text)})"
        case Prose(markup):
            return markup
        case Bullets(items):
            return "\n".join("- " + item.replace("\n", " ") for item in items)
        case Picture(svg, caption, alt):
            name = f"figure-{len(files) + 1:02d}.svg"
            files[name] = svg
            floats = "false" if len(files) == 1 else "true"  # the first belongs to the answer above it
            return f"#picture({_string(name)}, {_string(caption)}, {_string(alt)}, floats: {floats})"
        case Sheet(header, rows, caption, left):
            body = "".join(f"\n  {_array(row)}," for row in rows)
            words = f"left: {left}, caption: {_string(caption)}, header: {_array(header)}"
            return f"#sheet({words}, rows: ({body}\n))"
        case Listing(text, language):
            return f"#raw(block: true, lang: {_string(language)}, {_string(text)})"
    raise TypeError(f"no layout for {type(block).__name__}")


def source(document: Document) -> tuple[str, dict[str, bytes]]:
    """Return the Typst text of a document and the figures it names."""
    files: dict[str, bytes] = {}
    parts = [
        '#import "template.typ": *',
        f"#show: report.with(title: {_string(document.title)})",
        *(_block(block, files) for block in document.blocks),
    ]
    return "\n\n".join(parts) + "\n", files


def render(document: Document) -> tuple[bytes, bytes]:
    """Return the document as self-contained HTML and as PDF; the same content always gives the same bytes."""
    text, files = source(document)
    here = Path(__file__).parent  # of the template and the style sheet
    fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    with tempfile.TemporaryDirectory(prefix="report-") as folder:
        root = Path(folder)
        (root / "report.typ").write_text(text, encoding="utf-8")
        (root / "template.typ").write_text((here / "template.typ").read_text(encoding="utf-8"), encoding="utf-8")
        for name, svg in files.items():
            (root / name).write_bytes(svg)
        compiler = typst.Compiler(root / "report.typ", root=root, font_paths=[fonts], ignore_system_fonts=True)
        # The warnings only repeat that HTML export is young.
        html, _ = compiler.compile_with_warnings(format="html", sys_inputs={"medium": "screen"})
        pdf, _ = compiler.compile_with_warnings(format="pdf", sys_inputs={"medium": "paper"}, timestamp=0)
    css = (here / "page.css").read_text(encoding="utf-8")
    assert isinstance(html, bytes)  # lists of pages are for images only
    assert isinstance(pdf, bytes)
    page = html.decode("utf-8")
    head, mark, rest = page.partition("</head>")
    if not mark:
        raise RuntimeError("typst wrote HTML without a head")
    return f"{head}<style>{css}</style>{mark}{rest}".encode(), pdf


def write(document: Document, directory: Path, stem: str = "report") -> list[Path]:
    """Write a document into a folder as HTML and PDF, each whole or not at all; return them in this order.

    Raises:
        UserError: If the folder cannot be written to.
    """
    html, pdf = render(document)
    return write_files(directory, {f"{stem}.html": html, f"{stem}.pdf": pdf})
