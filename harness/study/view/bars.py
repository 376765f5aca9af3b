"""Horizontal bars, which several pages have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Legend, LegendItem

from harness.reporting import style
from harness.study.view import looks


def bars(
    names: Sequence[str], groups: Sequence[tuple[str, Sequence[float]]], label: str, log: bool, title: str = ""
) -> Any:
    """Return horizontal bars, those of each group below each other, the first name on top."""
    count, chosen = len(groups), list(style.looks([g for g, _ in groups]).values())
    values = [v for _, group in groups for v in group if v > 0 and math.isfinite(v)]
    low = min(values, default=1e-3) / 2
    kind, left = ("log", low) if log else ("linear", 0.0)
    most = max([*values, low * 10])
    found = looks.plot(title, 90 + (22 + 14 * count) * len(names), tools="reset", x_axis_type=kind,
                       x_range=(left, 1.1 * most), y_range=(-0.55, len(names) - 0.45))  # fmt: skip
    items, thick = [], (1 - looks.NAME) / count
    for g, (name, group) in enumerate(groups):
        y = np.arange(len(names))[::-1] + 0.5 - looks.NAME - thick * (g + 0.5)
        right = [min(max(v, left), most) if math.isfinite(v) else most for v in group]
        source = ColumnDataSource({"y": y, "right": right, "value": list(group), "name": list(names)})
        line, tint = looks.line(chosen[g]), looks.colour(chosen[g].tint)
        drawn = found.hbar("y", right="right", left=left, height=0.8 * thick, source=source,
                           fill_color=tint, line_color=line, hatch_pattern=looks.hatch(chosen[g]), hatch_color=line,
                           hatch_alpha=0.6, hatch_scale=7)  # fmt: skip
        found.add_tools(looks.hover([drawn], ("", "@name"), (name, "@value{0.000 a}")))
        items.append(LegendItem(label={"value": name}, renderers=[drawn]))
    if count > 1:
        found.add_layout(Legend(items=items, orientation="horizontal", border_line_color=None), "above")
    looks.names_inside(found, names, left)
    found.xaxis.axis_label = label
    return found
