"""A figure of boxes that is drawn anew, and the choice of one of its runs by pointer or keyboard."""

from __future__ import annotations

from collections.abc import Callable

from bokeh.events import Tap
from bokeh.layouts import column
from bokeh.models import CustomJS, Select

from harness.view import looks
from harness.view.box_figure import BoxFigure
from harness.view.boxes import RANKS, Box
from harness.view.frame import line


class ChosenBoxes:
    """A figure of boxes, and the lists by which a run of it is chosen without a pointer.

    Args:
        chosen: Called with the box and the rank of the run that is chosen.
        what: Which boxes they are, behind the word in the title of the list.

    Attributes:
        figure: That is shown, if any.
        layout: The figure above the lists.
    """

    def __init__(self, chosen: Callable[[Box, int], None], what: str) -> None:
        self.figure: BoxFigure | None = None
        self._chosen = chosen
        self._box = Select(title=f"Box{what}", width=360, stylesheets=[looks.WRAPPED])
        self._rank = Select(title="Its run", options=list(RANKS.items()), value="", width=120)
        self._rank.on_change("value", lambda _a, _o, new: self._by_rank(new))
        self._box.js_on_change("value", CustomJS(args={"rank": self._rank}, code="rank.value = '';"))
        self._holder = column(sizing_mode="stretch_width")
        self._lists = line(self._box, self._rank)
        self.layout = column(self._holder, self._lists, sizing_mode="stretch_width")

    def draw(self, figure: BoxFigure | None) -> None:
        """Show a figure in place of the one before, or none."""
        self.figure, self._rank.value = figure, ""
        self._holder.children = [] if figure is None else [figure.plot]
        self._lists.visible = figure is not None
        if figure is None:
            return
        figure.plot.on_event(Tap, self._tapped)
        self._box.options = figure.offered
        if self._box.options:
            self._box.value = self._box.options[0][0]

    def _tapped(self, event: Tap) -> None:
        hit = self.figure.hit(event.x, event.y) if self.figure is not None else None
        if hit is not None:
            self._chosen(*hit)

    def _by_rank(self, rank: str) -> None:
        if rank and self.figure is not None and self._box.value:
            box = self.figure.boxes[int(self._box.value)]
            self._chosen(box, round(float(rank) * (len(box.values) - 1)))
