"""The page of two studies side by side: the difference of their scores, run by run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.layouts import column, row
from bokeh.models import Div, Select

from harness.common import statistics
from harness.common.errors import UserError
from harness.models.quantities import words
from harness.reporting import style
from harness.study.report import analyse
from harness.study.report.analysis import Analysis
from harness.study.report.sections.boxes import factors_of
from harness.study.results import Design
from harness.study.view.box_figure import BoxFigure
from harness.study.view.boxes import SCORES, Box, scores_of, sorted_box, unit_of
from harness.study.view.frame import Part, address_bar, arguments_of, index_of, put_parts, said
from harness.study.view.tables import table


@dataclass(frozen=True)
class Pair:
    """A design that both studies have, over the same runs.

    Attributes:
        first, second: The design in each.
        numbers: Its index in each.
        estimators: Names that both have.
        targets: Their indices in the first design and in the second.
    """

    first: Design
    second: Design
    numbers: tuple[int, int]
    estimators: tuple[str, ...]
    targets: tuple[tuple[int, int], ...]

    def differences(self, score: str, target: int, estimator: int) -> np.ndarray:
        """Return second less first of every run, ``(band, drive, sample, repeat)``; NaN where one of them has none."""
        name, both = self.estimators[estimator], []
        for design, t in zip((self.first, self.second), self.targets[target], strict=True):
            both.append(scores_of(design, score, t)[:, design.estimators.index(name)])
        return np.asarray(both[1] - both[0])

    def of_first(self, score: str, target: int, estimator: int) -> np.ndarray:
        """Return the score of every run in the first study."""
        e = self.first.estimators.index(self.estimators[estimator])
        return np.asarray(scores_of(self.first, score, self.targets[target][0])[:, e])


def pairs_of(first: Analysis, second: Analysis) -> list[Pair]:
    """Return the designs of two studies whose runs are the same but for what is compared.

    Raises:
        UserError: If there is none; it says what differs.
    """
    why, found = "no design of the same name", []
    if first.store.seed != second.store.seed:
        raise UserError(
            f"the two studies cannot be compared run by run: seed {first.store.seed} and {second.store.seed}"
        )
    for i, one in enumerate(first.store.designs):
        for k, other in enumerate(second.store.designs):
            if one.name != other.name:
                continue
            if one.status.shape[2:] != other.status.shape[2:] or one.bands != other.bands or one.drives != other.drives:
                why = f"design '{one.name}' has other levels, drives, points or repeats"
                continue
            estimators = tuple(e for e in one.estimators if e in other.estimators)
            names = [t.name for t in other.targets]
            targets = tuple((a, names.index(t.name)) for a, t in enumerate(one.targets) if t.name in names)
            if estimators and targets:
                found.append(Pair(one, other, (i, k), estimators, targets))
            else:
                why = f"design '{one.name}' has no estimator or target in both"
    if not found:
        raise UserError(f"the two studies cannot be compared run by run: {why}")
    return found


def build(one: Path, other: Path) -> Callable[[Document], None]:
    """Return what puts the page of two studies into a document; their own pages are at ``1`` and ``2`` below it.

    Raises:
        UserError: If one cannot be read, or they do not have the same runs.
    """
    first, second = analyse(one), analyse(other)
    pairs = pairs_of(first, second)

    def put(document: Document) -> None:
        _PairPage(document, first, second, pairs)

    return put


class _PairPage:
    """One reader's page."""

    def __init__(self, document: Document, first: Analysis, second: Analysis, pairs: list[Pair]) -> None:
        self._pairs, self._analysis, self._address = pairs, first, address_bar()
        folders = [a.store.directory.resolve() for a in (first, second)]
        self._names = [f.name if folders[0].name != folders[1].name else str(f) for f in folders]
        given = arguments_of(document)
        number = index_of(given.get("design"), len(pairs)) or 0
        target = index_of(given.get("target"), len(pairs[number].targets)) or 0
        score = given.get("score", "rmse")
        designs = [(str(i), words(p.first.name)) for i, p in enumerate(pairs)]
        self._design = Select(title="Design", options=designs, value=str(number))
        self._target = Select(title="Target", width=260, options=self._targets(number), value=str(target))
        self._score = Select(
            title="Score", options=list(SCORES.items()), value=score if score in SCORES else "rmse", width=190
        )
        self._holder, self._told = column(sizing_mode="stretch_width"), column(sizing_mode="stretch_width")
        self._run = Div(text="", sizing_mode="stretch_width", styles={"font-size": "15px"})
        self._design.on_change("value", lambda _a, _o, new: self._on_design(int(new)))
        for select in (self._target, self._score):
            select.on_change("value", lambda _a, _o, _n: self._draw())
        self._figure: BoxFigure | None = None
        self._draw()
        widgets = row(
            self._design, self._target, self._score, styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width"
        )
        links = Div(
            text='<a href="1">The first study</a>, <a href="2">the second study</a>.', styles={"font-size": "15px"}
        )
        parts = [
            Part("Difference, run by run", [widgets, self._holder, self._run, links], _HINT),
            Part("In numbers", [self._told]),
        ]
        answer = [f"First: {self._names[0]}. Second: {self._names[1]}. Below zero the second has the smaller score."]
        put_parts(document, "Two studies on the same runs", answer, parts, self._address)

    def _targets(self, number: int) -> list[tuple[str, str]]:
        pair = self._pairs[number]
        return [(str(i), pair.first.targets[one].words) for i, (one, _) in enumerate(pair.targets)]

    def _on_design(self, number: int) -> None:
        self._target.options, self._target.value = self._targets(number), "0"
        self._draw()

    def _draw(self) -> None:
        pair, target, score = self._pairs[int(self._design.value)], int(self._target.value), self._score.value
        quantity = pair.first.targets[pair.targets[target][0]]
        found: list[Box] = []
        rows: dict[str, list[str]] = {name: [] for name in _COLUMNS}
        for e, name in enumerate(pair.estimators):
            values, base = pair.differences(score, target, e), pair.of_first(score, target, e)
            for band, label in enumerate(pair.first.bands):
                found.append(sorted_box(band, e, values[band], (band, None)))
                cells = (name, str(label), *_numbers(values[band], base[band], pair.first.strata))
                for key, value in zip(rows, cells, strict=True):
                    rows[key].append(value)
        unit = unit_of(score, quantity)
        what = SCORES[score] + ("" if score in ("nees", "nis", "time_of_divergence") else f" of the {quantity.words}")
        title, looks_ = f"{what}: second less first", self._analysis.looks
        self._figure = BoxFigure(
            found,
            pair.first.bands,
            pair.estimators,
            looks_,
            score,
            quantity,
            False,
            title,
            {0.0: "dashed"},
            factors_of(pair.first),
        )
        self._figure.plot.yaxis.axis_label = f"difference of {SCORES[score]}{style.in_unit(unit)}"
        self._figure.plot.on_event(Tap, self._tapped)
        self._holder.children = [self._figure.plot]
        told = f"Differences{style.in_unit(unit)}; share: median difference over the first study's median."
        self._told.children = [said(told), table(rows)]
        self._run.text = ""
        self._address.value = "?" + urlencode({"design": self._design.value, "target": target, "score": score})

    def _tapped(self, event: Tap) -> None:
        """Give the addresses of the run that was clicked in both studies."""
        hit = self._figure.hit(event.x, event.y) if self._figure is not None else None
        if hit is None:
            return
        box, rank = hit
        pair = self._pairs[int(self._design.value)]
        band, drive, sample, repeat = map(int, box.runs[rank])
        links = []
        for i, (design, number) in enumerate(zip((pair.first, pair.second), pair.numbers, strict=True)):
            e = design.estimators.index(pair.estimators[box.estimator])
            query = f"design={number}&run={number}.{band}.{drive}.{sample}.{repeat}&compared={e}"
            links.append(f'<a href="{i + 1}?{query}">in the {("first", "second")[i]} study</a>')
        self._run.text = (
            f"This run (band {band}, drive {drive}, point {sample}, repeat {repeat}): {' and '.join(links)}."
        )


def _numbers(values: np.ndarray, base: np.ndarray, strata: np.ndarray) -> tuple[str, ...]:
    """Return what a row of the table says of the differences of one estimator at one level."""
    known = np.isfinite(values)
    if not known.any():
        return ("0", "–", "–", "–", "–")
    median, own = statistics.median_interval(values, strata), float(np.median(base[known]))
    share = f"{style.number(100 * median.value / own)} %" if own else "–"
    interval = f"{style.number(median.lower)} to {style.number(median.upper)}"
    smaller = f"{100 * float((values[known] < 0).mean()):.0f} %"
    return str(int(known.sum())), style.number(median.value), interval, share, smaller


_COLUMNS = ("estimator", "level", "runs", "median difference", "95 % interval", "share", "smaller in")
_HINT = "A click on a box, a whisker or a point leads to that run in both studies."
