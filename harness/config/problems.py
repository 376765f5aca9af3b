"""Collect everything wrong with a file before stopping, each with file, key and remedy."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from harness.common.errors import ModelError, UserError
from harness.common.registry import closest

_Table = TypeVar("_Table", bound=BaseModel)

TEXT, TABLE, LIST = FORMS = "(text)", "(table)", "(list)"
"""Tags of the forms of a key that takes more than one; pydantic puts them in the place of an error."""


class Problems:
    """The problems of one study; raised together as one ``UserError``.

    Args:
        file: Named in every message.
        root: Key path that messages leave out, of what stands alone and not in a list of a file.
    """

    def __init__(self, file: str, root: str = "") -> None:
        self.file, self._root = file, root
        self._lines: list[str] = []

    def for_file(self, file: str) -> Problems:
        """Return a collector for another file that belongs to the study; both are raised together."""
        other = Problems(file)
        other._lines = self._lines
        return other

    def __len__(self) -> int:
        return len(self._lines)

    def at(self, key: str) -> str:
        """Return ``file: key``, the place as errors name it."""
        key = key.removeprefix(self._root).removeprefix(".") if self._root else key
        return f"{self.file}: {key}" if key else self.file

    def add(self, key: str, message: str) -> None:
        """Note a problem at a key path such as ``design[0].factor[0].levels[2]``."""
        self._note(f"{self.at(key)}: {message}")

    def _note(self, line: str) -> None:
        if line not in self._lines:
            self._lines.append(line)

    @contextmanager
    def catch(self, key: str) -> Iterator[None]:
        """Turn an error of a model or a unit into a problem at this key and go on."""
        try:
            yield
        except (ModelError, UserError) as error:
            text = str(error)
            if text.startswith(f"{self.file}: "):
                self._note(text)
            else:
                self.add(key, text)

    def stop(self) -> None:
        """Raise what was collected, if anything was.

        Raises:
            UserError: One line per problem, each with file and key.
        """
        if self._lines:
            raise UserError("\n".join(self._lines))


def key_path(location: Sequence[str | int]) -> str:
    """Write a location as in a study: ``("design", 0, "factor")`` is ``design[0].factor``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def validated(content: Any, table: type[_Table], problems: Problems, prefix: str = "") -> _Table | None:
    """Return content as a table, or ``None`` where something is wrong with it, which is noted.

    Args:
        content: Keys and values as in a file.
        table: The model of it.
        problems: Where problems are noted.
        prefix: Key path of the table.
    """
    try:
        return table.model_validate(content)
    except ValidationError as error:
        _add_validation_errors(problems, error, table, prefix)
        return None


def _add_validation_errors(
    problems: Problems, error: ValidationError, table: type[BaseModel], prefix: str = ""
) -> None:
    """Note every error that pydantic found, in words that say how to mend it.

    Args:
        problems: Where to note them.
        error: What pydantic raised.
        table: The model that was validated, to suggest its keys.
        prefix: Key path of the validated table.
    """
    for item in error.errors():
        location = [part for part in item["loc"] if part not in FORMS]
        place = key_path([*([prefix] if prefix else []), *location])
        if item["type"] == "extra_forbidden":
            keys = keys_at(table, location[:-1])
            problems.add(place, f"unknown key '{location[-1]}'{closest(str(location[-1]), keys)}")
        elif item["type"] == "missing":
            problems.add(place, f"this key is required; add '{location[-1]}'")
        elif item["type"] == "too_short":
            least, there = item["ctx"]["min_length"], item["ctx"]["actual_length"]
            problems.add(place, f"{'is empty' if not there else f'has {there}'}; give at least {least}")
        elif item["type"] in ("model_type", "dict_type"):
            keys = keys_at(table, location)
            which = f" with {', '.join(keys)}" if keys else ""
            problems.add(place, f"expected a table{which}, got {item['input']!r}")
        elif item["type"] == "string_pattern_mismatch":  # the one pattern there is: names that become files
            problems.add(place, f"{item['input']!r} cannot be the name of a file; use letters, digits, '-', '_', '.'")
        else:
            message = item["msg"].removeprefix("Value error, ")
            given = item["input"]
            shown = "" if isinstance(given, dict | list) or repr(given) in message else f", got {given!r}"
            problems.add(place, f"{message[:1].lower()}{message[1:]}{shown}")


def keys_at(table: type[BaseModel], location: Sequence[str | int]) -> list[str]:
    """Return the keys allowed at a location inside a table."""
    current: type[BaseModel] | None = table
    for part in location:
        if isinstance(part, int) or current is None:
            continue
        info = current.model_fields.get(part)
        current = None if info is None else _table_in(info.annotation)
    return [] if current is None else sorted(current.model_fields)


def _table_in(annotation: object) -> type[BaseModel] | None:
    """Find the pydantic model inside ``list[X]``, ``X | None`` and the like."""
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((t for t in map(_table_in, typing.get_args(annotation)) if t is not None), None)
