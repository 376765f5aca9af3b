"""The page of several studies side by side: their answers, their boxes, and their paired differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column
from bokeh.models import CheckboxButtonGroup, Div, RadioButtonGroup, Select

from harness.common import statistics
from harness.common.files import parse_toml
from harness.models.quantities import words
from harness.reporting import style
from harness.study.report import analyse
from harness.study.report.analysis import Analysis
from harness.study.report.opening import answer_in_short
from harness.view import looks
from harness.view.box_figure import Across, BoxFigure
from harness.view.boxes import SCORES, Box, run_in_words, sorted_box, unit_of
from harness.view.frame import Part, address_bar, arguments_of, index_of, indices_of, line, put_parts, said
from harness.view.side_by_side import ChosenBoxes, SideBySide, Slot, arranged, side_by_side
from harness.view.tables import table

Run = tuple[int, int, int, int, int, int]
"""Study, estimator, band, drive, point and repeat."""


def build(folders: Sequence[Path]) -> Callable[[Document], None]:
    """Return what puts the page of several studies into a document; their own pages are at ``1``, ``2``, … below it.

    Raises:
        UserError: If one cannot be read, or has no target in common with the others.
    """
    studies = side_by_side(folders, [analyse(folder) for folder in folders])

    def put(document: Document) -> None:
        _SideBySide(document, studies)

    return put


class _SideBySide:
    """One reader's page."""

    def __init__(self, document: Document, studies: SideBySide) -> None:
        self._studies, self._address = studies, address_bar()
        self._looks = style.looks(studies.estimators)
        self._numbers: dict[tuple[Any, ...], tuple[str, ...]] = {}
        given = arguments_of(document)
        self._make_widgets(given)
        self._boxes = ChosenBoxes(partial(self._choose, 0), "")
        self._differences = ChosenBoxes(partial(self._choose, 1), " of differences")
        self._slots: tuple[list[Slot], list[Slot]] = ([], [])
        self._of, self._unpaired, self._said = said(""), said(""), said(_NO_RUN)
        self._told = column(self._said, sizing_mode="stretch_width")
        self._table = column(sizing_mode="stretch_width")
        self._run = self._run_of(given.get("run", ""))
        self._draw()
        self._put(document)

    def _make_widgets(self, given: dict[str, str]) -> None:
        studies, score, count = self._studies, given.get("score", "rmse"), len(self._studies.names)
        self._design = Select(
            title="Design", options=[(str(i), words(n)) for i, n in enumerate(studies.designs)],
            value=str(index_of(given.get("design"), len(studies.designs)) or 0),
        )  # fmt: skip
        self._target = Select(
            title="Target", width=260, options=[(str(i), t.words) for i, t in enumerate(studies.targets)],
            value=str(index_of(given.get("target"), len(studies.targets)) or 0),
        )  # fmt: skip
        self._score = Select(
            title="Score", options=list(SCORES.items()), value=score if score in SCORES else "rmse", width=190
        )
        self._scale = RadioButtonGroup(labels=["linear", "logarithmic"], active=int(given.get("log", "1") != "0"))
        order = index_of(given.get("order"), 2)
        self._order = RadioButtonGroup(labels=_ORDERS, active=self._usual_order() if order is None else order)
        shown = indices_of(given.get("studies"), count) or range(count)
        self._shown = CheckboxButtonGroup(
            labels=list(studies.names), active=sorted(shown), stylesheets=[looks.WRAPPED], name="studies"
        )
        own = indices_of(given.get("estimators"), len(studies.estimators)) or range(len(studies.estimators))
        self._estimators = CheckboxButtonGroup(
            labels=list(studies.estimators), active=sorted(own), stylesheets=[looks.WRAPPED], name="estimators"
        )
        self._design.on_change("value", lambda _a, _o, _n: self._on_design())
        for select in (self._target, self._score):
            select.on_change("value", lambda _a, _o, _n: self._draw())
        for group in (self._scale, self._order, self._shown, self._estimators):
            group.on_change("active", lambda _a, _o, _n: self._draw())

    @property
    def _name(self) -> str:
        """Name of the design."""
        return self._studies.designs[int(self._design.value)]

    def _usual_order(self) -> int:
        """Return whether studies have a level in common, so that its boxes belong next to each other."""
        slots = self._studies.slots(range(len(self._studies.names)), self._name)
        levels = [self._studies.level(slot, self._name) for slot in slots]
        return 0 if len(set(levels)) < len(levels) else 1

    def _on_design(self) -> None:
        self._run, order = None, self._usual_order()
        if order == self._order.active:
            self._draw()
        else:
            self._order.active = order  # draws

    def _put(self, document: Document) -> None:
        studies = self._studies
        stores = [a.store for a in studies.analyses]
        answers = table(
            {
                "study": studies.names,
                "question": [str(s.attributes.get("title") or s.attributes.get("study_name") or "") for s in stores],
                "answer": [answer_in_short(a) for a in studies.analyses],
            },
            {"study": [str(k + 1) for k in range(len(studies.names))]},
        )
        widgets = line(self._design, self._target, self._score, self._scale, self._order)
        groups = [
            line(Div(text=text, width=90, styles={"font-size": "15px"}), group)
            for text, group in (("Studies", self._shown), ("Estimators", self._estimators))
        ]
        parts = [
            Part("Answers", [answers], "A name opens the page of that study."),
            Part("Distribution of the score", [widgets, *groups, self._of, self._boxes.layout], _HINT),
            Part("The same run in each study", [self._told]),
            Part("Difference, run by run", [self._unpaired, self._differences.layout]),
            Part("In numbers", [self._table]),
            Part("What differs between the studies?", [differing(studies.analyses, studies.names)]),
        ]
        answer = [f"{len(studies.names)} studies. Differences are against the first one, {studies.names[0]}."]
        put_parts(document, "Studies side by side", answer, parts, self._address)

    def _draw(self) -> None:
        studies, name, target, score = self._studies, self._name, int(self._target.value), self._score.value
        values = {k: studies.scores(k, name, score, target) for k in range(len(studies.names))}
        why = {k: studies.unpaired(k, name) for k in values}
        shown = sorted(self._shown.active)
        paired = [k for k in shown if k and not why[k]]
        self._slots = (self._arranged(shown), self._arranged(paired))
        self._boxes.draw(self._figure(0, values, "", bool(self._scale.active)))
        against = f"difference to {studies.names[0]}"
        self._differences.draw(self._figure(1, values, against, False) if paired else None)
        self._told.min_height = 90 + 34 * sum(not text for text in why.values())  # so that nothing moves by a click
        self._of.text = self._what_levels_are()
        self._unpaired.text = _unpaired(studies, why, bool(paired))
        self._table.children = [table(self._rows(values, why))]
        self._show(self._run)

    def _arranged(self, numbers: Sequence[int]) -> list[Slot]:
        slots = self._studies.slots(numbers, self._name)
        levels = [self._studies.level(slot, self._name) for slot in slots]
        return [slots[i] for i in arranged(slots, levels, by_level=self._order.active == 0)]

    def _figure(self, which: int, values: dict[int, np.ndarray], against: str, log: bool) -> BoxFigure:
        """Return the figure of all boxes, or that of the differences to the first study."""
        studies, score, target = self._studies, self._score.value, self._studies.targets[int(self._target.value)]
        drawn: list[Box] = []
        for i, slot in enumerate(self._slots[which]):
            for e in sorted(self._estimators.active):
                runs = self._runs(values, slot, e, bool(against))
                if runs is not None:
                    drawn.append(sorted_box(i, e, runs, (slot.band, None)))
        what = SCORES[score] + ("" if score in ("nees", "nis", "time_of_divergence") else f" of the {target.words}")
        figure = BoxFigure(
            drawn, self._across(self._slots[which]), studies.estimators, self._looks, score, target, log,
            f"{what}: {against}" if against else "", {0.0: "dashed"} if against else {},
        )  # fmt: skip
        if against:
            figure.plot.yaxis.axis_label = f"difference of {SCORES[score]}{style.in_unit(unit_of(score, target))}"
            figure.plot.name = "boxes of differences"
        return figure

    def _runs(self, values: dict[int, np.ndarray], slot: Slot, estimator: int, against: bool) -> np.ndarray | None:
        """Return the score of every run, ``(drive, sample, repeat)``, or what it is more than in the first study."""
        own = self._column(slot.study, estimator)
        base = self._column(0, estimator) if against else own
        if own is None or base is None:
            return None
        runs = values[slot.study][slot.band, own]
        return np.asarray(runs - values[0][slot.band, base] if against else runs)

    def _column(self, study: int, estimator: int) -> int | None:
        """Return the index that an estimator has in a study."""
        names, name = self._studies.design(study, self._name).estimators, self._studies.estimators[estimator]
        return names.index(name) if name in names else None

    def _across(self, slots: Sequence[Slot]) -> Across:
        """Return the label of each slot, and of what it belongs to where several belong to the same."""
        studies = [self._studies.names[slot.study] for slot in slots]
        levels = [self._studies.level(slot, self._name) for slot in slots]
        by_level, labels = self._order.active == 0, [label for _, label in levels]
        alone = len(set(levels if by_level else studies)) == len(slots)
        inner, outer = (studies, labels) if by_level else (labels, studies)
        return Across(outer) if alone else Across(inner, groups=outer)

    def _what_levels_are(self) -> str:
        """Return what varies in each study, and of which of its designs that is."""
        studies_of: dict[str, list[str]] = {}
        for k in sorted(self._shown.active):
            design = self._studies.design(k, self._name)
            other = "" if design.name == self._name else f" (its design '{words(design.name)}')"
            varied = self._studies.level(Slot(k, 0), self._name)[0] if design.factors else "nothing varies"
            studies_of.setdefault(varied, []).append(self._studies.names[k] + other)
        if not studies_of:
            return "No study is switched on."
        return "Levels: " + "; ".join(f"{', '.join(names)}: {varied}" for varied, names in studies_of.items()) + "."

    def _rows(self, values: dict[int, np.ndarray], why: dict[int, str]) -> dict[str, list[str]]:
        """Return the table: a row for each box, with what is said of its pairs where any study has some."""
        compared = bool(self._slots[1])
        names = (*_COLUMNS, *(_PAIRED if compared else ()))
        rows: dict[str, list[str]] = {name: [] for name in names}
        for e in sorted(self._estimators.active):
            for slot in self._slots[0]:
                runs = self._runs(values, slot, e, against=False)
                if runs is None:
                    continue
                finite = runs[np.isfinite(runs)]
                median = style.number(float(np.median(finite))) if len(finite) else "–"
                level, study = self._studies.level(slot, self._name)[1], self._studies.names[slot.study]
                cells = [self._studies.estimators[e], level, study, str(len(finite)), median]
                if compared:
                    pairs = slot.study > 0 and not why[slot.study]
                    more = self._runs(values, slot, e, against=True) if pairs else None
                    cells += ["–"] * len(_PAIRED) if more is None else self._paired(slot, e, more, runs - more)
                for key, value in zip(rows, cells, strict=True):
                    rows[key].append(value)
        return rows

    def _paired(self, slot: Slot, estimator: int, more: np.ndarray, base: np.ndarray) -> tuple[str, ...]:
        """Return what a row says of differences to the first study, in which the scores are ``base``."""
        key = (self._name, self._target.value, self._score.value, slot, estimator)
        if key not in self._numbers:
            self._numbers[key] = _numbers(more, base, self._studies.design(slot.study, self._name).strata)
        return self._numbers[key]

    def _choose(self, which: int, box: Box, rank: int) -> None:
        slot = self._slots[which][box.across]
        band, drive, sample, repeat = map(int, box.runs[rank])
        self._show((slot.study, box.estimator, band, drive, sample, repeat))

    def _run_of(self, given: str) -> Run | None:
        """Return the run that an address asks for."""
        study = index_of(given.partition(".")[0], len(self._studies.names))
        if study is None:
            return None
        shape = self._studies.design(study, self._name).status.shape
        counts = (len(self._studies.names), len(self._studies.estimators), shape[0], *shape[2:])
        parts = given.split(".")
        if len(parts) != len(counts):
            return None
        indices = [index_of(part, count) for part, count in zip(parts, counts, strict=True)]
        valid = [i for i in indices if i is not None]
        if len(valid) < len(counts) or self._column(study, valid[1]) is None:
            return None
        return valid[0], valid[1], valid[2], valid[3], valid[4], valid[5]

    def _show(self, run: Run | None) -> None:
        """Say of a run what it is and its score in every study that has it, and mark it."""
        self._run = run
        self._told.children = [self._said]
        if run is None:
            self._said.text = _NO_RUN
            self._mark({})
        else:
            study, estimator, band, drive, sample, repeat = run
            design = self._studies.design(study, self._name)
            point = sample if design.status.shape[3] > 1 else None
            place = run_in_words(design.name, design.bands[band], design.drives[drive], point, repeat)
            self._said.text = f"{self._studies.estimators[estimator]}, {place}."
            scores = self._scores_of(run)
            self._told.children = [self._said, self._in_each(run, scores)]
            self._mark(scores)
        self._address.value = self._query()

    def _scores_of(self, run: Run) -> dict[int, float]:
        """Return the score of a run by the studies that have it: those whose runs pair, or its own alone."""
        study, estimator, band, *rest = run
        name, score, target = self._name, self._score.value, int(self._target.value)
        alike = [k for k in range(len(self._studies.names)) if not self._studies.unpaired(k, name)]
        scores = {}
        for k in alike if study in alike else [study]:
            own = self._column(k, estimator)
            if own is not None:
                scores[k] = float(self._studies.scores(k, name, score, target)[(band, own, *rest)])
        return scores

    def _in_each(self, run: Run, scores: dict[int, float]) -> Any:
        """Return a table of a run: its score in each study, what it is more than in the first, and its address."""
        score, estimator = self._score.value, run[1]
        unit = unit_of(score, self._studies.targets[int(self._target.value)])
        columns: dict[str, list[str]] = {"study": [self._studies.names[k] for k in scores]}
        columns[SCORES[score]] = [style.with_unit(v, unit) for v in scores.values()]
        if 0 in scores and len(scores) > 1:
            columns["difference"] = ["–" if not k else style.with_unit(v - scores[0], unit) for k, v in scores.items()]
        columns["run"] = [f"compute it again in {self._studies.names[k]}" for k in scores]
        place = ".".join(map(str, run[2:]))
        links = []
        for k in scores:
            number = self._studies.number(k, self._name)
            links.append(f"{k + 1}?design={number}&run={number}.{place}&compared={self._column(k, estimator)}")
        return table(columns, {"run": links}, still=True)

    def _mark(self, scores: dict[int, float]) -> None:
        """Mark the run that is shown among the boxes, by its score in each study."""
        for which, figure in enumerate((self._boxes.figure, self._differences.figure)):
            if figure is None:
                continue
            if self._run is None:
                figure.mark({})
                continue
            _, estimator, band, *_ = self._run
            figure.mark({
                (i, estimator): scores[slot.study] - (scores.get(0, np.nan) if which else 0.0)
                for i, slot in enumerate(self._slots[which]) if slot.band == band and slot.study in scores
            })  # fmt: skip

    def _query(self) -> str:
        query: dict[str, Any] = {
            "design": self._design.value, "target": self._target.value, "score": self._score.value,
            "log": self._scale.active, "order": self._order.active,
            "studies": ".".join(map(str, sorted(self._shown.active))),
            "estimators": ".".join(map(str, sorted(self._estimators.active))),
        }  # fmt: skip
        if self._run is not None:
            query["run"] = ".".join(map(str, self._run))
        return "?" + urlencode(query)


