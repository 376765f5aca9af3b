"""Files: results written into a folder, JSON written, TOML read and written."""

from __future__ import annotations

import codecs
import functools
import gc
import json
import math
import re
import sys
import tomllib
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unicodedata import category

from harness.common import places
from harness.common.errors import MissingFileError, UserError, closest

BUNDLED_STUDIES = Path(__file__).parents[1] / "config" / "studies"
"""Studies of the package with their drives and channel maps: a link in the checkout, a folder in a wheel."""

LIMITED = [True]
"""Whether tables larger than any recording are refused, see ``refuse_beyond``."""

LARGEST_TEXT = 4 * 2**20
"""Bytes of a text file that is read; what is larger is a recording, or a mistake."""
_LARGEST_RESULT = 64 * 2**20
"""The same of ``.json``: a trace holds matrices of all parameters of each model at each level of the noise."""
_MOST_KEYS = 50_000
"""Keys and tables of a TOML text."""
_DEEPEST = 32
"""Parts of a dotted key, of which tomllib takes memory by the square."""
_TOO_DEEP = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_DEEPEST}}}""", re.ASCII)


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files into a folder, made if absent, each whole or not at all; return their paths.

    Args:
        folder: Where to.
        contents: Text or bytes by file name.

    Raises:
        UserError: If the folder cannot be written to, or a pipe or a device is in the place of a file.
    """
    written, path = [], folder
    refuse_url(folder)
    try:
        if places.is_url(folder):
            for name, content in contents.items():
                places.write(folder / name, _as_bytes(content))
            return [folder / name for name in contents]
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            path = folder / name
            refuse_special(path)
            # one name, so that a process that is killed leaves one at most
            with places.unfinished(path, f"{name}.part") as stream:
                stream.write(_as_bytes(content))
            written.append(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None
    return written


def _as_bytes(content: str | bytes) -> bytes:
    """Return what is written; of a file name that is no UTF-8 the letters that are none become ``?``."""
    return content.encode("utf-8", errors="replace") if isinstance(content, str) else content


def refuse_special(file: Path) -> None:
    """Refuse what is no file: a pipe gives nothing and takes none, some devices give without end.

    Raises:
        UserError: If it is a pipe, a device or a link to one.
    """
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise UserError(f"{file}: is no file but a pipe or a device; name a file")


def refuse_url(place: Path) -> None:
    """Refuse a URL that was taken for a path, which would be a folder ``s3:`` here.

    Raises:
        UserError: If the place is one.
    """
    if places.is_url(place):
        return
    scheme, colon, _ = place.as_posix().partition(":/")
    if colon and len(scheme) > 1 and "/" not in scheme:  # a single letter is a drive of Windows
        raise UserError(
            f"{scheme}://...: of the commands only run, report, status and verify take a URL (docs/cluster.md); give a "
            "folder, and copy it there"
        )


def renewed(page: str, content: str, begin: str, end: str) -> str:
    """Return a page with other content between two marks, each on a line of its own.

    Raises:
        UserError: If a mark is missing.
    """
    before, first, rest = page.partition(begin)
    _, last, after = rest.partition(end)
    if not first or not last:
        raise UserError(
            f"the page needs marks: put {begin} and {end} on lines of their own around what is to be written"
        )
    return f"{before}{begin}\n\n{content.strip()}\n\n{end}{after}"


def json_text(content: Any) -> str:
    """Return JSON text of dictionaries, sequences and plain or NumPy scalars; what is not finite becomes ``null``.

    A list of numbers is one line: a matrix with a line for each of its numbers would be mostly spaces.
    """
    text = json.dumps(_plain(content), indent=2)
    return re.sub(r'\[\n[^][{}"]*\]', _on_one_line, text) + "\n"


def _on_one_line(match: re.Match[str]) -> str:
    return f"[{', '.join(match[0][1:-1].replace(',', ' ').split())}]"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):  # a NumPy scalar; NumPy itself would slow the help
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_text(path: Path) -> str:
    """Return the text of a file, without a byte-order mark.

    Raises:
        UserError: If ``read_content`` refuses the file, or it is not UTF-8.
    """
    try:
        return with_unix_lines(read_content(path).decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        what = wide_text(error.object) or f"not UTF-8 text (byte {error.start})"
        raise UserError(f"{path}: is {what}; save the file as UTF-8") from None


def with_unix_lines(text: str) -> str:
    """Return a text whose lines end in a line feed alone."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_content(path: Path) -> bytes:
    """Return the bytes of a small file.

    Raises:
        UserError: If it is absent (with the closest names next to it), no plain file, larger than ``LARGEST_TEXT`` (a
            result in JSON may be larger), or cannot be read.
    """
    refuse_special(path)
    largest = _LARGEST_RESULT if path.suffix == ".json" else LARGEST_TEXT
    try:
        with path.open("rb") as file:
            content = file.read(largest + 1)
        if len(content) > largest:
            raise UserError(f"{path}: is larger than {largest / 2**20:g} MiB, which no text file of a study is")
        return content
    except FileNotFoundError:
        names = sorted(p.name for p in path.parent.glob(f"*{path.suffix}")) if path.parent.is_dir() else []
        raise MissingFileError(f"{path}: there is no such file{closest(path.name, names)}") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None


def refuse_beyond(path: str, what: str, size: int, most: int, unit: str) -> None:
    """Refuse what is larger than any recording has it, before the memory is filled.

    Raises:
        UserError: If it is, unless ``LIMITED`` says otherwise.
    """
    if size > most and LIMITED[0]:
        raise UserError(
            f"{path}: {what} has {size:,} {unit} or more, at most {most:,} are read; if it is a recording, "
            "add --no-limits"
        )


def wide_text(head: bytes) -> str:
    """Return ``UTF-16 text`` or ``UTF-32 text`` where bytes begin with its mark, as editors save it; else nothing."""
    marks = {codecs.BOM_UTF32_LE: 32, codecs.BOM_UTF32_BE: 32, codecs.BOM_UTF16_LE: 16, codecs.BOM_UTF16_BE: 16}
    return next((f"UTF-{bits} text" for mark, bits in marks.items() if head.startswith(mark)), "")


def json_table(path: Path, remedy: str, check: Callable[[dict[str, Any]], str | None]) -> dict[str, Any]:
    """Return the table in a JSON file that this program wrote; an empty one where there is no such file.

    Args:
        path: The file.
        remedy: What to do where it is damaged.
        check: Returns what is wrong with the table in words, or ``None``.

    Raises:
        UserError: If the file is damaged.
    """
    if not path.is_file():
        return {}
    with refuse_damaged(path, "JSON text", remedy):
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"holds a {type(content).__name__} in place of a table")
        if (wrong := check(content)) is not None:
            raise ValueError(wrong)
        return content


@contextmanager
def refuse_damaged(path: str | Path, what: str, remedy: str = "export it again") -> Iterator[None]:
    """Refuse a file that the library of its format cannot read, whatever that library raises then.

    Libraries check a file by reading it: damaged bytes end in errors of every kind, which are the file's fault.

    Args:
        path: The file.
        what: What it should be, such as ``MATLAB file``.
        remedy: What to do then.

    Raises:
        UserError: If it cannot be read.
    """
    try:
        yield
    except UserError:
        raise
    except MemoryError:
        raise UserError(f"{path}: is damaged, or needs more memory than there is; {remedy}") from None
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise  # the file itself: no permission, vanished
        _let_go(error)
        said = " ".join(str(error).split())[:200]
        reason = f": {said}" if said else ""
        raise UserError(f"{path}: is damaged or no {what}{reason}; {remedy}") from error


def _let_go(error: Exception) -> None:
    """Free what a library has half made, while its files are there, and drop what its finalisers say."""
    said, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = said


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Args:
        text: The text.
        where: File, named in the error.

    Raises:
        UserError: If it is no TOML, has more than 50,000 keys and tables or keys of more than 32 parts, or a text in it
            holds a control character.
    """
    if (keys := text.count("=") + text.count("\n[")) > _MOST_KEYS:  # before tomllib takes a kilobyte for each
        raise UserError(f"{where}: has {keys:,} keys and tables, at most {_MOST_KEYS:,} are read; divide it")
    if match := _TOO_DEEP.search(text):
        line = text.count("\n", 0, match.start()) + 1
        raise UserError(f"{where}: line {line}: a key has more than {_DEEPEST} parts; no table here is so deep")
    try:
        content = tomllib.loads(text)
        refuse_control_characters(content, where)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{where}: not valid TOML: {error}") from None
    except RecursionError:
        raise UserError(f"{where}: not valid TOML: nested too deeply") from None
    except UserError:
        raise
    except ValueError as error:  # dates and integers that Python has no number for
        raise UserError(f"{where}: not valid TOML: {error}") from None
    return content


def refuse_control_characters(content: Any, where: str, key: str = "") -> None:
    """Refuse texts, keys among them, that no report, file name or store can hold.

    Args:
        content: What a file holds: tables, lists, texts, numbers.
        where: File, named in the error.
        key: Of the content within the file.

    Raises:
        UserError: If there is one, with its place.
    """
    if isinstance(content, str):
        at = next((i for i, c in enumerate(content) if c not in "\n\r\t" and category(c) in ("Cc", "Cs")), None)
        if at is not None:
            what = f"the control character U+{ord(content[at]):04X} as its character {at + 1}"
            raise UserError(f"{where}: {f'{key}: ' if key else ''}holds {what}; remove it")
    elif isinstance(content, Mapping):
        for name, value in content.items():
            refuse_control_characters(name, where, f"{key}.{name!r}" if key else repr(name))
            refuse_control_characters(value, where, f"{key}.{name}" if key else name)
    elif isinstance(content, list | tuple):
        for i, value in enumerate(content):
            refuse_control_characters(value, where, f"{key}[{i}]")


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        UserError: If it cannot be read or is no TOML.
    """
    return parse_toml(read_text(path), str(path))


def toml_text(
    content: Mapping[str, Any], heading: str = "", comments: Mapping[tuple[str, ...], str] | None = None
) -> str:
    """Return the text of a TOML file.

    Args:
        content: What ``read_toml`` returns of it: tables, lists, text, numbers, truth values. Floats keep their bits.
        heading: Comment on the first line.
        comments: What stands behind a value or the head of a table, by its keys from the outside in.
    """
    import tomlkit  # not when the help is shown

    document = tomlkit.document()
    if heading:
        document.add(tomlkit.comment(heading))
    for key, value in content.items():
        document.add(key, tomlkit.item(value))
    for keys, words in (comments or {}).items():
        item: Any = functools.reduce(lambda table, key: table[key], keys, document)
        item.comment(words)
    return tomlkit.dumps(document)
