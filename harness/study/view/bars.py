"""Horizontal bars and tables, which several pages have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, DataTable, FixedTicker, Legend, LegendItem, StringFormatter, TableColumn

from harness.reporting import style
from harness.study.view import looks


def bars(names: Sequence[str], groups: Sequence[tuple[str, Sequence[float]]], label: str, log: bool) -> Any:
    """Return horizontal bars, those of each group beside each other, the first name on top."""
    count, chosen = len(groups), list(style.looks([g for g, _ in groups]).values())
    values = [v for _, group in groups for v in group if v > 0 and math.isfinite(v)]
    low = min(values, default=1e-3) / 2
    kind, left = ("log", low) if log else ("linear", 0.0)
    most = max([*values, low * 10])
    found = looks.plot("", 90 + 20 * len(names) * count, tools="reset", x_axis_type=kind,
                       x_range=(left, 1.1 * most), y_range=(-0.6, len(names) - 0.4))  # fmt: skip
    items, thick = [], 0.8 / count
    for g, (name, group) in enumerate(groups):
        y = np.arange(len(names))[::-1] + 0.4 - thick * (g + 0.5)
        right = [min(max(v, left), most) if math.isfinite(v) else most for v in group]
        source = ColumnDataSource({"y": y, "right": right, "value": list(group), "name": list(names)})
        line, tint = looks.colour(chosen[g].line), looks.colour(chosen[g].tint)
        drawn = found.hbar("y", right="right", left=left, height=0.9 * thick, source=source,
                           fill_color=tint, line_color=line, hatch_pattern=looks.hatch(chosen[g]), hatch_color=line,
                           hatch_alpha=0.6, hatch_scale=7)  # fmt: skip
        found.add_tools(looks.hover([drawn], ("", "@name"), (name, "@value{0.000 a}")))
        items.append(LegendItem(label={"value": name}, renderers=[drawn]))
    if count > 1:
        found.add_layout(Legend(items=items, orientation="horizontal", border_line_color=None), "above")
    found.yaxis.ticker = FixedTicker(ticks=list(range(len(names))))
    found.yaxis.major_label_overrides = {len(names) - 1 - i: str(name) for i, name in enumerate(names)}
    found.ygrid.grid_line_color = None
    found.xaxis.axis_label = label
    return found


def table(columns: Mapping[str, Sequence[str]], height: int) -> DataTable:
    """Return a table whose headings sort it; its texts are shown as they are."""
    return DataTable(
        source=ColumnDataSource({k: list(v) for k, v in columns.items()}), index_position=None, height=height,
        sizing_mode="stretch_width", fit_columns=True,
        min_width=280, reorderable=False,
        columns=[TableColumn(field=k, title=k, formatter=StringFormatter()) for k in columns],
    )  # fmt: skip
