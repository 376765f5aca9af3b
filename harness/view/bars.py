"""Rows of numbers as figures, which several pages have: horizontal bars, and values before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, LegendItem

from harness.reporting import style
from harness.view import looks

_ROW = 36
"""Pixels of a row with its name and one bar."""


def bars(names: Sequence[str], groups: Sequence[tuple[str, Sequence[float]]], label: str) -> Any:
    """Return horizontal bars from zero, those of each group below each other, the first name on top."""
    count, chosen = len(groups), list(style.looks([g for g, _ in groups]).values())
    most = max((v for _, group in groups for v in group if math.isfinite(v)), default=0.0) or 1.0
    found = _rows("", names, _ROW + 14 * (count - 1), label, x_range=(0.0, 1.1 * most))
    items, thick = [], (1 - looks.NAME) / count
    for g, (name, group) in enumerate(groups):
        y = np.arange(len(names))[::-1] + 0.5 - looks.NAME - thick * (g + 0.5)
        right = [v if math.isfinite(v) else most for v in group]
        source = ColumnDataSource({"y": y, "right": right, "value": list(group), "name": list(names)})
        line, tint = looks.line(chosen[g]), looks.colour(chosen[g].tint)
        drawn = found.hbar("y", right="right", left=0.0, height=0.8 * thick, source=source,
                           fill_color=tint, line_color=line, hatch_pattern=looks.hatch(chosen[g]), hatch_color=line,
                           hatch_alpha=0.6, hatch_scale=7)  # fmt: skip
        found.add_tools(looks.hover([drawn], ("", "@name"), (name, "@value{0.000 a}")))
        items.append(LegendItem(label={"value": name}, renderers=[drawn]))
    if count > 1:
        looks.legend_above(found, items)
    return found


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
    found = _rows(title, names, _ROW, label, x_axis_type="log", x_range=(low, high))
    y = np.arange(len(names))[::-1] - 0.4 * looks.NAME
    ends = np.clip(np.where(np.isfinite(array), array, high), low * 1.02, high)
    source = ColumnDataSource(
        {"y": y, "name": list(names), "first": ends[:, 0], "second": ends[:, 1], "before": array[:, 0],
         "after": array[:, 1]}
    )  # fmt: skip
    found.segment("first", "y", "second", "y", source=source, line_width=1.6, line_color="#777777")
    items = []
    for k, (side, look) in enumerate(style.looks(list(sides)).items()):
        known = ColumnDataSource({k_: np.asarray(v)[np.isfinite(array[:, k])] for k_, v in source.data.items()})
        drawn = found.scatter(("first", "second")[k], "y", source=known, size=9, marker=("circle", "square")[k],
                              fill_color=looks.line(look), line_color=looks.line(look))  # fmt: skip
        found.add_tools(
            looks.hover([drawn], ("", "@name"), (sides[0], "@before{0.000 a}"), (sides[1], "@after{0.000 a}"))
        )
        items.append(LegendItem(label={"value": side}, renderers=[drawn]))
    lost = ~np.isfinite(array[:, 1])
    found.text([high] * int(lost.sum()), y[lost], [f"{sides[1]}: no finite value"] * int(lost.sum()),
               text_align="right", text_baseline="middle", text_font_size="12px", text_font=looks.FONT, x_offset=-6,
               background_fill_color="#ffffff", padding=2)  # fmt: skip
    looks.legend_above(found, items)
    return found


def _rows(title: str, names: Sequence[str], row: int, label: str, **further: Any) -> Any:
    """Return a figure with a row for each name."""
    found = looks.plot(
        title, 90 + row * len(names), tools="reset", y_range=(-0.55, len(names) - 0.45), frame_align=False, **further
    )
    looks.names_inside(found, names, found.x_range.start)
    found.xaxis.axis_label, found.xaxis.formatter = label, looks.plain_ticks()
    return found
