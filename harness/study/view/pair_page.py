"""The page of two studies side by side: the difference of their scores, run by run."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.layouts import column, row
from bokeh.models import CustomJS, Div, Select

from harness.common import statistics
from harness.common.errors import UserError
from harness.models.quantities import words
from harness.reporting import style
from harness.study.report import analyse
from harness.study.report.analysis import Analysis
from harness.study.report.sections.boxes import factors_of
from harness.study.results import Design
from harness.study.view import looks
from harness.study.view.box_figure import BoxFigure
from harness.study.view.boxes import RANKS, SCORES, Box, run_in_words, scores_of, sorted_box, unit_of
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
        self._busy = False
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
        self._box = Select(title="Box", width=360, stylesheets=[looks.WRAPPED])
        self._rank = Select(title="Its run", options=list(RANKS.items()), value="", width=120)
        self._holder, self._told = column(sizing_mode="stretch_width"), column(sizing_mode="stretch_width")
        self._said, self._links = said(""), Div(text="", sizing_mode="stretch_width", styles={"font-size": "15px"})
        self._figure: BoxFigure | None = None
        self._run: tuple[int, ...] | None = None
        self._connect()
        self._draw()
        self._show(self._run_of(given.get("run", "")))
        self._put(document, first, second)

    def _connect(self) -> None:
        self._design.on_change("value", lambda _a, _o, new: self._on_design(int(new)))
        for select in (self._target, self._score):
            select.on_change("value", lambda _a, _o, _n: self._draw())
        self._rank.on_change("value", lambda _a, _o, new: self._by_rank(new))
        self._box.js_on_change("value", CustomJS(args={"rank": self._rank}, code="rank.value = '';"))

    def _put(self, document: Document, first: Analysis, second: Analysis) -> None:
        """Put everything into the page."""
        folders = [a.store.directory.resolve() for a in (first, second)]
        names = [f.name if folders[0].name != folders[1].name else str(f) for f in folders]
        widgets, chosen = (
            row(*parts, styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width")
            for parts in ((self._design, self._target, self._score), (self._box, self._rank))
        )
        links = Div(
            text='<a href="1">The first study</a>, <a href="2">the second study</a>.', styles={"font-size": "15px"}
        )
        parts = [
            Part("Difference, run by run", [widgets, self._holder, chosen, self._said, self._links, links], _HINT),
            Part("In numbers", [self._told]),
            Part("What differs between the studies?", [_differing(first, second)]),
        ]
        answer = [f"First: {names[0]}. Second: {names[1]}. Below zero the second has the smaller score."]
        put_parts(document, "Two studies on the same runs", answer, parts, self._address)

    @property
    def _pair(self) -> Pair:
        return self._pairs[int(self._design.value)]

    def _targets(self, number: int) -> list[tuple[str, str]]:
        pair = self._pairs[number]
        return [(str(i), pair.first.targets[one].words) for i, (one, _) in enumerate(pair.targets)]

    def _on_design(self, number: int) -> None:
        self._busy, self._run = True, None
        self._target.options, self._target.value = self._targets(number), "0"
        self._busy = False
        self._draw()

    def _draw(self) -> None:
        if self._busy:
            return
        pair, target, score = self._pair, int(self._target.value), self._score.value
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
        self._figure = BoxFigure(
            found, pair.first.bands, pair.estimators, self._analysis.looks, score, quantity, False,
            f"{what}: second less first", {0.0: "dashed"}, factors_of(pair.first),
        )  # fmt: skip
        self._figure.plot.yaxis.axis_label = f"difference of {SCORES[score]}{style.in_unit(unit)}"
        self._figure.plot.on_event(Tap, self._tapped)
        self._holder.children = [self._figure.plot]
        self._box.options = self._figure.offered
        if self._box.options:
            self._box.value = self._box.options[0][0]
        self._rank.value = ""
        told = f"Differences{style.in_unit(unit)}; share: median difference over the first study's median."
        self._told.children = [said(told), table(rows)]
        self._show(self._run)

    def _tapped(self, event: Tap) -> None:
        hit = self._figure.hit(event.x, event.y) if self._figure is not None else None
        if hit is not None:
            self._choose(*hit)

    def _by_rank(self, rank: str) -> None:
        if rank and self._figure is not None and self._box.value:
            box = self._figure.boxes[int(self._box.value)]
            self._choose(box, round(float(rank) * (len(box.values) - 1)))

    def _choose(self, box: Box, rank: int) -> None:
        self._show((box.estimator, *map(int, box.runs[rank])))

    def _run_of(self, given: str) -> tuple[int, ...] | None:
        """Return the run that an address asks for: its estimator, band, drive, point and repeat."""
        parts, counts = given.split("."), (len(self._pair.estimators), *self._pair.first.status.shape[:1],
                                           *self._pair.first.status.shape[2:])  # fmt: skip
        if len(parts) != len(counts):
            return None
        found = [index_of(part, count) for part, count in zip(parts, counts, strict=True)]
        return None if None in found else tuple(i for i in found if i is not None)

    def _show(self, run: tuple[int, ...] | None) -> None:
        """Say of a run what it is and how it differs, mark it, and give its addresses in both studies."""
        self._run, pair, score, target = run, self._pair, self._score.value, int(self._target.value)
        query = {"design": self._design.value, "target": target, "score": score}
        self._said.text = self._links.text = ""
        if run is not None and self._figure is not None:
            estimator, band, drive, sample, repeat = run
            name, design = pair.estimators[estimator], pair.first
            point = sample if design.status.shape[3] > 1 else None
            place = run_in_words(design.name, design.bands[band], design.drives[drive], point, repeat)
            unit = unit_of(score, design.targets[pair.targets[target][0]])
            values = [
                float(v[band, drive, sample, repeat])
                for v in (pair.of_first(score, target, estimator), pair.differences(score, target, estimator))
            ]
            self._figure.mark(band, {estimator: values[1]})
            sides = [style.with_unit(v, unit) for v in (values[0], values[0] + values[1], values[1])]
            self._said.text = (
                f"{name}, {place}: {SCORES[score]} {sides[0]} in the first study, {sides[1]} in the second, "
                f"difference {sides[2]}."
            )
            self._links.text = "This run {} and {}.".format(
                *(
                    f'<a href="{i + 1}?design={number}&run={number}.{band}.{drive}.{sample}.{repeat}'
                    f'&compared={d.estimators.index(name)}">in the {("first", "second")[i]} study</a>'
                    for i, (d, number) in enumerate(zip((pair.first, pair.second), pair.numbers, strict=True))
                )
            )
            query["run"] = ".".join(map(str, run))
        self._address.value = "?" + urlencode(query)


def _differing(first: Analysis, second: Analysis) -> Any:
    """Return in which settings the two study files differ; of what one of them lacks, only that it does."""
    one, other = (_settings(tomllib.loads(str(a.store.attributes["study"]))) for a in (first, second))
    every = dict.fromkeys([*one, *other])
    alone = [n for n in every if (n in one) != (n in other)]
    names = [n for n in every if n in alone or one[n] != other[n]]
    names = [n for n in names if not any(n.startswith(f"{above}.") for above in alone)]
    if not names:
        return said("Their study files say the same; code, packages or files that they name may differ.")
    shown = [
        ["–" if n not in side else _THERE if side[n] is None else str(side[n]) for n in names] for side in (one, other)
    ]
    return table({"setting": names, "first study": shown[0], "second study": shown[1]})


def _settings(of: Any, above: str = "") -> dict[str, Any]:
    """Return the settings of a study file by what leads to them, tables as ``None``, entries of lists by name."""
    if isinstance(of, list) and of and all(isinstance(entry, dict) for entry in of):
        of = {str(entry.get("name", entry.get("parameter", i))): entry for i, entry in enumerate(of)}
    if not isinstance(of, dict):
        return {above: of}
    found: dict[str, Any] = {above: None} if above else {}
    for name, value in of.items():
        found |= _settings(value, f"{above}.{name}" if above else name)
    return found


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


_THERE = "there"
_COLUMNS = ("estimator", "level", "runs", "median difference", "95 % interval", "share", "smaller in")
_HINT = "A click on a box, a whisker or a point leads to that run in both studies. By keyboard: choose it below."
