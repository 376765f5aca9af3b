"""The page of a trace: what is missing, how likely, where, and what each candidate would have changed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.layouts import row
from bokeh.models import ColumnDataSource, FixedTicker, LegendItem

from harness.common.series import unpacked
from harness.models.quantities import capital, quantity, words
from harness.reporting import style
from harness.view import looks
from harness.view.drives_figure import DrivesFigure, Series
from harness.view.frame import Part, address_bar, arguments_of, index_of, put_parts, read_record, said
from harness.view.tables import table

SHOWN = 20
"""Hypotheses and candidates that are drawn; the table has all."""

SMALL = 0.001
"""Probability below which a hypothesis is not drawn."""

NONE = "none of these"


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of a trace into a document.

    Args:
        folder: With ``trace.json`` and, of a trace of this version, ``drives.npz``.

    Raises:
        UserError: If they cannot be read.
    """
    record = read_record(folder / "trace.json")
    file = folder / "drives.npz"
    series = unpacked(file) if file.exists() else {}

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()

        def keep(drive: int, output: int) -> None:
            address.value = "?" + urlencode({"drive": drive, "output": output})

        parts = _drives(record, series, given, keep) + _where(record) + _likely(record) + _candidates(record)
        answer = [str(record.get("answer", "")), *_errors(record)]
        put_parts(document, f"What does the model lack? {folder.name}", answer, parts, address)

    return put


def _errors(record: Mapping[str, Any]) -> list[str]:
    """Say by how much the simulation error falls on the held-out drives."""
    lines = []
    for name, error in (record.get("error") or {}).items():
        q = quantity(name)
        pair = [error.get(side) for side in ("before", "after")]
        if all(isinstance(v, (int, float)) for v in pair):
            before, after = (style.with_unit(q.scale * v, q.unit) for v in pair)
            lines.append(f"Simulation error of the {q.words} on the held-out drives: {before} before, {after} after.")
    return lines


def called(name: str) -> str:
    """Return a hypothesis in words."""
    effect, _, place = name.partition("@")
    return f"{words(effect)}, {words(place)}" if place else words(effect)


def _likely(record: Mapping[str, Any]) -> list[Part]:
    posterior = record.get("posterior")
    if not posterior:
        return []
    rows = [(called(h["name"]), float(h["probability"])) for h in posterior["hypotheses"]][:SHOWN]
    rows = sorted([*rows, (NONE, float(posterior["none_of_these"]))], key=lambda row: -row[1])
    rows = [r for r in rows if r[1] >= SMALL] or rows[:1]
    plot = bars([name for name, _ in rows], [("probability", [p for _, p in rows])], "probability")
    plot.x_range.start, plot.x_range.end = 0.0, 1.02
    models = posterior["models"][:SHOWN]
    listed = [
        (" + ".join(" or ".join(called(h["name"]) for h in alike) for alike in m["added"]) or "nothing is added",
         _probability(float(m["probability"])))
        for m in models
    ]  # fmt: skip
    return [
        Part(
            "How likely is each?",
            [
                plot,
                table({"model": [a for a, _ in listed], "probability": [b for _, b in listed]}),
            ],
            "Posterior probability that a hypothesis is part of the model, over all models that were fitted; those of "
            "less than 0.001 are not drawn.",
        )
    ]


def _drives(
    record: Mapping[str, Any], series: Series, given: Mapping[str, str], keep: Callable[[int, int], None]
) -> list[Part]:
    if not series:
        old = "This trace kept no drives over time (drives.npz): run harness trace again to see them."
        return [Part("Before and after", [said(old)])]
    held = [str(n) for n in record.get("held_out") or ()]
    chosen = index_of(given.get("drive"), len(series)) or 0, index_of(given.get("output"), 99) or 0
    figure = DrivesFigure(series, held, chosen, keep)
    hint = "The model simulates over the recorded inputs alone. A click on a name in the legend hides its line."
    return [Part("Before and after", [figure.layout], hint)]


