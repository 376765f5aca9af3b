"""What the documentation names exists: files, modules and names in them, commands with options, targets, links."""

import ast
import functools
import importlib
import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from harness.cli.main import app
from harness.common import components, locations
from harness.models.roles import DEGRADATIONS, EFFECTS

ROOT = Path(__file__).parents[1]
TOPS = ("harness", "models", "reproductions", "tests", "bench", "docs", "studies")
PAGES = ["README.md", "CHANGELOG.md", "results/README.md", "tests/blind/README.md"]
PAGES += sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md"))
READERS_OWN = {
    *("studies/slippery-road.toml", "studies/tuned/mass.toml", "studies/x.toml"),
    *("studies/worn-tag.toml", "tests/test_truck.py"),  # of the example in docs/plugins.md
}
"""Files that a page tells its reader to write, or that stand for any."""

NO_MODULES = {locations.MARK, *(f"harness.{word}" for word in components.WORDS)}
"""A file and groups of entry points that are written like modules."""

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SPAN = re.compile(r"`([^`]+)`")
FILE = re.compile(rf"(?<![\w./-])(?:{'|'.join(TOPS)})/[\w./<>*-]*")
BARE_FILE = re.compile(r"(?<![\w./>*-])\w+\.(?:py|typ|css)")
MODULE = re.compile(r"(?<![\w./-])(?:harness|bench|reproductions)(?:\.\w+)+")
NAME = re.compile(r"(?:\w+\.)*([A-Za-z_]\w*)\(.*\)|(?:\w+\.)*([A-Z]\w*[a-z]\w*)", re.DOTALL)
WIDTH = 120
"""Columns of a line of prose; the linter sees those of code alone. Tables, pictures and formulas are not folded."""

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def wrong(page: str, text: str) -> list[str]:
    """Return what a page names that does not exist."""
    blocks = FENCE.findall(text)
    spans = [" ".join(span.split()) for span in SPAN.findall(FENCE.sub("", text))]
    code = [body for _, body in blocks] + spans
    lines = [line for _, body in blocks for line in body.replace("\\\n", " ").splitlines()] + spans
    return [
        *(f"{name}: no such file" for part in code for name in FILE.findall(part) if not _file_exists(name)),
        *(f"{name}: no such file" for span in spans for name in BARE_FILE.findall(span) if name not in _file_names()),
        *(
            f"{name}: no such module or name"
            for part in code
            for name in MODULE.findall(part)
            if name not in NO_MODULES and not _is_there(name)
        ),
        *(f"{name}: nowhere in the code" for span in spans for name in _names(span) if name not in _words()),
        *(problem for language, body in blocks if language == "python" for problem in _imports(body)),
        *(problem for line in lines for problem in [*_command(line), *_target(line)]),
        *(f"{link}: leads nowhere" for link in LINK.findall(FENCE.sub("", text)) if not _leads(page, link)),
    ]


def _file_exists(name: str) -> bool:
    name = name.rstrip(".")
    pattern = re.sub(r"<\w+>", "*", name).strip("/")
    return name in READERS_OWN or any(ROOT.glob(pattern))


@functools.cache
def _file_names() -> set[str]:
    return {p.name for top in TOPS for p in (ROOT / top).rglob("*.*")}


