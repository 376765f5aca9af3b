"""The vehicle from above over a run: its path, and the vehicle to scale at the time of a slider.

Everything that follows the slider is drawn by the browser (``above.js``) from numbers that are sent once for a run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.layouts import column, row
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    CustomJSTickFormatter,
    DataRange1d,
    Div,
    FixedTicker,
    Select,
    Slider,
    Toggle,
)
from bokeh.palettes import Cividis256
from bokeh.transform import linear_cmap

from harness.common.arrays import Floats
from harness.common.series import largest
from harness.models.assembly.plan import GroundPlan
from harness.models.quantities import quantity, words
from harness.reporting.style import Look
from harness.study.motion import lateral_signal
from harness.study.replay import Replayed
from harness.view import looks
from harness.view.frame import said

FRAMES = 750
"""Moments of a run that the slider has."""

MAGNIFICATIONS = (20, 10, 5, 2, 1)
"""By which slip and sideslip angles may be drawn larger; the largest by which none is drawn above ``_WIDEST``."""

_WIDEST = np.radians(40.0)
_ARROWS: dict[str, list[Any]] = {"x0": [], "y0": [], "x1": [], "y1": [], "angle": [], "colour": [], "who": []}
_EMPTY: dict[str, dict[str, list[Any]]] = {
    "shapes": {"xs": [], "ys": [], "dash": []},
    "seen": {"xs": [], "ys": []},
    "ghosts": {"xs": [], "ys": [], "colour": [], "who": []},
    "wheels": {"xs": [], "ys": [], "use": [], "axle": []},
    "slips": _ARROWS,
    "planes": _ARROWS,
    "forces": _ARROWS,
    "moving": _ARROWS,
    "track": {"x": [], "y": []},
    "here": {"x": [], "y": [], "t": []},
}
_PLAY = """
if (cb_obj.active) {
    cb_obj.label = 'Stop';
    window.playing = setInterval(() => {
        const next = slider.value + 0.1;
        slider.value = next > slider.end ? slider.start : next;
    }, 100);
} else { cb_obj.label = 'Play'; clearInterval(window.playing); }
"""
_COLOUR_BY = """
const [unit, low, high] = JSON.parse(chosen.tags[0])[cb_obj.value];
path.data.value = path.data[cb_obj.value]; path.change.emit();
mapper.low = low; mapper.high = high; bar.title = unit;
const now = new URLSearchParams(location.search);
now.set('colour', cb_obj.value);
history.replaceState(null, '', '?' + now);
"""
_TIME_IN_ADDRESS = """
clearTimeout(window.telling);
window.telling = setTimeout(() => {
    const now = new URLSearchParams(location.search);
    now.set('time', cb_obj.value.toFixed(2));
    history.replaceState(null, '', '?' + now);
}, 400);
"""
USE = "friction use"


@dataclass(frozen=True)
class Along:
    """A number over the time of a drive.

    Attributes:
        drive: Its name.
        time: s.
        values: One for each time.
        unit: What the bar of its colours is called.
    """

    drive: str
    time: Floats
    values: Floats
    unit: str


class AboveFigure:
    """The path of a run and the vehicle on it.

    Args:
        chosen: Look by estimator.

    Attributes:
        layout: What goes into the page.
        cursor: The time of the slider, ``t``, for figures over time.
        draw: Draws the moment of the slider; for when the page is ready, if its numbers came with it.
        begin_at, begin_by: Time in s, and what the path is coloured by, that the first run is shown with.
        to_here: Moves the slider to where a figure over time is clicked.
    """

    def __init__(self, chosen: dict[str, Look]) -> None:
        self._looks = chosen
        self.cursor = ColumnDataSource({"t": []})
        self._frames = ColumnDataSource({"time": []})
        self._geometry = ColumnDataSource({"json": ["{}"]})
        self._sources = {name: ColumnDataSource(data, name=f"above {name}") for name, data in _EMPTY.items()}
        self._paths = ColumnDataSource({"xs": [], "ys": [], "colour": [], "name": []}, name="estimated paths")
        self._along: dict[str, Along] = {}
        self._run: Replayed | None = None
        self.begin_at, self._begun, self.begin_by = 0.0, False, ""
        self._path = ColumnDataSource({name: [] for name in ("x0", "y0", "x1", "y1", "value")})
        self._extent = ColumnDataSource({"x": [], "y": []})
        self._slider = Slider(title="Time in s", start=0.0, end=1.0, value=0.0, step=0.01, sizing_mode="stretch_width")
        self._play = Toggle(label="Play", width=80)
        self._by = Select(title="Path coloured by", width=330, tags=["{}"])
        self._note = Div(render_as_text=True, sizing_mode="stretch_width", stylesheets=[looks.WRAPPED])
        self._said = said("The vehicle on its path, once a run is chosen.")
        self._numbers = Div(text="", sizing_mode="stretch_width")  # filled by the browser, names as text
        code = (Path(__file__).parent / "above.js").read_text(encoding="utf-8")
        self.draw = draw = CustomJS(
            args={"frames": self._frames, "geometry": self._geometry, "slider": self._slider, "cursor": self.cursor,
                  "sources": self._sources, "numbers": self._numbers},
            code=code,
        )  # fmt: skip
        self._slider.js_on_change("value", draw, CustomJS(code=_TIME_IN_ADDRESS))
        self._frames.js_on_change("data", draw)
        self._play.js_on_change("active", CustomJS(args={"slider": self._slider}, code=_PLAY))
        self.to_here = CustomJS(
            args={"slider": self._slider},
            code="slider.value = Math.max(slider.start, Math.min(slider.end, cb_obj.x));",
        )
        self._whole: Any = None
        self.layout = column(self._said, sizing_mode="stretch_width")

    def _make(self) -> Any:
        """Return what the page shows; made for the first run, so that boxes are seen earlier."""
        widgets = row(
            self._play, self._by, sizing_mode="stretch_width", styles={"flex-wrap": "wrap", "align-items": "end"}
        )
        drive, near = self._make_map(), self._make_near()
        return column(widgets, self._slider, near, self._note, self._numbers, drive, sizing_mode="stretch_width")

    def _make_map(self) -> Any:
        mapper = linear_cmap("value", list(Cividis256), 0.0, 1.0, nan_color="#bbbbbb")
        plot = looks.plot(
            "The drive: path of the first CoG", 420, tools="pan,wheel_zoom,reset", match_aspect=True,
            name="the drive from above",
        )  # fmt: skip
        estimated = plot.multi_line(
            "xs", "ys", source=self._paths, line_color="colour", line_width=1.8, line_dash="dashed"
        )
        plot.add_tools(looks.hover([estimated], ("by", "@name")))
        path = plot.segment("x0", "y0", "x1", "y1", source=self._path, line_width=5, line_color=mapper)
        plot.patches("xs", "ys", source=self._sources["seen"], fill_color="#ffffff", line_color="#000000")
        plot.scatter(
            "x", "y", source=self._sources["here"], marker="circle", size=16, fill_color=None, line_color="#D55E00",
            line_width=2.5,
        )  # fmt: skip
        plot.x_range, plot.y_range = DataRange1d(renderers=[path]), DataRange1d(renderers=[path])
        plot.xaxis.axis_label, plot.yaxis.axis_label = "x in m, ahead at the start", "y in m, left at the start"
        bar = looks.colour_bar(plot, mapper["transform"], USE)
        args = {"path": self._path, "mapper": mapper["transform"], "bar": bar, "chosen": self._by}
        self._mapper, self._bar = mapper["transform"], bar
        self._by.js_on_change("value", CustomJS(args=args, code=_COLOUR_BY))
        plot.js_on_event(Tap, CustomJS(args={"d": self._frames, "slider": self._slider}, code="""
            let best = Infinity;
            d.data.time.forEach((t, i) => {
                const far = (d.data.x[i] - cb_obj.x) ** 2 + (d.data.y[i] - cb_obj.y) ** 2;
                if (far < best) { best = far; slider.value = t; }
            });
        """))  # fmt: skip
        return plot

    def _make_near(self) -> Any:
        plot = looks.plot(
            "The vehicle to scale", 420, tools="pan,wheel_zoom,reset", match_aspect=True, name="the vehicle from above"
        )
        sources = self._sources
        plot.line("x", "y", source=sources["track"], line_color="#bbbbbb", line_width=1.5)
        plot.patches(
            "xs", "ys", source=sources["shapes"], fill_color="#f2f2f2", fill_alpha=0.8, line_color="#333333",
            line_dash="dash",
        )  # fmt: skip
        mapper = linear_cmap("use", list(Cividis256), 0.0, 1.0, nan_color="#ffffff")
        plot.multi_line("xs", "ys", source=sources["ghosts"], line_color="colour", line_width=1.8)
        wheels = plot.patches("xs", "ys", source=sources["wheels"], fill_color=mapper, line_color="#333333")
        for name, dashes, width in (
            ("planes", "dotted", 1.2),
            ("slips", "solid", 2.2),
            ("forces", "solid", 3.2),
            ("moving", "solid", 2.6),
        ):
            plot.segment("x0", "y0", "x1", "y1", source=sources[name], line_color="colour", line_width=width,
                          line_dash=dashes)  # fmt: skip
            if name != "planes":
                plot.scatter("x1", "y1", source=sources[name], marker="triangle", angle="angle", size=9,
                              fill_color="colour", line_color="colour")  # fmt: skip
        extent = plot.scatter("x", "y", source=self._extent, size=1, alpha=0)
        plot.x_range, plot.y_range = DataRange1d(renderers=[extent]), DataRange1d(renderers=[extent])
        plot.xaxis.axis_label = "ahead of the first body's CoG in m"
        plot.yaxis.axis_label = "to the left in m"
        plot.add_tools(looks.hover([wheels], ("axle", "@axle"), ("friction use", "@use{0 %}")))
        looks.colour_bar(
            plot, mapper["transform"], USE, ticker=FixedTicker(ticks=[0, 0.25, 0.5, 0.75, 1]),
            formatter=CustomJSTickFormatter(code="return Math.round(100 * tick) + ' %'"),
        )  # fmt: skip
        return plot

    def show(self, run: Replayed) -> None:
        """Draw a run; the slider stays where it is, at first at the largest force of an axle."""
        self._run = run
        if run.motion is None or run.plan is None:
            self._say("The equations of this vehicle do not say where its axles stand: there is no view from above.")
            return
        if self._whole is None:
            self._whole = self._make()
        moves = run.motion.isel(time=np.isfinite(run.motion["x"].values).all(axis=1).nonzero()[0])
        if moves.sizes["time"] < 2:
            self._say("The vehicle leaves the range of its equations at the start: there is nothing to see from above.")
            return
        begins = np.arange(0, moves.sizes["time"], -(-moves.sizes["time"] // FRAMES))
        frames, magnified = _frames(run, moves, begins)
        self._show_path(run, moves, begins)
        force = float(np.nanmax(np.abs(moves["lateral_force"].values), initial=1.0))
        geometry = _geometry(run, self._looks) | {"magnified": magnified, "force": force}
        self._extent.data = _extent(run.plan, frames, geometry["reach"])
        self._geometry.data = {"json": [json.dumps(geometry)]}
        self._slider.end = max(self._slider.start + 0.01, float(moves["time"].values[begins[-1]]))
        if not self._begun:
            most = np.nan_to_num(np.abs(moves["lateral_force"].values)).max(axis=1)[begins]
            begin_at = self.begin_at or float(moves["time"].values[begins[int(np.argmax(most))]])
            self._slider.value, self._begun = begin_at, True
        self._slider.value = min(self._slider.value, self._slider.end)
        self._frames.data = frames
        guessed = [words(b) or "vehicle" for b, o in run.plan.outlines.items() if not o.stated]
        ends = f" The ends of the {' and the '.join(guessed)} are guessed (dashed)." if guessed else ""
        others = (
            " Coloured outlines: the second body at the articulation angle that estimators give."
            if run.plan.coupling
            else ""
        )
        large = "drawn as it is" if magnified == 1 else f"drawn {magnified} times as large"
        self._note.text = (
            f"Orange: lateral force of an axle (largest of the run: {force / 1e3:.3g} kN). Blue: direction in which an "
            f"axle moves; against its plane (dotted) that is the slip angle, {large}. Black, "
            f"and in the colour of each estimator: direction of a CoG, the sideslip angle, likewise.{others}"
            f" Wheels: lateral force over the largest that the tyre has.{ends}{self._far(run, moves)}"
        )
        if self.layout.children != [self._whole]:
            self.layout.children = [self._whole]

    def _say(self, words_: str) -> None:
        self._said.text, self.layout.children = words_, [self._said]

    def colour_also(self, along: Mapping[str, Along]) -> None:
        """Offer numbers over the time of a drive as colours of its path, by what they are."""
        before, self._along = self._along, dict(along)
        if self._run is not None and (before or along):
            self.show(self._run)

    def _far(self, run: Replayed, moves: Any) -> str:
        """Draw the paths of the estimates, and say how far from the vehicle they end."""
        last, rows = moves.sizes["time"] - 1, np.linspace(0, moves.sizes["time"] - 1, FRAMES).astype(int)
        names, apart = list(run.paths), []
        for name, (x, y) in run.paths.items():
            off = np.hypot(x[last] - moves["x"].values[last, 0], y[last] - moves["y"].values[last, 0])
            if np.isfinite(off):
                apart.append(f"{name} {off:.3g} m")
        self._paths.data = {
            "xs": [run.paths[n][0][rows] for n in names], "ys": [run.paths[n][1][rows] for n in names],
            "colour": [looks.line(self._looks[n]) for n in names], "name": names,
        }  # fmt: skip
        if not names:
            return ""
        ends = f"; they end away from it by: {', '.join(apart)}" if apart else ""
        return f" Broken lines on the drive: where the estimates of its motion would lead the vehicle{ends}."

    def _show_path(self, run: Replayed, moves: Any, begins: np.ndarray) -> None:
        """Fill the path and what it may be coloured by."""
        x, y = (moves[n].values[begins, 0] for n in ("x", "y"))
        by: dict[str, Floats] = {}
        if np.isfinite(moves["friction_use"].values).any():
            by[USE] = np.nanmax([largest(u, begins) for u in moves["friction_use"].values.T], axis=0)
        units = {USE: USE}
        for target in map(str, run.data["target"].values[: len(run.study.targets)]):
            q, own = quantity(target), run.data.sel(target=target)
            for estimator in map(str, run.data["estimator"].values):
                estimate = own["estimate"].sel(estimator=estimator).values
                error = np.abs(estimate - own["truth"].values)[: moves.sizes["time"]]
                key = f"error of {estimator}: {q.words}"
                by[key], units[key] = q.scale * largest(error, begins), f"error in {q.unit}" if q.unit else "error"
        for key, along in self._along.items():
            if along.drive == run.study.drives[0].name:
                by[key] = np.interp(moves["time"].values[begins], along.time, along.values)
                units[key] = along.unit
        ends = {
            k: [units[k], 0.0, 1.0 if k == USE else max(float(np.nanmax(v, initial=0.0)), 1e-9)] for k, v in by.items()
        }
        key = next(k for k in (self.begin_by, self._by.value, *by) if k in by)
        self.begin_by = self.begin_by if self.begin_by not in by else ""
        self._path.data = {"x0": x[:-1], "y0": y[:-1], "x1": x[1:], "y1": y[1:], "value": by[key][:-1]} | {
            k: v[:-1] for k, v in by.items()
        }
        self._by.options, self._by.tags, self._by.value = list(by), [json.dumps(ends)], key
        self._bar.title, self._mapper.low, self._mapper.high = ends[key]


def _frames(run: Replayed, moves: Any, begins: np.ndarray) -> tuple[dict[str, Floats], int]:
    """Return what the browser draws at each moment, and by how much angles are magnified."""
    estimates, model = run.data["estimate"], run.study.plant.model()
    frames = {n: moves[n].values[begins, 0] for n in ("x", "y", "heading")}
    names = {
        "slip": "slip_angle",
        "force": "lateral_force",
        "load": "vertical_load",
        "use": "friction_use",
        "steer": "steer",
    }
    for k in range(moves.sizes["axle"]):
        frames |= {f"{short} {k}": moves[name].values[begins, k] for short, name in names.items()}
    targets, count = set(map(str, run.data["target"].values)), run.data.sizes["estimator"]
    nothing = np.full(len(begins), np.nan)
    if moves.sizes["body"] > 1:
        frames["articulation"] = (moves["heading"].values[:, 1] - moves["heading"].values[:, 0])[begins]
        for k in range(count):
            estimated = "articulation_angle" in targets
            frames[f"articulation {k}"] = (
                estimates.sel(target="articulation_angle").values[begins, k] if estimated else nothing
            )
    for i, body in enumerate(map(str, moves["body"].values)):
        speed = np.maximum(moves["speed"].values[begins, i], 0.3)
        frames[f"sideslip {i}"] = np.arctan2(moves["lateral_velocity"].values[begins, i], speed)
        name = lateral_signal(model, body)
        for k in range(count):
            own = estimates.sel(target=name).values[begins, k] if name in targets else nothing
            frames[f"sideslip {i} {k}"] = np.arctan2(own, speed)
    angles = [np.abs(v) for n, v in frames.items() if n.startswith("slip ") or n in ("sideslip 0", "sideslip 1")]
    most = max((float(np.nanmax(a)) for a in angles if np.isfinite(a).any()), default=0.0)
    magnified = next((m for m in MAGNIFICATIONS if m * most <= _WIDEST), 1)
    numbers = {name: np.asarray(values, dtype=np.float32) for name, values in frames.items()}
    return {"time": moves["time"].values[begins], **numbers}, magnified


def _geometry(run: Replayed, chosen: dict[str, Look]) -> dict[str, Any]:
    """Return what of the vehicle stays the same over the run."""
    plan = run.plan
    assert plan is not None
    first, bodies = next(iter(plan.outlines.values())), list(plan.outlines)
    length = first.front - first.back
    return {
        "coupling": plan.coupling,
        "outlines": [
            {"name": words(b), "back": o.back, "front": o.front, "width": o.width, "stated": o.stated}
            for b, o in plan.outlines.items()
        ],
        "axles": [{"name": words(n), "body": bodies.index(a.body), "x": a.x, "y": a.y} for n, a in plan.axles.items()],
        "estimators": [{"name": str(e), "colour": looks.line(chosen[str(e)])} for e in run.data["estimator"].values],
        "wheel": min(0.17 * length, 1.0),
        "reach": 0.28 * length,
    }


def _extent(plan: GroundPlan, frames: Mapping[str, Floats], reach: float) -> dict[str, list[float]]:
    """Return the corners of what the vehicle, true or estimated, ever takes up in the axes of its first body."""
    first, *others = plan.outlines.values()
    x, y = [first.front + reach, first.back - reach], [first.width / 2 + 2 * reach, -first.width / 2 - 2 * reach]
    if others and plan.coupling is not None:
        turned = np.concatenate([np.ravel(v) for n, v in frames.items() if n.startswith("articulation")])
        theta = turned[np.isfinite(turned)]
        length = others[0].back - plan.coupling[1] - reach / 2
        for side in (-others[0].width / 2, others[0].width / 2):
            ahead = plan.coupling[0] + length * np.cos(theta) - side * np.sin(theta)
            sideways = length * np.sin(theta) + side * np.cos(theta)
            x, y = [*x, *ahead.tolist()], [*y, *sideways.tolist()]
    return {"x": [min(x), max(x)], "y": [min(y), max(y)]}
