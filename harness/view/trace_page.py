"""The page of a trace: what is missing, how likely, where, and what each candidate would have changed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from bokeh.document import Document
from bokeh.layouts import row
from bokeh.models import ColumnDataSource, FixedTicker

from harness.common.series import unpacked
from harness.models.quantities import quantity, words
from harness.reporting import style
from harness.view import looks
from harness.view.bars import bars, changes
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
    found = read_record(folder / "trace.json")
    file = folder / "drives.npz"
    series = unpacked(file) if file.exists() else {}

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()

        def told(drive: int, output: int) -> None:
            address.value = "?" + urlencode({"drive": drive, "output": output})

        parts = _drives(found, series, given, told) + _where(found) + _likely(found) + _candidates(found)
        answer = [str(found.get("answer", "")), *_errors(found)]
        put_parts(document, f"What does the model lack? {folder.name}", answer, parts, address)

    return put


def _errors(found: Mapping[str, Any]) -> list[str]:
    """Say by how much the simulation error falls on the held-out drives."""
    lines = []
    for name, error in (found.get("error") or {}).items():
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


def _likely(found: Mapping[str, Any]) -> list[Part]:
    posterior = found.get("posterior")
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
    found: Mapping[str, Any], series: Series, given: Mapping[str, str], told: Callable[[int, int], None]
) -> list[Part]:
    if not series:
        old = "This trace kept no drives over time (drives.npz): run harness trace again to see them."
        return [Part("Before and after", [said(old)])]
    held = [str(n) for n in found.get("held_out") or ()]
    chosen = index_of(given.get("drive"), len(series)) or 0, index_of(given.get("output"), 99) or 0
    figure = DrivesFigure(series, held, chosen, told)
    hint = "The model simulates over the recorded inputs alone. A click on a name in the legend hides its line."
    return [Part("Before and after", [figure.layout], hint)]


def _where(found: Mapping[str, Any]) -> list[Part]:
    plan, ranked = found.get("vehicle"), [{**r, "rank": k} for k, r in enumerate(found.get("pinpoint") or [], 1)]
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
    found: list[tuple[str, int]] = []
    for record in placed:
        kind, x = _row(record), float(record["ahead_of_first_cog"])
        levels = taken.setdefault(kind, [])
        free = (k for k, there in enumerate(levels) if all(abs(x - other) > _NEAR * wide for other in there))
        level = next(free, len(levels))
        if level == len(levels):
            levels.append([])
        levels[level].append(x)
        found.append((kind, level))
    reach, bottom = {}, 0.0
    for kind in _ROWS:
        count = max(len(taken.get(kind, ())), int(kind == _ON_VEHICLE))
        if count:
            around = 0.5 if kind == _ON_VEHICLE else 0.0  # of the vehicle, with its wheels
            reach[kind] = bottom + around, bottom + around + count
            bottom += count + 2 * around
    return [reach[kind][0] + level + 0.5 for kind, level in found], reach


def _vehicle(plan: Mapping[str, Any], placed: Sequence[Mapping[str, Any]]) -> Any:
    """Return the vehicle from above with a circle per input, its area proportional to the gain."""
    ends = [b[k] for b in plan["bodies"].values() for k in ("back", "front")]
    heights, reach = _levels(placed, max(ends) - min(ends))
    top = max(high for _, high in reach.values()) + (0.5 if list(reach)[-1] == _ON_VEHICLE else 0.0)
    found = looks.plot("It drives to the right", 100 + round(_LEVEL * top), tools="pan,wheel_zoom,reset",
                       y_range=(-0.1, top + 0.1), name="place on the vehicle")  # fmt: skip
    low, high = reach[_ON_VEHICLE][0] - 0.15, reach[_ON_VEHICLE][1] + 0.15
    for body in plan["bodies"].values():
        dashes = "solid" if body["stated"] else "dashed"
        found.quad(body["back"], body["front"], high, low, fill_color="#f2f2f2", line_color="#333333", line_dash=dashes)
    for axle in plan["axles"].values():
        for side in (low, high):
            found.rect(axle["x"], side, 0.8, 0.24, fill_color="#555555", line_color="#333333")
    if plan["coupling"] is not None:
        found.scatter(plan["coupling"], (low + high) / 2, marker="x", size=12, color="#000000", line_width=2)
    most = max(r["log_likelihood_gain"] for r in placed)
    source = ColumnDataSource({
        "x": [float(r["ahead_of_first_cog"]) for r in placed], "y": heights,
        "size": [8 + (_LARGEST - 8) * math.sqrt(r["log_likelihood_gain"] / most) for r in placed],
        "name": [words(r["channel"]) for r in placed], "before": [r["log_likelihood_gain"] for r in placed],
        "after": [r["log_likelihood_gain_after"] or 0.0 for r in placed], "rank": [str(r["rank"]) for r in placed],
    })  # fmt: skip
    look = style.looks(["gain"])["gain"]
    marks = found.scatter(
        "x", "y", size="size", source=source, fill_color=looks.colour(look.tint), fill_alpha=0.85,
        line_color=looks.line(look),
    )  # fmt: skip
    found.text("x", "y", "rank", source=source, text_align="center", text_baseline="middle", text_font_size="13px")
    found.add_tools(looks.hover([marks], ("", "@name"), ("gain before", "@before{0.0 a}"), ("after", "@after{0.0 a}")))
    middles = {(below + above) / 2: kind for kind, (below, above) in reach.items()}
    found.yaxis.ticker = FixedTicker(ticks=sorted(middles))  # of others not all get their label
    found.yaxis.major_label_overrides = middles
    found.xaxis.axis_label = "ahead of the first body's CoG in m"
    return found


def _candidates(found: Mapping[str, Any]) -> list[Part]:
    candidates = found.get("candidates") or []
    if not candidates:
        return []
    fitted = [c for c in candidates if c["fitted"] and c["held_out_excess_by_output"]]
    models: list[Any] = []
    before = {i: r["held_out_excess_by_output"] for i, r in enumerate(found.get("rounds") or [], 1)}
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
            title = f"{q[:1].upper()}{q[1:]}"
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
