"""What tells a stored result from the one that a study would give now, in words."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config import StudySpec

_SHOWN = 5
"""Differences that a message lists; of the others it tells how many there are."""

_ABSENT = object()


def differences(stored: Mapping[str, Any], now: Mapping[str, Any], study: StudySpec) -> str:
    """Return how a stored result differs from what a study would give, as a predicate; empty if it does not.

    Args:
        stored: Attributes of the root of the store.
        now: What they would be now.
        study: The study.
    """
    if stored.get("study_name") != study.name:
        return f"holds the result of study '{stored.get('study_name')}', not of '{study.name}'"
    if stored.get("study_hash") != study.hash:
        return f"holds the result of another study called '{study.name}': {_of_texts(stored.get('study'), study.text)}"
    causes = []
    if stored.get("versions") != now["versions"]:
        here, there = _decoded(now["versions"]), _decoded(stored.get("versions"))
        causes.append(f"with other package versions or on another device ({_listed(_of_values(there, here))})")
    if stored.get("engine") != now["engine"]:
        commits = f"{_short(stored.get('commit'))} there, {_short(now['commit'])} here"
        causes.append(f"by other code of this project or of a component from outside (commit {commits})")
    return f"was computed {' and '.join(causes)}" if causes else ""


def _of_texts(there: Any, here: str) -> str:
    try:
        changed = list(_of_values(parse_toml(str(there), "there"), parse_toml(here, "here")))
    except UserError:
        return "its stored text cannot be read"
    return _listed(iter(changed)) or (
        "the texts agree, so that a file differs that it names: drives, parameters, tuning, a recording or the plant"
    )


def _of_values(there: Any, here: Any, key: str = "") -> Iterator[str]:
    """Go through what differs in two nested values."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for name in dict.fromkeys([*there, *here]):
            below = f"{key}.{name}" if key else str(name)
            if not key and name in ("title", "limits"):  # they decide no score
                continue
            yield from _of_values(there.get(name, _ABSENT), here.get(name, _ABSENT), below)
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for i, pair in enumerate(zip(there, here, strict=True)):
            yield from _of_values(*pair, f"{key}[{i}]")
    elif there != here:
        yield f"{key} {_written(there)} there, {_written(here)} here"


def _listed(changed: Iterator[str]) -> str:
    every = list(changed)
    more = len(every) - _SHOWN
    return "; ".join(every[:_SHOWN]) + (f"; and {more} more" if more > 0 else "")


def _written(value: Any) -> str:
    if value is _ABSENT:
        return "absent"
    text = value if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _decoded(versions: Any) -> dict[str, Any]:
    try:
        return dict(json.loads(versions))
    except (TypeError, ValueError):
        return {}


def _short(commit: Any) -> str:
    first, _, rest = str(commit).partition(" ")
    return f"{first[:10]} {rest}".strip()