def _where(record: Mapping[str, Any]) -> list[Part]:
    plan, ranked = record.get("vehicle"), [{**r, "rank": k} for k, r in enumerate(record.get("pinpoint") or [], 1)]
    placed = [r for r in ranked if r.get("ahead_of_first_cog") is not None and (r["log_likelihood_gain"] or 0) > 0]
    if not ranked:
        return []
    shown = [r for r in ranked if max(r["log_likelihood_gain"] or 0, r["log_likelihood_gain_after"] or 0) > 0][:SHOWN]
    pair = [("before", [r["log_likelihood_gain"] or 0.0 for r in shown]),
            ("after", [r["log_likelihood_gain_after"] or 0.0 for r in shown])]  # fmt: skip
    names = [f"{r['rank']}: {words(r['channel'])}" for r in shown]
    models: list[Any] = [] if plan is None or not placed else [_vehicle(plan, placed)]
    models.append(bars(names, pair, "gain in log-likelihood"))
    hint = (
        "Where an unknown, slowly varying disturbance would explain most of the innovations: the area says how much, "
        "and the numbers are those of the list."
    )
    return [Part("Where on the vehicle?", models, hint)]


_ON_VEHICLE = "tyres and steering"
_ROWS = ("sensor", "equation", _ON_VEHICLE, "force", "yaw moment", "other")
"""Kinds of inputs from below; those that act on tyres and steering are drawn on the vehicle itself."""

_LEVEL, _LARGEST = 38, 34
"""Pixels from one mark to the next above it, and of the largest mark."""

_NEAR = 0.2
"""Share of the vehicle's length within which marks would cover each other on a phone."""


def _row(record: Mapping[str, Any]) -> str:
    if record["kind"] != "port":
        return str(record["kind"])
    if "_axle_" in record["ports"][0] or record["channel"] == "road_wheel_angle":
        return _ON_VEHICLE
    return {"N": "force", "N*m": "yaw moment"}.get(record["unit"], "other")


def _levels(placed: Sequence[Mapping[str, Any]], wide: float) -> tuple[list[float], dict[str, tuple[float, float]]]:
    """Return how high each input is drawn, none over another, and from where to where each kind of them reaches.

    Args:
        placed: Inputs.
        wide: Length of the vehicle, m.
    """
    taken: dict[str, list[list[float]]] = {}
    rows: list[tuple[str, int]] = []
    for record in placed:
        kind, x = _row(record), float(record["ahead_of_first_cog"])
        levels = taken.setdefault(kind, [])
        free = (k for k, there in enumerate(levels) if all(abs(x - other) > _NEAR * wide for other in there))
        level = next(free, len(levels))
        if level == len(levels):
            levels.append([])
        levels[level].append(x)
        rows.append((kind, level))
    reach, bottom = {}, 0.0
    for kind in _ROWS:
        count = max(len(taken.get(kind, ())), int(kind == _ON_VEHICLE))
        if count:
            around = 0.5 if kind == _ON_VEHICLE else 0.0  # of the vehicle, with its wheels
            reach[kind] = bottom + around, bottom + around + count
            bottom += count + 2 * around
    return [reach[kind][0] + level + 0.5 for kind, level in rows], reach


