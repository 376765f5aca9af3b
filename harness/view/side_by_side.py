"""Several studies side by side: what they share, where their boxes stand, and which runs of theirs pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bokeh.events import Tap
from bokeh.layouts import column
from bokeh.models import CustomJS, Select
from numpy.typing import NDArray

from harness.common.errors import UserError
from harness.models.quantities import Quantity, listed, words
from harness.study.report.analysis import Analysis
from harness.study.report.sections.boxes import factors_of
from harness.study.results import Design
from harness.view import looks
from harness.view.box_figure import BoxFigure
from harness.view.boxes import RANKS, Box, scores_of
from harness.view.frame import line


@dataclass(frozen=True)
class Slot:
    """Where boxes stand in a figure: one level of one study.

    Attributes:
        study: Index of the study.
        band: Index of the level in its design.
    """

    study: int
    band: int


@dataclass(frozen=True)
class SideBySide:
    """Studies and what they share.

    Attributes:
        names: Of the result folders, no two alike.
        analyses: Of each study.
        designs: Names of the designs that any of them has, in the order of the studies.
        targets: What all of them score.
        estimators: Names of the estimators that any of them has.
    """

    names: tuple[str, ...]
    analyses: tuple[Analysis, ...]
    designs: tuple[str, ...]
    targets: tuple[Quantity, ...]
    estimators: tuple[str, ...]

    def number(self, study: int, name: str) -> int:
        """Return the index of a study's design of a name; that of its first one if it has none such."""
        names = [d.name for d in self.analyses[study].store.designs]
        return names.index(name) if name in names else 0

    def design(self, study: int, name: str) -> Design:
        """Return a study's design of a name; its first one if it has none such."""
        return self.analyses[study].store.designs[self.number(study, name)]

    def scores(self, study: int, name: str, score: str, target: int) -> NDArray[np.float64]:
        """Return a score of all runs, ``(band, estimator, drive, sample, repeat)`` as in the design."""
        design = self.design(study, name)
        return scores_of(design, score, list(map(_key, design.targets)).index(_key(self.targets[target])))

    def slots(self, studies: Sequence[int], name: str) -> list[Slot]:
        """Return the levels of some studies, study by study."""
        return [Slot(k, band) for k in studies for band in range(len(self.design(k, name).bands))]

    def level(self, slot: Slot, name: str) -> tuple[str, str]:
        """Return the level of a slot: what varies, and the label. Two slots of one level stand side by side."""
        design = self.design(slot.study, name)
        return factors_of(design), design.bands[slot.band]

    def unpaired(self, study: int, name: str) -> str:
        """Return why the runs of a study are not those of the first one, in words; nothing where they are.

        Runs pair where the studies draw the same random numbers for them: seed, design, levels, drives, points and
        repeats agree.
        """
        first, other = self.design(0, name), self.design(study, name)
        seeds = [self.analyses[k].store.seed for k in (0, study)]
        if seeds[0] != seeds[1]:
            return f"seed {seeds[1]} instead of {seeds[0]}"
        if first.name != other.name:
            return f"no design of the same name ('{words(other.name)}' instead of '{words(first.name)}')"
        if first.bands != other.bands or _varied(first) != _varied(other):
            return f"the design '{words(first.name)}' has other factors or levels"
        if first.drives != other.drives:
            return f"the design '{words(first.name)}' has other drives"
        if first.status.shape[2:] != other.status.shape[2:]:
            return f"the design '{words(first.name)}' has another number of points or repeats"
        if not all(np.array_equal(a.values, b.values) for a, b in zip(first.factors, other.factors, strict=True)):
            return f"the design '{words(first.name)}' has other points"
        if not set(first.estimators) & set(other.estimators):
            return "no estimator of the same name"
        return ""


def side_by_side(folders: Sequence[Path], analyses: Sequence[Analysis]) -> SideBySide:
    """Return studies with what they share.

    Raises:
        UserError: If one has no target in common with those before it.
    """
    full = [f.resolve() for f in folders]
    names = [f.name for f in full]
    if len(set(names)) < len(names):
        names = [str(f) for f in full]
    targets = list(analyses[0].store.designs[0].targets)
    for folder, analysis in zip(folders, analyses, strict=True):
        for design in analysis.store.designs:
            own = {_key(t) for t in design.targets}
            both = [t for t in targets if _key(t) in own]
            if not both:
                raise UserError(
                    f"{folder}: scores {_listed(design.targets)}, and not {_listed(targets)} as {folders[0]}; "
                    "side by side are shown studies that have a target in common"
                )
            targets = both
    designs = dict.fromkeys(d.name for a in analyses for d in a.store.designs)
    estimators = dict.fromkeys(e for a in analyses for d in a.store.designs for e in d.estimators)
    return SideBySide(tuple(names), tuple(analyses), tuple(designs), tuple(targets), tuple(estimators))


def arranged(slots: Sequence[Slot], levels: Sequence[tuple[str, str]], by_level: bool) -> list[int]:
    """Return the order in which slots stand: level by level with the studies side by side, or study by study."""
    if not by_level:
        return list(range(len(slots)))
    first = {level: i for i, level in reversed(list(enumerate(levels)))}
    return sorted(range(len(slots)), key=lambda i: (first[levels[i]], i))


def _key(target: Quantity) -> tuple[str, str]:
    return target.name, target.unit


def _varied(design: Design) -> list[tuple[str, str]]:
    return [(f.name, f.of) for f in design.factors]


def _listed(targets: Sequence[Quantity]) -> str:
    return listed([t.words for t in targets])


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