def _unpaired(studies: SideBySide, why: dict[int, str], some: bool) -> str:
    """Return what differences are, or that there are none, and of which studies there can be none, and why."""
    first = studies.names[0]
    sentences = [f"No study that is switched on has the runs of {first}."]
    if some:
        sentences = [f"Score of every run, less that of the same run in {first}. Below zero a study is better."]
    sentences += [f"The runs of {studies.names[k]} are others: {text}." for k, text in why.items() if text]
    return " ".join(sentences)


def _numbers(values: np.ndarray, base: np.ndarray, strata: np.ndarray) -> tuple[str, ...]:
    """Return what a row of the table says of the differences of one estimator at one level."""
    finite = np.isfinite(values)
    if not finite.any():
        return ("0", *["–"] * (len(_PAIRED) - 1))
    median, own = statistics.median_interval(values, strata), float(np.median(base[finite]))
    share = f"{style.number(100 * median.value / own)} %" if own else "–"
    interval = f"{style.number(median.lower)} to {style.number(median.upper)}"
    smaller = f"{100 * float((values[finite] < 0).mean()):.0f} %"
    return str(int(finite.sum())), style.number(median.value), interval, share, smaller


_ORDERS = ["by level", "by study"]
_COLUMNS = ("estimator", "level", "study", "runs", "median")
_PAIRED = ("pairs", "median difference", "95 % interval", "share", "smaller in")
_NO_RUN = "A click on a box, a whisker or a point chooses a run. By keyboard: choose it below the boxes."
_HINT = "Boxes of the same level stand next to each other, or those of the same study. A click chooses a run."


