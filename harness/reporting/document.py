"""One list of content blocks becomes one Typst text, and that becomes the HTML and the PDF.

Typst does both: the PDF is tagged and embeds its fonts, the HTML has headings, tables, MathML and the figures
as SVG inside the one file. Its HTML export is young, so the blocks use nothing but headings, paragraphs, lists,
figures, tables, formulas and listings, and ``requirements.lock`` fixes the version.

The page works without a server and loads nothing from elsewhere; without scripts it is what it is on paper. A content
security policy allows its own script and no other, so that no name in a study can become code.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
import tempfile
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import typst

from harness.common.failures import RAISED, Failures
from harness.common.files import write_files
from harness.reporting import pages


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
class Linked:
    """Plain text in a table that leads to another file, by its path from the report, or to an address."""

    text: str
    target: str


@dataclass(frozen=True)
class Sheet:
    """A table of plain text; the first ``left`` columns hold words, the others numbers."""

    header: Sequence[str]
    rows: Sequence[Sequence[str | Linked]]
    caption: str
    left: int = 1


@dataclass(frozen=True)
class Listing:
    """Text shown as it is, in fixed width."""

    text: str
    language: str = "text"


@dataclass(frozen=True)
class Section:
    """Blocks under a heading, made when the report is written; if that fails a sentence replaces them.

    Attributes:
        make: Returns the blocks, sections among them; where there are none there is no heading.
        title: The heading.
        headed: Whether it stands above the blocks; above a sentence in their place it always does.
    """

    make: Callable[[], Iterable[Block]]
    title: str
    headed: bool = True


@dataclass(frozen=True)
class Drawing:
    """A figure that is drawn when the report is written; if that fails a sentence replaces it.

    Attributes:
        draw: Returns the figure as SVG.
        caption: Plain text.
        alt: The figure described, in plain text; the sentence names the figure by it.
    """

    draw: Callable[[], bytes]
    caption: str
    alt: str


Block = Heading | Prose | Bullets | Picture | Sheet | Listing | Section | Drawing


@dataclass(frozen=True)
class Report:
    """A report on a result.

    Attributes:
        title: The question that it answers.
        sections: Its blocks, most of them sections, which are made when it is written.
    """

    title: str
    sections: Sequence[Block] = ()

    def write(self, directory: Path, stem: str = "report", failures: Failures | None = None) -> list[Path]:
        """Write the report into a folder as HTML and PDF, each whole or not at all; return them in this order.

        A section or a figure that fails leaves a sentence in the report, a warning on the console, and its traceback
        in ``errors.txt`` of the folder.

        Args:
            directory: Where to.
            stem: Of the names of the files.
            failures: Takes what cannot be made, where other parts of the same result were tried before.

        Raises:
            UserError: If the folder cannot be written to.
        """
        html, pdf = render(self, Failures(directory) if failures is None else failures)
        return write_files(directory, {f"{stem}.html": html, f"{stem}.pdf": pdf})


def made(blocks: Iterable[Block], failures: Failures = RAISED) -> list[Block]:
    """Return blocks with every section made and every figure drawn.

    Args:
        blocks: Of a report.
        failures: Takes what cannot be made; by default it is raised.
    """
    finished: list[Block] = []
    for block in blocks:
        match block:
            case Section():
                finished += _section(block, failures)
            case Drawing():
                finished.append(_picture(block, failures))
            case _:
                finished.append(block)
    return finished


def _section(section: Section, failures: Failures) -> list[Block]:
    def headed() -> list[Block]:
        blocks = made(section.make(), failures)
        return [Heading(section.title), *blocks] if blocks and section.headed else blocks

    return failures.attempt(
        f"the section “{section.title}”",
        headed,
        lambda why: [Heading(section.title), Prose(plain(f"This section could not be made: {why}."))],
    )


def _picture(drawing: Drawing, failures: Failures) -> Block:
    name = f"the figure “{drawing.alt.rstrip('.')}”"
    return failures.attempt(
        name,
        lambda: Picture(drawing.draw(), drawing.caption, drawing.alt),
        lambda why: Prose(plain(f"{name[:1].upper()}{name[1:]} could not be made: {why}.")),
    )


def _string(text: str) -> str:
    """Write a Typst string literal; what neither HTML nor UTF-8 can hold becomes the replacement character."""
    held = "".join(c if c in "\n\r\t" or unicodedata.category(c) not in ("Cc", "Cs") else "\ufffd" for c in str(text))
    escaped = held.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{escaped}"'


def plain(text: str) -> str:
    """Write plain text so that no character of it is taken for Typst markup."""
    return f"#{_string(text)};"


def strong(text: str) -> str:
    """Write plain text in bold."""
    return f"#strong({_string(text)});"


def _array(items: Sequence[str | Linked]) -> str:
    return "(" + "".join(f"{_cell(item)}, " for item in items) + ")"


def _cell(item: str | Linked) -> str:
    return f"link({_string(item.target)}, {_string(item.text)})" if isinstance(item, Linked) else _string(item)


def _block(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"#heading(level: {level}, {_string(text)})"
        case Prose(markup):
            return markup
        case Bullets(items):
            return "\n".join("- " + item.replace("\n", " ") for item in items)
        case Sheet(header, rows, caption, text_columns):
            body = "".join(f"\n  {_array(row)}," for row in rows)
            words = f"left: {text_columns}, caption: {_string(caption)}, header: {_array(header)}"
            return f"#sheet({words}, rows: ({body}\n))"
        case Listing(text, language):
            return f"#raw(block: true, lang: {_string(language)}, {_string(text)})"
    raise TypeError(f"no layout for {type(block).__name__}")


def source(report: Report) -> tuple[str, dict[str, bytes]]:
    """Return the Typst text of a report and the figures it names.

    A figure has with it the heading that it follows, and the text between the two: they stay on one page.
    """
    files: dict[str, bytes] = {}
    parts = ['#import "template.typ": *', f"#show: report.with(title: {_string(report.title)})"]
    head: list[str] = []
    blocks = made(report.sections)
    for i, block in enumerate(blocks):
        if isinstance(block, Picture):
            number = len(files) + 1
            name = f"figure-{number:02d}.svg"
            files[name] = block.svg
            words = ", ".join(map(_string, (name, block.caption, block.alt)))
            filled = "true" if not head or _goes_on(blocks[i + 1 :]) else "false"
            before = f"[\n{_joined(head)}\n]" if head else ""
            parts.append(f"#picture({number}, {words}, filled: {filled}){before}")
            head = []
        elif isinstance(block, Heading) or (head and isinstance(block, (Prose, Bullets))):
            head.append(_block(block))
        else:
            parts += [*head, _block(block)]
            head = []
    return _joined([*parts, *head]) + "\n", files


def _goes_on(blocks: Sequence[Block]) -> bool:
    """Return whether a section has text or tables behind a figure, which can fill the page that the figure leaves."""
    following = next((b for b in blocks if not isinstance(b, Picture)), None)
    return not isinstance(following, Heading | None)


def _joined(parts: Sequence[str]) -> str:
    return "\n\n".join(parts)


def render(report: Report, failures: Failures = RAISED) -> tuple[bytes, bytes]:
    """Return the report as self-contained HTML and as PDF; the same content always gives the same bytes.

    Args:
        report: The report.
        failures: Takes what cannot be made or laid out; by default it is raised.
    """
    whole = Report(report.title, made(report.sections, failures))
    return failures.attempt(
        "the report in one piece",
        lambda: _compiled(whole),
        lambda _: _compiled(Report(whole.title, [_laid_out(block, whole.title, failures) for block in whole.sections])),
    )


def _laid_out(block: Block, title: str, failures: Failures) -> Block:
    """Return a block that can be laid out, or a sentence in its place."""

    def tried() -> Block:
        _compiled(Report(title, [block]))
        return block

    return failures.attempt(
        f"a {type(block).__name__.lower()} of the report",
        tried,
        lambda why: Prose(plain(f"This part of the report could not be laid out: {why}.")),
    )


def _compiled(report: Report) -> tuple[bytes, bytes]:
    text, files = source(report)
    here = Path(__file__).parent  # of the template and the style sheet
    fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    with tempfile.TemporaryDirectory(prefix="report-") as folder:
        root = Path(folder)
        write_files(root, {"report.typ": text, "template.typ": (here / "template.typ").read_bytes(), **files})
        for_screen, for_paper = (
            typst.Compiler(
                root / "report.typ",
                root=root,
                font_paths=[fonts],
                ignore_system_fonts=True,
                sys_inputs={"medium": medium},
            )
            for medium in ("screen", "paper")
        )
        # The warnings only repeat that HTML export is young.
        html, _ = for_screen.compile_with_warnings(format="html")
        pages.lay_out(for_paper, root)
        pdf, _ = for_paper.compile_with_warnings(format="pdf", timestamp=0)
    assert isinstance(html, bytes)  # lists of pages are for images only
    assert isinstance(pdf, bytes)
    return page(html.decode("utf-8")), pdf


_IMAGE = re.compile(r'<img src="data:image/svg\+xml;base64,([^"]+)" alt="([^"]*)"[^>]*>')
_HEAD = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>|<style[^>]*>.*?</style>", re.DOTALL)
_SIZE = re.compile(r'(<svg [^>]*?)width="[^"]*" height="[^"]*" ')
_NEEDED = re.compile(r'(?:href="#|url\(#)([^")]+)')


def page(text: str) -> bytes:
    """Return the HTML of a report that typst wrote with its style, its script and its figures in place.

    Args:
        text: From typst.
    """
    here = Path(__file__).parent
    css = "".join((here / name).read_text(encoding="utf-8") for name in ("page.css", "rolled.css"))
    scripts = [(here / name).read_text(encoding="utf-8") for name in ("tables.js", "axes.js", "page.js")]
    script = '"use strict";\n' + "".join(scripts)
    head, mark, rest = text.partition("</head>")
    if not mark:
        raise RuntimeError("typst wrote HTML without a head")
    body, end, rest = rest.rpartition("</body>")
    number = 0

    def drawn(match: re.Match[str]) -> str:
        nonlocal number
        number += 1
        return _inline(base64.b64decode(match[1]).decode("utf-8"), html.unescape(match[2]), f"f{number}-")

    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{allowed}'"
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    whole = f"{head}{meta}<style>{css}</style>{mark}{_IMAGE.sub(drawn, body)}<script>{script}</script>{end}{rest}"
    return whole.encode()


def _inline(svg: str, alt: str, prefix: str) -> str:
    """Return a figure as an element of the page: what it names is named apart from what other figures name."""
    svg = _SIZE.sub(r"\1", _HEAD.sub("", svg), count=1)
    needed = set(_NEEDED.findall(svg))
    svg = re.sub(r' id="([^"]*)"', lambda m: f' id="{prefix}{m[1]}"' if m[1] in needed else "", svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}", svg)
    return svg.strip().replace("<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" ', 1)