def _vehicle(plan: Mapping[str, Any], placed: Sequence[Mapping[str, Any]]) -> Any:
    """Return the vehicle from above with a circle per input, its area proportional to the gain."""
    ends = [b[k] for b in plan["bodies"].values() for k in ("back", "front")]
    heights, reach = _levels(placed, max(ends) - min(ends))
    top = max(high for _, high in reach.values()) + (0.5 if list(reach)[-1] == _ON_VEHICLE else 0.0)
    plot = looks.plot("It drives to the right", 100 + round(_LEVEL * top), tools="pan,wheel_zoom,reset",
                       y_range=(-0.1, top + 0.1), name="place on the vehicle")  # fmt: skip
    low, high = reach[_ON_VEHICLE][0] - 0.15, reach[_ON_VEHICLE][1] + 0.15
    for body in plan["bodies"].values():
        dashes = "solid" if body["stated"] else "dashed"
        plot.quad(body["back"], body["front"], high, low, fill_color="#f2f2f2", line_color="#333333", line_dash=dashes)
    for axle in plan["axles"].values():
        for side in (low, high):
            plot.rect(axle["x"], side, 0.8, 0.24, fill_color="#555555", line_color="#333333")
    if plan["coupling"] is not None:
        plot.scatter(plan["coupling"], (low + high) / 2, marker="x", size=12, color="#000000", line_width=2)
    most = max(r["log_likelihood_gain"] for r in placed)
    source = ColumnDataSource({
        "x": [float(r["ahead_of_first_cog"]) for r in placed], "y": heights,
        "size": [8 + (_LARGEST - 8) * math.sqrt(r["log_likelihood_gain"] / most) for r in placed],
        "name": [words(r["channel"]) for r in placed], "before": [r["log_likelihood_gain"] for r in placed],
        "after": [r["log_likelihood_gain_after"] or 0.0 for r in placed], "rank": [str(r["rank"]) for r in placed],
    })  # fmt: skip
    look = style.looks(["gain"])["gain"]
    marks = plot.scatter(
        "x", "y", size="size", source=source, fill_color=looks.colour(look.tint), fill_alpha=0.85,
        line_color=looks.line(look),
    )  # fmt: skip
    plot.text("x", "y", "rank", source=source, text_align="center", text_baseline="middle", text_font_size="13px")
    plot.add_tools(looks.hover([marks], ("", "@name"), ("gain before", "@before{0.0 a}"), ("after", "@after{0.0 a}")))
    middles = {(below + above) / 2: kind for kind, (below, above) in reach.items()}
    plot.yaxis.ticker = FixedTicker(ticks=sorted(middles))  # of others not all get their label
    plot.yaxis.major_label_overrides = middles
    plot.xaxis.axis_label = "ahead of the first body's CoG in m"
    return plot


def _candidates(record: Mapping[str, Any]) -> list[Part]:
    candidates = record.get("candidates") or []
    if not candidates:
        return []
    fitted = [c for c in candidates if c["fitted"] and c["held_out_excess_by_output"]]
    models: list[Any] = []
    before = {i: r["held_out_excess_by_output"] for i, r in enumerate(record.get("rounds") or [], 1)}
    if fitted:
        shown = fitted[:SHOWN]
        names = [f"round {c['round']}: {called(c['name'])}" for c in shown]
        figures = []
        for output in fitted[0]["held_out_excess_by_output"]:
            pairs = [
                (_finite(before.get(c["round"], {}).get(output)), _finite(c["held_out_excess_by_output"].get(output)))
                for c in shown
            ]
            q = quantity(output).words
            title = f"{capital(q)}"
            figures.append(changes(names, ("without it", "with it"), pairs, "normalised excess MSE", title))
            figures[-1].styles = {"flex": "1 1 340px"}
        models.append(row(*figures, sizing_mode="stretch_width", styles={"flex-wrap": "wrap"}))
    rows: dict[str, list[str]] = {
        k: [] for k in ("round", "candidate", "kind", "gain in BIC", "held-out excess", "fitted")
    }
    for c in candidates:
        values = (str(c["round"]), called(c["name"]), c["kind"], _number(c["bic_gain"]), _number(c["held_out_excess"]),
                  "yes" if c["fitted"] else "predicted by the score test")  # fmt: skip
        for key, value in zip(rows, values, strict=True):
            rows[key].append(str(value))
    models.append(table(rows))
    hint = (
        "Normalised excess MSE: mean square of the simulation error on the held-out drives over the floor of the "
        "sensors' noise, less one."
    )
    return [Part("What would each candidate have changed?", models, hint)]


def _finite(value: Any) -> float:
    """Return a number of a record, NaN for none."""
    return float(value) if isinstance(value, (int, float)) else math.nan


def _probability(value: float) -> str:
    """Return a probability; of a small one that it is small."""
    return style.number(value) if value >= SMALL else f"< {SMALL:g}"


def _number(value: Any) -> str:
    return style.number(float(value)) if isinstance(value, (int, float)) else "–"


_ROW = 36
"""Pixels of a row with its name and one bar."""


