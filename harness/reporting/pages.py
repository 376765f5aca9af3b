"""Placement of figures on paper: each on one page with its heading, and no page half empty for it.

Typst breaks pages from front to back and never looks ahead, so that a figure that finds no room leaves the rest of its
page empty, or, if it floats, is parted from its heading. Here the document is laid out, the first figure that did not
find room is given some, and so on to the end: a figure that lacks little is drawn smaller, one that lacks much goes to
the next page with its heading. Where that would leave much of a page empty it floats, and what follows fills the page.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import typst

from harness.common.files import write_files

SMALLEST = 0.8
"""Share of its size to which a figure is drawn smaller: its letters of 9 points are of 7 then."""

EMPTY, EMPTY_BEFORE_TEXT = 0.5, 0.25
"""Share of a page that stays empty at the most so that a figure and its heading are on one page: where only another
section could fill it, and where text or tables may, or the figure has no heading."""

_SLACK = 3.0
"""Points by which what is drawn smaller stays below the room that there is."""


@dataclass(frozen=True)
class Room:
    """Room of a figure.

    Attributes:
        share: Of its size.
        floats: Whether it goes to the top of the next page while what follows fills this one.
    """

    share: float = 1.0
    floats: bool = False


@dataclass(frozen=True)
class Placed:
    """Layout of a figure; lengths in points.

    Attributes:
        number: Of the figure.
        begins: Page on which it, or its heading if it has one, would begin.
        stands: Page on which it stands.
        room: From where it would begin to the end of that page.
        page: Height of a page without its margins.
        whole: Height of the heading, the text, the figure in full size and its caption.
        alone: Height of the figure in full size and its caption, with the distance to what follows.
        figure: Height of the figure alone, in full size.
        floats: Whether it floats.
        filled: Whether something may take the room that it leaves: its section goes on behind it, or it has no heading.
    """

    number: int
    begins: int
    stands: int
    room: float
    page: float
    whole: float
    alone: float
    figure: float
    floats: bool
    filled: bool

    @property
    def lacks(self) -> bool:
        """Whether it did not find room."""
        return not self.floats and (self.stands > self.begins or self.whole > self.page)

    def share(self, room: float) -> float:
        """Return the share of its size at which the figure has just that room, with what belongs to it."""
        return min(1.0, 1.0 - (self.whole - room + _SLACK) / self.figure)


def decided(figure: Placed, floating: Sequence[Placed] = ()) -> dict[int, Room]:
    """Return what a figure is given that did not find room, or what one before it is given instead, by number.

    One that floats would keep a second one waiting for the page after its own, pages behind its heading: so the second
    does not float, and if that leaves more empty than the first one would have, neither does the first.

    Args:
        figure: The figure.
        floating: Figures that float; the pages that they stand on have less room.
    """
    passed = [
        figure.page - sum(f.alone for f in floating if f.stands == page)
        for page in range(figure.begins + 1, figure.stands)
    ]
    for room in (figure.room, *passed):
        if figure.share(room) >= SMALLEST:
            return {figure.number: Room(figure.share(room))}
    empty = max(figure.room, *passed, 0.0)
    if empty > (EMPTY_BEFORE_TEXT if figure.filled else EMPTY) * figure.page:
        first = next((f for f in floating if f.number < figure.number and f.stands > figure.begins), None)
        if first is None:
            return {figure.number: Room(floats=True)}
        if first.room < empty:
            return {first.number: Room()}
    return {figure.number: Room(figure.share(figure.page))}


def lay_out(compiler: typst.Compiler, folder: Path) -> None:
    """Write ``rooms.json``, from which the template takes the room of each figure.

    Args:
        compiler: Of the document, for paper.
        folder: Of the document.
    """
    rooms: dict[int, Room] = {}
    while True:
        given = {number: asdict(r) for number, r in rooms.items() if r != Room()}
        write_files(folder, {"rooms.json": json.dumps(given)})
        placed = [Placed(**fields) for fields in json.loads(compiler.query("<placed>", field="value"))]
        floating = [p for p in placed if p.floats]
        for figure in placed:
            if figure.number not in rooms and figure.lacks:
                now = decided(figure, floating)
                changes = any(rooms.get(number, Room()) != r for number, r in now.items())
                rooms |= now
                if changes:
                    break  # what follows stands elsewhere then
        else:
            return
