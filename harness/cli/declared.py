"""Commands whose arguments and options are the fields of a dataclass, each declared once for all commands."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


def takes(task: type[T]) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Give a command the fields of a dataclass as its parameters.

    A field ``Annotated[type, typer.Option(flags, help=...)] = default`` is one of them. A field whose type is a
    dataclass stands for the fields of that.

    Args:
        task: The dataclass.
    """

    def declared(command: Callable[[T], None]) -> Callable[..., None]:
        @functools.wraps(command)
        def called(**given: Any) -> None:
            command(made(task, given))

        required_first = sorted(_parameters(task), key=lambda p: p.default is not inspect.Parameter.empty)
        called.__signature__ = inspect.Signature(required_first)  # type: ignore[attr-defined]
        called.__annotations__ = {}
        return called

    return declared


def made(task: type[T], given: Mapping[str, Any]) -> T:
    """Return a task of values by the names of fields; what is not given keeps its default."""
    stated: dict[str, Any] = {}
    for field, hint in _fields(task):
        if isinstance(hint, type) and is_dataclass(hint):
            stated[field.name] = made(hint, given)
        elif field.name in given:
            stated[field.name] = given[field.name]
    return task(**stated)


def _fields(task: type) -> Iterator[tuple[Field[Any], Any]]:
    hints = get_type_hints(task, include_extras=True)
    return ((field, hints[field.name]) for field in fields(task))


def _parameters(task: type) -> Iterator[inspect.Parameter]:
    for field, hint in _fields(task):
        if isinstance(hint, type) and is_dataclass(hint):
            yield from _parameters(hint)
        else:
            default = inspect.Parameter.empty if field.default is MISSING else field.default
            if field.default_factory is not MISSING:
                default = field.default_factory()
            yield inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)