def bars(names: Sequence[str], groups: Sequence[tuple[str, Sequence[float]]], label: str) -> Any:
    """Return horizontal bars from zero, those of each group below each other, the first name on top."""
    count, chosen = len(groups), list(style.looks([g for g, _ in groups]).values())
    most = max((v for _, group in groups for v in group if math.isfinite(v)), default=0.0) or 1.0
    plot = _rows("", names, _ROW + 14 * (count - 1), label, x_range=(0.0, 1.1 * most))
    items, thick = [], (1 - looks.NAME) / count
    for g, (name, group) in enumerate(groups):
        y = np.arange(len(names))[::-1] + 0.5 - looks.NAME - thick * (g + 0.5)
        right = [v if math.isfinite(v) else most for v in group]
        source = ColumnDataSource({"y": y, "right": right, "value": list(group), "name": list(names)})
        line, tint = looks.line(chosen[g]), looks.colour(chosen[g].tint)
        drawn = plot.hbar("y", right="right", left=0.0, height=0.8 * thick, source=source,
                           fill_color=tint, line_color=line, hatch_pattern=looks.hatch(chosen[g]), hatch_color=line,
                           hatch_alpha=0.6, hatch_scale=7)  # fmt: skip
        plot.add_tools(looks.hover([drawn], ("", "@name"), (name, "@value{0.000 a}")))
        items.append(LegendItem(label={"value": name}, renderers=[drawn]))
    if count > 1:
        looks.legend_above(plot, items)
    return plot


def changes(
    names: Sequence[str], sides: tuple[str, str], values: Sequence[tuple[float, float]], label: str, title: str
) -> Any:
    """Return what each of several changed: a value before and one after, joined by a line, on a logarithmic axis.

    Args:
        names: Of the rows, the first on top.
        sides: What the two values are called.
        values: Both of each row; not finite where a simulation left its range, which is said at the right end, and what
            is not positive stands at the left end.
        label: Of the axis.
        title: Of the figure.
    """
    array = np.array(values, dtype=float).reshape(-1, 2)
    positive = array[np.isfinite(array) & (array > 0)]
    low, high = (positive.min() / 1.6, positive.max() * 1.6) if positive.size else (0.1, 1.0)
    plot = _rows(title, names, _ROW, label, x_axis_type="log", x_range=(low, high))
    y = np.arange(len(names))[::-1] - 0.4 * looks.NAME
    ends = np.clip(np.where(np.isfinite(array), array, high), low * 1.02, high)
    source = ColumnDataSource(
        {"y": y, "name": list(names), "first": ends[:, 0], "second": ends[:, 1], "before": array[:, 0],
         "after": array[:, 1]}
    )  # fmt: skip
    plot.segment("first", "y", "second", "y", source=source, line_width=1.6, line_color="#777777")
    items = []
    for k, (side, look) in enumerate(style.looks(list(sides)).items()):
        finite = ColumnDataSource({k_: np.asarray(v)[np.isfinite(array[:, k])] for k_, v in source.data.items()})
        drawn = plot.scatter(("first", "second")[k], "y", source=finite, size=9, marker=("circle", "square")[k],
                              fill_color=looks.line(look), line_color=looks.line(look))  # fmt: skip
        plot.add_tools(
            looks.hover([drawn], ("", "@name"), (sides[0], "@before{0.000 a}"), (sides[1], "@after{0.000 a}"))
        )
        items.append(LegendItem(label={"value": side}, renderers=[drawn]))
    lost = ~np.isfinite(array[:, 1])
    plot.text([high] * int(lost.sum()), y[lost], [f"{sides[1]}: no finite value"] * int(lost.sum()),
               text_align="right", text_baseline="middle", text_font_size="12px", text_font=looks.FONT, x_offset=-6,
               background_fill_color="#ffffff", padding=2)  # fmt: skip
    looks.legend_above(plot, items)
    return plot


def _rows(title: str, names: Sequence[str], row: int, label: str, **further: Any) -> Any:
    """Return a figure with a row for each name."""
    plot = looks.plot(
        title, 90 + row * len(names), tools="reset", y_range=(-0.55, len(names) - 0.45), frame_align=False, **further
    )
    looks.names_inside(plot, names, plot.x_range.start)
    plot.xaxis.axis_label, plot.xaxis.formatter = label, looks.plain_ticks()
    return plot