_THERE = "there"


def differing(analyses: Sequence[Analysis], names: Sequence[str]) -> Any:
    """Return in which settings the study files differ; of what one of them lacks, only that it does.

    Args:
        analyses: Of the studies.
        names: Of the studies, no two alike.
    """
    texts = zip(analyses, names, strict=True)
    sides = [settings(parse_toml(str(a.store.attributes["study"]), name)) for a, name in texts]
    every = list(dict.fromkeys(name for side in sides for name in side))
    partly = {n for n in every if any(n not in side for side in sides)}
    rows = [n for n in every if n in partly or any(side[n] != sides[0][n] for side in sides)]
    rows = [n for n in rows if not any(n.startswith(f"{above}.") for above in partly)]
    if not rows:
        return said("Their study files say the same; code, packages or files that they name may differ.")
    columns = {"setting": rows}
    for name, side in zip(names, sides, strict=True):
        columns[f"in {name}"] = ["–" if n not in side else _THERE if side[n] is None else str(side[n]) for n in rows]
    return table(columns)


def settings(content: Any, above: str = "") -> dict[str, Any]:
    """Return the settings of a study file by what leads to them, tables as ``None``, entries of lists by name."""
    if isinstance(content, list) and content and all(isinstance(entry, dict) for entry in content):
        content = {str(entry.get("name", entry.get("parameter", i))): entry for i, entry in enumerate(content)}
    if not isinstance(content, dict):
        return {above: content}
    entries: dict[str, Any] = {above: None} if above else {}
    for name, value in content.items():
        entries |= settings(value, f"{above}.{name}" if above else name)
    return entries
