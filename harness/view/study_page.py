"""The page of a study: the answer in words, box plots, and below them the run that was clicked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.layouts import column
from bokeh.models import CheckboxButtonGroup, CustomJS, RadioButtonGroup, Select

from harness.models.quantities import words
from harness.study.replay import Place
from harness.study.report import analyse
from harness.study.report.analysis import Analysis
from harness.study.report.opening import answer_in_short
from harness.study.report.sections.boxes import factors_of
from harness.study.report.sections.over_time import AlongDrive
from harness.study.results import StudyResults
from harness.view import looks
from harness.view.above import Along
from harness.view.box_figure import Across, BoxFigure
from harness.view.boxes import RANKS, SCORES, Box, boxes, expected
from harness.view.factors import Brush
from harness.view.factors_panel import FactorsPanel
from harness.view.frame import address_bar, arguments_of, fill, index_of, indices_of, said, seconds_of
from harness.view.run_panel import RunPanel, Runs

OFFERED = ("signals", "parameters")
"""What a reader chooses from lists of names; names that there are not are left out by who shows them."""


@dataclass(frozen=True)
class PageState:
    """Indices from 0.

    Attributes:
        design, target: What the boxes are of.
        score: One of ``harness.view.boxes.SCORES``.
        drive: The boxes are of this drive alone; ``None`` for all.
        level: Boxes of this level by drive; ``None`` for boxes by level.
        log: Whether the axis is logarithmic.
        estimators: Those with boxes.
        run: The run that is drawn, if any.
        compared: Estimators that are drawn in it.
        brush: Points of the design that are selected.
        changes: Other values in the run, by parameter of the plant, SI.
        signals: Those that are drawn over time; ``None`` for the targets.
        parameters: Of the plant, that have a slider; ``None`` for those that the page offers first.
    """

    design: int = 0
    target: int = 0
    score: str = "rmse"
    drive: int | None = None
    level: int | None = None
    log: bool = True
    estimators: tuple[int, ...] = ()
    run: Place | None = None
    compared: tuple[int, ...] = ()
    brush: Brush | None = None
    changes: Mapping[str, float] = field(default_factory=dict)
    signals: tuple[str, ...] | None = None
    parameters: tuple[str, ...] | None = None

    @property
    def query(self) -> str:
        """The query that says this."""
        entries: dict[str, Any] = {"design": self.design, "target": self.target, "score": self.score}
        entries |= {k: v for k, v in (("drive", self.drive), ("level", self.level)) if v is not None}
        entries |= {"log": int(self.log), "estimators": ".".join(map(str, self.estimators))}
        if self.brush is not None:
            entries["brush"] = self.brush.text
        entries |= {k: ",".join(v) for k in OFFERED if (v := getattr(self, k)) is not None}
        if self.run is not None:
            run = self.run
            entries["run"] = f"{run.design}.{run.band}.{run.drive}.{run.sample}.{run.repeat}"
            entries["compared"] = ".".join(map(str, self.compared))
            entries |= {f"plant.{name}": repr(value) for name, value in self.changes.items()}
        return "?" + urlencode(entries)


def read(arguments: Mapping[str, Sequence[bytes]], results: StudyResults) -> PageState:
    """Return what an address asks for; what it asks for that is not there is as if it were not asked for."""
    given = {name: values[-1].decode("utf-8", "replace") for name, values in arguments.items() if values}
    design = index_of(given.get("design"), len(results.designs)) or 0
    chosen = results.designs[design]
    every = tuple(range(len(chosen.estimators)))
    state = PageState(
        design=design,
        target=index_of(given.get("target"), len(chosen.targets)) or 0,
        score=given["score"] if given.get("score") in SCORES else "rmse",
        drive=index_of(given.get("drive"), len(chosen.drives)),
        level=index_of(given.get("level"), len(chosen.bands)),
        log=given.get("log", "1") != "0",
        estimators=indices_of(given.get("estimators"), len(every)) or every,
        brush=Brush.read(given.get("brush", ""), len(chosen.factors)),
        signals=_names(given.get("signals")),
        parameters=_names(given.get("parameters")),
    )
    run = _place(given.get("run", ""), results)
    if run is None:
        return state
    changes = {}
    for name, value in given.items():
        if name.startswith("plant."):
            try:
                changes[name.removeprefix("plant.")] = float(value)
            except ValueError:
                continue
    compared = indices_of(given.get("compared"), len(every)) or state.estimators[:3]
    return replace(state, run=run, compared=compared, changes=changes)


def _names(given: str | None) -> tuple[str, ...] | None:
    return None if given is None else tuple(filter(None, given.split(",")))


def _place(given: str, results: StudyResults) -> Place | None:
    parts = given.split(".")
    if len(parts) != 5 or index_of(parts[0], len(results.designs)) is None:
        return None
    sizes = results.designs[int(parts[0])].data.sizes
    counts = [sizes[d] for d in ("band", "drive", "sample", "repeat")]
    rest = [index_of(part, count) for part, count in zip(parts[1:], counts, strict=True)]
    band, drive, sample, repeat = rest
    if band is None or drive is None or sample is None or repeat is None:
        return None
    return Place(int(parts[0]), band, drive, sample, repeat)


_SEEN = 1500
"""Time in ms after which a page that was asked for is seen."""

_ALL = "all"


class StudyPage:
    """One reader's page.

    Args:
        document: Where it goes.
        analysis: Of the study.
        runs: What computes runs again.
    """

    def __init__(self, document: Document, analysis: Analysis, runs: Runs) -> None:
        self._document, self._analysis, self._results = document, analysis, analysis.store
        context = document.session_context
        self.state = read(context.request.arguments if context is not None else {}, self._results)
        self._figure: BoxFigure | None = None
        self._busy = False
        self._panel = RunPanel(document, runs, analysis.looks, self._ran)
        self._address = address_bar()
        self._holder = column(sizing_mode="stretch_width")
        self._factors = FactorsPanel(document, analysis, self._choose_point, self._brushed, self._along)
        self._factors.brush = self.state.brush
        given = arguments_of(document)
        self._panel.above.begin_at = seconds_of(given.get("time"))
        self._panel.above.begin_by = given.get("colour", "")
        for name in OFFERED:
            self._offer(name)
        self._widgets = self._make_widgets()
        self._add_roots()
        self._redraw()
        if context is not None:
            document.add_timeout_callback(runs.prepare, _SEEN)
        if self.state.run is not None:
            self._panel.show(self.state.run, self.state.compared, self.state.changes)

    @property
    def _design(self) -> Any:
        return self._results.designs[self.state.design]

    def _make_widgets(self) -> dict[str, Any]:
        state, design = self.state, self._design
        designs = [(str(i), words(d.name)) for i, d in enumerate(self._results.designs)]
        widgets = {
            "design": Select(title="Design", options=designs, value=str(state.design)),
            "target": Select(title="Target", width=260),
            "score": Select(title="Score", options=list(SCORES.items()), value=state.score, width=190),
            "drive": Select(title="Drive", width=190),
            "level": Select(title="Boxes", width=230),
            "scale": RadioButtonGroup(labels=["linear", "logarithmic"], active=int(state.log)),
            "estimators": CheckboxButtonGroup(
                labels=design.estimators, active=list(state.estimators), stylesheets=[looks.WRAPPED]
            ),
            "box": Select(title="Box", width=360),
            "rank": Select(title="Its run", options=list(RANKS.items()), value="", width=120),
        }
        for name in ("design", "target", "drive", "level"):
            widgets[name].on_change("value", self._on_select(name))
        widgets["score"].on_change("value", lambda _a, _o, new: self._change(score=new))
        widgets["scale"].on_change("active", lambda _a, _o, new: self._change(log=bool(new)))
        widgets["estimators"].on_change("active", lambda _a, _o, new: self._change(estimators=tuple(sorted(new))))
        widgets["rank"].on_change("value", self._by_rank)
        widgets["box"].js_on_change("value", CustomJS(args={"rank": widgets["rank"]}, code="rank.value = '';"))
        return widgets

    def _offer(self, name: str) -> None:
        """Let a list of the run be as the address says, and the address as the list."""
        widget, asked = self._panel.roots[name], getattr(self.state, name)
        if asked is not None:
            there = dict(widget.options)
            widget.value = [v for v in asked if v in there]

        def changed(_attribute: str, _old: list[str], new: list[str]) -> None:
            further: dict[str, Any] = {name: tuple(new)}
            self.state = replace(self.state, **further)
            self._address.value = self.state.query

        widget.on_change("value", changed)

    def _on_select(self, name: str) -> Callable[[str, str, str], None]:
        def changed(_attribute: str, _old: str, new: str) -> None:
            value = None if new == _ALL else int(new)
            further = {"drive": None, "level": None, "target": 0, "brush": None} if name == "design" else {}
            if further:
                self._factors.brush = None
            self._change(**further, **{name: value})

        return changed

    def _change(self, **keys: Any) -> None:
        if not self._busy:
            self.state = replace(self.state, **keys)
            self._redraw()

    def _add_roots(self) -> None:
        attributes = self._results.attributes
        title = str(attributes.get("title") or attributes.get("study_name") or self._results.directory.name)
        roots = {
            "title": said(title, styles={"font-size": "1.35rem", "font-weight": "bold"}),
            "answer": said(answer_in_short(self._analysis), styles={"font-size": "1rem"}),
            "boxes": self._holder,
            "factors": self._factors.layout,
            "address": self._address,
            **self._widgets,
            **self._panel.roots,
        }
        fill(self._document, "page.html", title, roots)

    def _redraw(self) -> None:
        """Draw the boxes of the state, and let all widgets say it."""
        state, design, w = self.state, self._design, self._widgets
        self._busy = True
        w["target"].options = [(str(i), t.words) for i, t in enumerate(design.targets)]
        w["drive"].options = [(_ALL, "all drives"), *((str(i), d) for i, d in enumerate(design.drives))]
        levels = ((str(i), f"by drive, at {b}") for i, b in enumerate(design.bands))
        w["level"].options = [(_ALL, "by level"), *levels]
        w["target"].value, w["design"].value = str(state.target), str(state.design)
        w["drive"].value = _ALL if state.drive is None else str(state.drive)
        w["drive"].disabled = state.level is not None
        w["level"].value = _ALL if state.level is None else str(state.level)
        drawn = boxes(design, state.score, state.target, state.estimators, state.drive, state.level)
        across = Across(design.drives, "drive") if state.level is not None else Across(design.bands, factors_of(design))
        target = design.targets[state.target]
        self._figure = BoxFigure(drawn, across, design.estimators, self._analysis.looks, state.score, target, state.log,
                                 reference=expected(design, state.score))  # fmt: skip
        self._figure.plot.on_event(Tap, self._tapped)
        self._holder.children = [self._figure.plot]
        w["box"].options = self._figure.offered
        if w["box"].options:
            w["box"].value = w["box"].options[0][0]
        w["rank"].value = ""
        self._busy = False
        self._mark(self._panel.scores)
        self._address.value = state.query
        self._document.add_next_tick_callback(self._draw_factors)  # the boxes are seen first

    def _brushed(self, brush: Brush | None) -> None:
        self.state = replace(self.state, brush=brush)
        self._address.value = self.state.query

    def _along(self, indices: AlongDrive | None) -> None:
        """Let the path of the drive be coloured by the Sobol indices over its time."""
        if indices is None:
            self._panel.above.colour_also({})
            return
        who = indices.design.estimators[indices.estimator]
        self._panel.above.colour_also({
            f"total Sobol index of {indices.design.factors[i].words}, {who}": Along(
                indices.drive, indices.time, indices.total[i, :, 0], "total index"
            )
            for i in indices.leading
        })  # fmt: skip

    def _draw_factors(self) -> None:
        state = self.state
        drive = None if state.level is not None else state.drive
        self._factors.show(state.design, state.score, state.target, drive)

    def _choose_point(self, run: tuple[int, int, int, int], estimator: int) -> None:
        """Show a run of a point of the design."""
        band, drive, sample, repeat = run
        others = [e for e in self.state.compared if e != estimator]
        compared = tuple(sorted([estimator, *others][:3]))
        self._panel.show(Place(self.state.design, band, drive, sample, repeat), compared, {})

    def _tapped(self, event: Tap) -> None:
        hit = self._figure.hit(event.x, event.y) if self._figure is not None else None
        if hit is not None:
            self._choose(*hit)

    def _by_rank(self, _attribute: str, _old: str, new: str) -> None:
        if new and not self._busy and self._figure is not None and self._widgets["box"].value:
            box = self._figure.boxes[int(self._widgets["box"].value)]
            self._choose(box, round(float(new) * (len(box.values) - 1)))

    def _choose(self, box: Box, rank: int) -> None:
        """Show a run of a box, with the box's estimator and at most two that were shown before."""
        band, drive, sample, repeat = map(int, box.runs[rank])
        place = Place(self.state.design, band, drive, sample, repeat)
        others = [e for e in (*self.state.compared, *self.state.estimators) if e != box.estimator]
        compared = tuple(sorted([box.estimator, *dict.fromkeys(others)][:3]))
        self._panel.show(place, compared, {})

    def _ran(self, place: Place, compared: tuple[int, ...], changes: dict[str, float]) -> None:
        """Take note of what the panel shows."""
        self.state = replace(self.state, run=place, compared=compared, changes=changes)
        self._mark(self._panel.scores)
        self._address.value = self.state.query

    def _is_in_boxes(self, run: Place) -> bool:
        """Return whether a run is among those that the boxes are of."""
        state = self.state
        return run.band == state.level if state.level is not None else state.drive in (None, run.drive)

    def _mark(self, scores: dict[str, np.ndarray] | None) -> None:
        """Mark the run among the boxes."""
        state, figure = self.state, self._figure
        if figure is None:
            return
        run = state.run
        if run is None or scores is None or run.design != state.design or not self._is_in_boxes(run):
            figure.mark({})
            return
        values = scores[state.score]
        if state.score in ("rmse", "bias", "max_error"):
            values = values[:, state.target] * self._design.targets[state.target].scale
        across = run.band if state.level is None else run.drive
        figure.mark({(across, e): float(v) for e, v in zip(state.compared, values, strict=True)})


def build(folder: Path, study_folder: Path | None = None) -> Callable[[Document], None]:
    """Return what puts the page of a study into a document.

    Args:
        folder: Its result folder.
        study_folder: Folder of the study file, if files that it names lie there.

    Raises:
        UserError: If there is no store, or its study cannot be built.
    """
    analysis, runs = analyse(folder), Runs(folder, study_folder)

    def put(document: Document) -> None:
        StudyPage(document, analysis, runs)

    put(Document())  # the first one takes four times as long as those that follow, so no reader gets it
    return put