def _is_there(name: str) -> bool:
    """Return whether a dotted name is a module, or stands in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.util.find_spec(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        if found is None:
            continue
        if n == len(parts):
            return True
        thing: object = importlib.import_module(".".join(parts[:n]))
        return functools.reduce(lambda held, part: getattr(held, part, None), parts[n:], thing) is not None
    return False


@functools.cache
def _words() -> set[str]:
    files = (p for top in TOPS for p in (ROOT / top).rglob("*.py") if p != Path(__file__))
    texts = (p.read_text(encoding="utf-8") for p in files)
    return {word for text in texts for word in re.findall(r"\w+", text)}


def _names(span: str) -> Iterator[str]:
    found = NAME.fullmatch(span)
    if found:
        yield found[1] or found[2]


def _imports(block: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom):
            lacking = (alias.name for alias in node.names if not _is_there(f"{node.module}.{alias.name}"))
            yield from (f"from {node.module} import {name}: no such name" for name in lacking)


@functools.cache
def _commands() -> dict[str, set[str]]:
    """Return the commands with their options."""
    group = typer.main.get_command(app)
    return {name: {o for p in c.params for o in p.opts} for name, c in group.commands.items()}


def _command(line: str) -> Iterator[str]:
    """Return what is wrong with a line that calls the command line, or with an option that stands alone."""
    if not line.startswith(("harness ", "--")):
        return
    words = [w for w in shlex.split(line, comments=True) if w not in ("[", "]", "...")]
    options = {w.partition("=")[0] for w in words if w.startswith("--")} - {"--help", "--debug"}
    if line.startswith("--"):
        known = {o for there in _commands().values() for o in there} | _quoted_options()
    elif words[1].startswith("--"):
        known = {o for p in typer.main.get_command(app).params for o in p.opts}
    elif words[1] not in _commands():
        yield f"harness {words[1]}: no such command"
        return
    else:
        known = _commands()[words[1]]
    yield from (f"{option}: no such option in “{line}”" for option in sorted(options - known))


@functools.cache
def _quoted_options() -> set[str]:
    """Return the options of programs beside the commands."""
    texts = (p.read_text(encoding="utf-8") for top in ("harness", "bench") for p in (ROOT / top).rglob("*.py"))
    return {option for text in texts for option in re.findall(r'"(--[a-z-]+)"', text)}


def _target(line: str) -> Iterator[str]:
    """Return what is wrong with a target of make."""
    found = re.match(r"make ([\w-]+)(?![\w<-])", line)
    if found and found[1] not in _targets() and f"studies/{found[1].removeprefix('study-')}.toml" not in READERS_OWN:
        yield f"make {found[1]}: no such target"


@functools.cache
def _targets() -> set[str]:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    kinds = {"study-": "studies", "loop-": "studies/loops", "study-identify-": "studies/identify"}
    files = {f"{kind}{p.stem}" for kind, folder in kinds.items() for p in (ROOT / folder).glob("*.toml")}
    return {*re.findall(r"^([\w-]+):", makefile, re.MULTILINE), *files}


def _leads(page: str, link: str) -> bool:
    """Return whether a link leads to a file, and to a heading in it."""
    if link.startswith(("https:", "http:")):
        return True
    name, _, anchor = link.partition("#")
    there = (ROOT / page).parent / name if name else ROOT / page
    if not there.exists():
        return False
    return not anchor or anchor in _anchors(there)


def _anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_names_exists(page):
    assert wrong(page, (ROOT / page).read_text(encoding="utf-8")) == []


def too_long(text: str) -> list[str]:
    """Return the lines of prose of a page that are too long."""
    lines = FENCE.sub("", text).splitlines()
    return [line for line in lines if len(line) > WIDTH and not line.lstrip().startswith(("|", "![", "$$"))]


@pytest.mark.parametrize("page", PAGES)
def test_no_line_of_prose_is_too_long(page):
    assert too_long((ROOT / page).read_text(encoding="utf-8")) == []


def test_a_line_that_is_too_long_is_found():
    row, prose, code = "| " + "w " * 60, "w " * 61, "```sh\n" + "w " * 61 + "\n```"
    assert too_long("\n".join([row, prose, code, prose[:WIDTH]])) == [prose]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("see `harness/study/no_such.py`", "harness/study/no_such.py: no such file"),
        ("see `no_such.py`", "no_such.py: no such file"),
        ("files `models/no_such/<kind>.py`", "models/no_such/<kind>.py: no such file"),
        ("`harness.study.no_such`", "harness.study.no_such: no such module or name"),
        ("`harness.config.no_such`", "harness.config.no_such: no such module or name"),
        ("```\npython -m harness.no_such --out x\n```", "harness.no_such: no such module or name"),
        ("`no_such_function(x, y)`", "no_such_function: nowhere in the code"),
        ("a `NoSuchClass`", "NoSuchClass: nowhere in the code"),
        ("```python\nfrom harness.config import nope\n```", "from harness.config import nope: no such name"),
        ("`harness nosuch FILE`", "harness nosuch: no such command"),
        (
            "```sh\nharness run x \\\n  --nosuch 3  # so\n```",
            "--nosuch: no such option in “harness run x    --nosuch 3  # so”",
        ),
        ("`--no-such`", "--no-such: no such option in “--no-such”"),
        ("```sh\nmake study-no-such\n```", "make study-no-such: no such target"),
        ("[page](docs/no_such.md)", "docs/no_such.md: leads nowhere"),
        ("[part](docs/studies.md#no-such)", "docs/studies.md#no-such: leads nowhere"),
    ],
)
def test_what_does_not_exist_is_found(text, problem):
    assert problem in wrong("README.md", text)


def test_what_exists_is_passed_over():
    text = "`harness/study/run.py`, `harness.config.load_study`, `harness run x -j 2`, [keys](docs/studies.md#keys)"
    assert wrong("README.md", text) == []


def test_the_table_of_effects_lists_each_of_them_once():
    page = (ROOT / "docs/effects.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| [^|`]+ \| (`.*`) \|$", page, re.MULTILINE)
    listed = sorted(name for row in rows for name in SPAN.findall(row))
    assert listed == sorted([*EFFECTS.names(), *DEGRADATIONS.names()])
