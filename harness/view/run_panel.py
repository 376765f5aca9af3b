"""Panel of one run: its figures, whether it is the stored one, downloads, and what-if sliders."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column
from bokeh.models import (
    Button,
    CheckboxButtonGroup,
    CustomJS,
    Div,
    MultiChoice,
    Slider,
    TextInput,
)

from harness.common.errors import ModelError, UserError
from harness.common.units import scale as unit_scale
from harness.config import NOISE_SCALES, StudySpec
from harness.config.alone import Change
from harness.models.quantities import print_unit, quantity, words
from harness.reporting import style
from harness.reporting.style import Look
from harness.study.compiled_study import signals_of
from harness.study.motion import published
from harness.study.replay import Place, Replayed
from harness.study.replayed import table
from harness.study.score_names import FATES, STATUS
from harness.study.stored import StoredRuns
from harness.view import looks, tables
from harness.view.above import AboveFigure
from harness.view.boxes import run_in_words
from harness.view.run_figure import RunFigure

_GIVEN_WAY = 0.1
"""Pause between two estimators that are made ready, s: a click that waits comes first."""

_SAVE = """
if (cb_obj.value == '') return;
const link = document.createElement('a');
link.href = URL.createObjectURL(new Blob([cb_obj.value], {type: kind}));
link.download = name; link.click(); URL.revokeObjectURL(link.href); cb_obj.value = '';
"""


@dataclass(frozen=True)
class Parameter:
    """A value of the plant that a slider changes; in a unit that reads well.

    Attributes:
        name: As a factor of a design names it.
        words: In words, with the unit.
        unit: SI units in one of these.
        lower, upper: Ends of the slider.
    """

    name: str
    words: str
    unit: float
    lower: float
    upper: float


class Runs(StoredRuns):
    """What computes the runs of a result folder again; for all readers, one run at a time.

    Args:
        folder: Result folder.
        beside: Folder of the study file.
    """

    def __init__(self, folder: Path, study_folder: Path | None = None) -> None:
        super().__init__(folder, study_folder)
        self.pool = ThreadPoolExecutor(1)
        self._one, self._prepared = threading.Lock(), False

    def compute(self, *run: Any) -> Replayed:
        """Compute a run again, see ``harness.study.replay.Replayer.run``."""
        with self._one:
            return self.replayer.run(*run)

    def prepare(self) -> None:
        """Load or compile what clicks will need, one estimator after the other, while the reader still reads."""
        if not self._prepared:
            self._prepared = True
            threading.Thread(target=self._prepare, daemon=True).start()

    def _prepare(self) -> None:
        for estimator in range(len(self.study.estimators)):
            with self._one, contextlib.suppress(UserError, ModelError):  # a click says what is wrong
                self.replayer.warm_up(estimator)
            time.sleep(_GIVEN_WAY)


def parameters_of(study: StudySpec) -> dict[str, Parameter]:
    """Return what a run of a study may have otherwise, the factors of its designs first."""
    factors = {f.parameter: f for d in study.designs for f in d.factors}
    own = {p.name: (p.unit, p.lower, p.upper) for p in study.plant.model().parameters if not p.numerical}
    wanted = dict.fromkeys([*(n for n in factors if n in own or n in NOISE_SCALES), *NOISE_SCALES[:2], *own])
    parameters = {}
    for name in wanted:
        if name in NOISE_SCALES:
            parameters[name] = Parameter(name, words(name), 1.0, 0.1, 10.0)
            continue
        unit, lowest, highest = own[name]
        value, shown = study.plant.values[name], factors[name].report_unit if name in factors else unit
        ends = [value / 2, value * 1.5]
        if name in factors:
            ends = [min(*ends, *factors[name].lower), max(*ends, *factors[name].upper)]
        low, high = sorted((max(min(ends), lowest), min(max(ends), highest)))
        size = float(unit_scale(shown, unit, name)) if shown else 1.0
        if high > low:
            said = f"{words(name)}{style.in_unit(print_unit(shown))}"
            parameters[name] = Parameter(name, said, size, low / size, high / size)
    return parameters


NO_RUN = (
    "No run is chosen yet. Click a box, a whisker or a point above, or choose a box in the list Box and its smallest, "
    "median or largest run: it is computed again and drawn here."
)


class RunPanel:
    """The lower part of a page.

    Args:
        document: Of the page.
        runs: What computes runs again.
        chosen: Look by estimator.
        ran: Told what is shown, each time.

    Attributes:
        roots: What goes into the page, by name.
        scores: Of the run that is shown, by name.
        above: The view from above.
    """

    def __init__(
        self,
        document: Document,
        runs: Runs,
        chosen: dict[str, Look],
        ran: Callable[[Place, tuple[int, ...], dict[str, float]], None],
    ) -> None:
        self._document, self._runs, self._ran = document, runs, ran
        self.above = AboveFigure(chosen)
        self._figure = RunFigure(chosen, self.above.cursor, self.above.to_here)
        self._run: Replayed | None = None
        self._place: tuple[Place, tuple[int, ...], dict[str, float]] | None = None
        self.scores: dict[str, np.ndarray] | None = None
        self._wanted: tuple[Place, tuple[int, ...], dict[str, float], bool] | None = None
        self._working = self._setting = False
        self._parameters = parameters_of(runs.study)
        self._sliders: dict[str, Slider] = {}
        self._stored_scores: dict[str, np.ndarray] = {}
        study = runs.study
        self._names = [e.name for e in study.estimators]
        belief, estimated = study.belief.model(), signals_of(study)
        states = [s for s in belief.states if s not in belief.within]
        self._beyond = [s for s in published(study.plant.model()) if s not in {*estimated, *states}]
        signals = list(dict.fromkeys([*estimated, *states, *self._beyond]))
        factors = {f.parameter for d in study.designs for f in d.factors}
        self.roots: dict[str, Any] = {
            "chosen": _text(NO_RUN),
            "verdict": _text("", **{"font-weight": "bold"}),
            "compared": CheckboxButtonGroup(labels=self._names, active=[], stylesheets=[looks.WRAPPED]),
            "signals": MultiChoice(
                title="Signals",
                options=[(s, quantity(s).words) for s in signals],
                value=list(study.targets),
                width=420,
                stylesheets=[looks.WRAPPED],
            ),
            "study_file": Button(label="As study file", disabled=True, width=130),
            "csv": Button(label="As CSV", disabled=True, width=100),
            "above": self.above.layout,
            "run": self._figure.layout,
            "parameters": MultiChoice(
                title="Parameters of the plant",
                options=[(p.name, p.words) for p in self._parameters.values()],
                value=[n for n in self._parameters if n in factors or n in NOISE_SCALES[:2]][:6],
                sizing_mode="stretch_width",
            ),
            "sliders": column(_text("Sliders, once a run is chosen."), sizing_mode="stretch_width"),
            "reset": Button(label="As it was", disabled=True, width=110),
            "scores": tables.table({"score": []}, still=True),
        }
        self.roots["scores"].visible = False  # until there are some
        self._connect()

    def _connect(self) -> None:
        roots = self.roots
        self._document.js_on_event(DocumentReady, self.above.draw)
        roots["compared"].on_change("active", lambda _a, _o, new: self._again(compared=tuple(sorted(new))))
        roots["signals"].on_change("value", lambda _a, _o, _n: self._draw())
        roots["parameters"].on_change("value", lambda _a, _o, _n: self._set_sliders())
        roots["reset"].on_click(lambda: self._again(changes={}))
        for name, kind, make in (
            ("study_file", "application/toml", lambda run: run.study.text),
            ("csv", "text/csv", lambda run: table(run.data).to_csv(index=False)),
        ):
            hidden = TextInput(value="", visible=False, name=f"{name}_text")
            file = "study.toml" if name == "study_file" else "run.csv"
            hidden.js_on_change("value", CustomJS(args={"name": file, "kind": kind}, code=_SAVE))
            roots[f"{name}_text"] = hidden
            roots[name].on_click(self._giving(hidden, make))

    def _giving(self, hidden: TextInput, make: Callable[[Replayed], str]) -> Callable[[], None]:
        def give() -> None:
            if self._run is not None:
                hidden.value = ""
                hidden.value = make(self._run)

        return give

    def show(self, place: Place, compared: Sequence[int], changes: Mapping[str, float], fast: bool = False) -> None:
        """Compute a run and show it; what was asked for meanwhile and is not begun gives way.

        Args:
            place: Which run.
            compared: Estimators.
            changes: Other values, SI.
            fast: Without innovations and the view from above, while a slider moves.
        """
        if not compared:
            return
        self._wanted = place, tuple(compared), dict(changes), fast
        if not self._working:
            self._begin()

    def _again(self, compared: tuple[int, ...] | None = None, changes: dict[str, float] | None = None) -> None:
        if self._setting or self._place is None:
            return
        place, others, values = self._place
        self.show(place, others if compared is None else compared, values if changes is None else changes)

    def _begin(self) -> None:
        assert self._wanted is not None
        wanted, self._wanted, self._working = self._wanted, None, True
        if not wanted[3]:
            self.roots["verdict"].text = "Computing … (the first run of an estimator compiles it, half a minute)"
        place, compared, values, fast = wanted

        everything = not fast or any(s in self._beyond for s in self.roots["signals"].value)
        scored = self._stored_scores if self._place is not None and self._place[:2] == wanted[:2] and fast else None

        def work() -> None:
            changes = [Change(name, value) for name, value in values.items()]
            try:
                run: Any = self._runs.compute(place, compared, changes, not fast, everything)
                stored = self._runs.stored(run) if scored is None else scored
                words_ = self._runs.comparison(run, stored).words if not changes else ""
                done = partial(self._done, wanted, run, stored, words_)
            except (UserError, ModelError) as error:
                done = partial(self._failed, str(error))
            self._document.add_next_tick_callback(done)

        self._runs.pool.submit(work)

    def _failed(self, words_: str) -> None:
        self.roots["verdict"].text = f"Not possible: {words_}"
        self._next()

    def _next(self) -> None:
        self._working = False
        if self._wanted is not None:
            self._begin()

    def _done(self, wanted: Any, run: Replayed, stored: dict[str, np.ndarray], words_: str) -> None:
        """Show a run that was computed."""
        place, compared, values, fast = wanted
        self._run, self._place, self._stored_scores = run, (place, compared, values), stored
        self.scores = run.scores
        roots, study = self.roots, self._runs.study
        design = study.designs[place.design]
        roots["chosen"].text = run_in_words(
            design.name, words(design.band_labels[place.band]), study.drives[place.drive].name,
            place.sample if design.samples > 1 else None, place.repeat,
        )  # fmt: skip
        said = ", ".join(self._in_words(n, v) for n, v in values.items())
        self._setting = True
        roots["compared"].active = list(compared)
        self._setting = False
        if not self._sliders or not values:
            self._set_sliders()
        for name in ("study_file", "csv"):
            roots[name].disabled = fast
        roots["reset"].disabled = not values
        self._fill_table()
        self._draw(fast)
        self._ran(place, compared, values)
        roots["verdict"].text = words_ or f"This run is in no store: {said}."  # said when it is drawn
        self._next()

    def _in_words(self, name: str, value: float) -> str:
        parameter = self._parameters.get(name)
        if parameter is None:
            return f"{words(name)} {value:g}"
        return f"{parameter.words} {style.number(value / parameter.unit, 4)}"

    def _draw(self, fast: bool = False) -> None:
        """Draw the run; the view from above, which takes most of the time, when the slider rests."""
        if self._run is not None:
            self._figure.show(self._run, self.roots["signals"].value)
            if not fast:
                self.above.show(self._run)

    def _fill_table(self) -> None:
        run = self._run
        assert run is not None
        rows: list[tuple[str, ...]] = []
        for i, e in enumerate(run.estimators):
            for k, target in enumerate(self._runs.study.targets):
                q = quantity(target)
                pair = [
                    style.with_unit(q.scale * float(s["rmse"][i, k]), q.unit) for s in (run.scores, self._stored_scores)
                ]
                rows.append((f"{self._names[e]}: RMSE, {q.words}", *pair))
            for name in ("nees", "nis"):
                pair = [style.number(float(s[name][i])) for s in (run.scores, self._stored_scores)]
                rows.append((f"{self._names[e]}: {name.upper()}", *pair))
            pair = [FATES[int(s[STATUS][i])] for s in (run.scores, self._stored_scores)]
            rows.append((f"{self._names[e]}: status", *pair))
        columns = {key: [row[i] for row in rows] for i, key in enumerate(("score", "this run", "as stored"))}
        self.roots["scores"].update(text=tables.rows_of(columns, still=True), visible=True)

    def _set_sliders(self) -> None:
        """Put a slider for each chosen parameter, at what the run has; those that are there stay."""
        if self._run is None:
            return
        self._setting, sliders = True, dict[str, Slider]()
        changes = self._place[2] if self._place is not None else {}
        own = {f.parameter: f.lower[0] for f in self._run.study.designs[0].factors if f.of != "belief"}
        for name in self.roots["parameters"].value:
            parameter = self._parameters[name]
            value = changes.get(name, own.get(name, self._run.plant.get(name, 1.0))) / parameter.unit
            low, high = min(parameter.lower, value), max(parameter.upper, value)
            ends: dict[str, Any] = {"start": low, "end": high, "step": (high - low) / 200, "value": value}
            slider = sliders[name] = self._sliders.get(name) or self._slider(parameter, ends)
            slider.update(**ends)
        if self._sliders != sliders:
            self._sliders, self.roots["sliders"].children = sliders, list(sliders.values())
        self._setting = False

    def _slider(self, parameter: Parameter, ends: Mapping[str, Any]) -> Slider:
        slider = Slider(
            title=parameter.words, format=_format(ends["end"] - ends["start"]), sizing_mode="stretch_width", **ends
        )
        slider.on_change("value", self._sliding(parameter.name, parameter.unit, fast=True))
        slider.on_change("value_throttled", self._sliding(parameter.name, parameter.unit, fast=False))
        return slider

    def _sliding(self, name: str, unit: float, fast: bool) -> Callable[[str, float, float], None]:
        def moved(_attribute: str, _old: float, new: float) -> None:
            if self._setting or self._place is None:
                return
            place, compared, changes = self._wanted[:3] if self._wanted is not None else self._place
            self.show(place, compared, {**changes, name: new * unit}, fast)

        return moved


def _format(span: float) -> str:
    """Return how a slider says its value: with the decimals that its steps have, never as 2.2k."""
    decimals = max(0, min(6, 2 - math.floor(math.log10(span))))
    return f"0[.]{'0' * decimals}" if decimals else "0"


def _text(words_: str, **styles: str) -> Div:
    return Div(text=words_, render_as_text=True, sizing_mode="stretch_width", styles={"font-size": "1rem", **styles})
