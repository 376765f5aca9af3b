"""Statements of a C function: what nobody reads is left out, and variables are declared where they are needed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field


@dataclass
class Statement:
    """A line, or a block below it.

    Attributes:
        text: Of the line; of a block what stands in front of its brace; of an assignment what is assigned.
        reads: Names of C variables in it.
        target: Variable that is assigned.
        needed: Whether it does anything but assign its target.
        body: Statements of a block.
        otherwise: Those of its ``else``.
    """

    text: str
    reads: frozenset[str] = frozenset()
    target: str = ""
    needed: bool = True
    body: list[Statement] | None = None
    otherwise: list[Statement] = field(default_factory=list)

    @property
    def parts(self) -> list[Statement]:
        """Statements within it."""
        return [*(self.body or []), *self.otherwise]

    def mentions(self) -> Iterator[str]:
        """Give the names of variables in it and within it."""
        yield from self.reads
        if self.target:
            yield self.target
        for part in self.parts:
            yield from part.mentions()


def without_unread(statements: list[Statement]) -> list[Statement]:
    """Return statements without assignments that nothing reads, and without blocks that do nothing."""
    while True:
        read = Counter(_reads(statements))
        kept = _kept(statements, read)
        if sum(1 for _ in _all(kept)) == sum(1 for _ in _all(statements)):
            return kept
        statements = kept


def _all(statements: Iterable[Statement]) -> Iterator[Statement]:
    for each in statements:
        yield each
        yield from _all(each.parts)


def _reads(statements: Iterable[Statement]) -> Iterator[str]:
    for each in _all(statements):
        yield from (name for name in each.reads if each.needed or name != each.target)


def _kept(statements: list[Statement], read: Counter[str]) -> list[Statement]:
    kept = []
    for each in statements:
        if each.target and not read[each.target]:
            if each.needed:  # a function that does more than return a number
                kept.append(Statement(f"(void) {each.text}", each.reads))
            continue
        if each.body is None:
            kept.append(each)
            continue
        body, otherwise = _kept(each.body, read), _kept(each.otherwise, read)
        if body or otherwise:
            kept.append(Statement(each.text, each.reads, body=body, otherwise=otherwise))
    return kept


def printed(statements: Sequence[Statement], types: dict[str, str], indent: int = 1) -> list[str]:
    """Return the lines of statements, with each variable declared in the innermost block that holds all of it.

    Arrays are declared in front of all: what points to one may be read where nothing else mentions it.

    Args:
        statements: Of a function.
        types: C type by variable.
        indent: Of the block, in steps of four columns.
    """
    margin, mentioned = "    " * indent, {name for each in statements for name in each.mentions()}
    arrays = sorted(name for name, kind in types.items() if "[" in kind and name in mentioned)
    variables = {name: kind for name, kind in types.items() if "[" not in kind}
    return [*(f"{margin}{_declared(types[n], n)};" for n in arrays), *_block(statements, variables, margin)]


def _block(statements: Sequence[Statement], undeclared: dict[str, str], margin: str) -> list[str]:
    """Return the lines of a block; declares what no single statement of it holds alone."""
    homes: dict[str, list[int]] = {}
    for place, each in enumerate(statements):
        for name in set(each.mentions()) & undeclared.keys():
            homes.setdefault(name, []).append(place)
    here = {
        name: places[0] for name, places in homes.items() if len(places) > 1 or _is_split(statements[places[0]], name)
    }
    types = {name: undeclared.pop(name) for name in here}
    ahead = sorted(name for name, place in here.items() if statements[place].target != name)
    lines = [f"{margin}{_declared(types[name], name)};" for name in ahead]
    for place, each in enumerate(statements):
        begins = each.target in here and here[each.target] == place and each.target not in ahead
        lines += _lines(each, types.get(each.target, "") if begins else "", undeclared, margin)
    return lines


def _is_split(statement: Statement, name: str) -> bool:
    """Return whether a variable has to be declared outside a statement that alone holds it."""
    if statement.body is None or name in statement.reads:
        return True
    return name in {m for s in statement.body for m in s.mentions()} and name in {
        m for s in statement.otherwise for m in s.mentions()
    }


def _lines(statement: Statement, declared: str, undeclared: dict[str, str], margin: str) -> list[str]:
    if statement.target:
        left = _declared(declared, statement.target) if declared else statement.target
        return [f"{margin}{left} = {statement.text};"]
    if statement.body is None:
        return [f"{margin}{statement.text};"]
    lines = [f"{margin}{statement.text} {{", *_block(statement.body, undeclared, margin + "    ")]
    if statement.otherwise:
        lines += [f"{margin}}} else {{", *_block(statement.otherwise, undeclared, margin + "    ")]
    return [*lines, f"{margin}}}"]


def _declared(kind: str, name: str) -> str:
    base, bracket, size = kind.partition("[")
    return f"{base}{'' if base.endswith('*') else ' '}{name}{bracket}{size}"
