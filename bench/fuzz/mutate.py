"""Mutations of good files, drawn by hypothesis: values and keys of tables, and bytes."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

TEXTS = (
    "", " ", "nan", "inf", "-inf", "1e999", "-1", "0", "1_0", "1,5 m/s", "1.000,5", "24 t", "-24 t", "0 t", "1e30 t",
    "5 %", "-5 %", "±5 %", "300 %", "8 banana", "9**9**9 m", "1 m**99999", "__import__('os').system('x')", "10 ms",
    "\ufeff", "é", "𝟙𝟚", "١٢", "½", "∞", "..", "/", "/etc/passwd", "../../x", "C:\\x", "~", "a" * 300, "{}", "[]", "#",
    "<script>alert(1)</script>", '#read("/etc/passwd")', "$x$", "\\", '"', "'", "\n", "\t", "true", "null", "%s", "{0}",
    "semitrailer", "car", "ekf", "time", "speed", "trailer_mass", "yaw_rate", "steering_wheel_angle", "from_file",
)  # fmt: skip
NUMBERS = (
    0,
    -1,
    1,
    2,
    3,
    7,
    64,
    2**31,
    2**63 - 1,
    -(2**63),
    10**9,
    10**18,
    10**30,
    5e-324,
    0.0,
    -0.0,
    0.01,
    1e-300,
    1e300,
    -1e300,
    1e-9,
)

texts = st.one_of(st.sampled_from(TEXTS), st.text(max_size=12))
numbers = st.one_of(
    st.sampled_from(NUMBERS), st.integers(-(10**6), 10**6), st.floats(allow_nan=True, allow_infinity=True)
)
values = st.recursive(
    st.one_of(texts, numbers, st.booleans()),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(texts, inner, max_size=3)),
    max_leaves=5,
)


@st.composite
def large(draw: st.DrawFn) -> bytes:
    """Return TOML that asks for much memory in few bytes: many keys, parts of a key, tables, levels of nesting."""
    count = draw(st.sampled_from((10, 31, 100, 5000, 60_000)))
    part = draw(st.sampled_from(("a", '"a b"', "'x'")))
    forms = (
        ".".join([part] * count) + " = 1",
        "[" + " . ".join([part] * count) + "]",
        "".join(f"k{i} = 1\n" for i in range(count)),
        "[[design]]\n" * count,
        "a = " + "[" * count + "]" * count,
        "a = " + "{ b.c = " * count + "1" + " }" * count,
        f"levels = {list(range(count))}",
        "# " + "x" * 100 * count,
    )
    return draw(st.sampled_from(forms)).encode()


def places(table: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every entry of nested tables and lists."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        yield (*before, key)
        if isinstance(value, dict | list):
            yield from places(value, (*before, key))


def _inner(table: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        table = table[key]
    return table


@st.composite
def changed(draw: st.DrawFn, base: dict[str, Any]) -> dict[str, Any]:
    """Return a table with one to three entries replaced, removed, renamed, repeated or taken from elsewhere."""
    table = copy.deepcopy(base)
    for _ in range(draw(st.integers(1, 3))):
        paths = list(places(table))
        if not paths:
            break
        *above, key = draw(st.sampled_from(paths))
        holder = _inner(table, tuple(above))
        match draw(st.sampled_from(("replace", "replace", "replace", "remove", "rename", "repeat", "move"))):
            case "replace":
                holder[key] = draw(values)
            case "remove":
                del holder[key]
            case "rename" if isinstance(holder, dict):
                holder[draw(texts)] = holder.pop(key)
            case "repeat" if isinstance(holder, list):
                holder.append(copy.deepcopy(holder[key]))
            case _:
                holder[key] = copy.deepcopy(_inner(table, draw(st.sampled_from(paths))))
    return table


def toml(value: Any) -> str:
    """Write a table as TOML, tables within it inline."""
    return "\n".join(f"{_key(k)} = {_inline(v)}" for k, v in value.items()) + "\n"


def _key(key: Any) -> str:
    return json.dumps(str(key), ensure_ascii=True)


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return '"' + "".join(c if " " <= c < "\x7f" and c not in '"\\' else f"\\U{ord(c):08x}" for c in value) + '"'
    return json.dumps(value)


@st.composite
def damaged(draw: st.DrawFn, base: bytes) -> bytes:
    """Return bytes of which some are overwritten, cut out, repeated or put in."""
    content = bytearray(base)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        match draw(st.sampled_from(("flip", "word", "cut", "drop", "insert", "repeat", "zero"))):
            case "flip" if content:
                content[at] ^= 1 << draw(st.integers(0, 7))
            case "word":
                size = draw(st.sampled_from((1, 2, 4, 8)))
                word = draw(st.sampled_from((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, 1000)))
                content[at : at + size] = (word % 2 ** (8 * size)).to_bytes(size, "little")
            case "cut":
                del content[at:]
            case "drop":
                del content[at : at + draw(st.integers(1, 64))]
            case "insert":
                content[at:at] = draw(st.binary(max_size=16))
            case "repeat":
                content[at:at] = content[at : at + draw(st.integers(1, 64))]
            case _:
                size = min(draw(st.integers(1, 64)), len(content) - at)
                content[at : at + size] = bytes(size)
    return bytes(content)
