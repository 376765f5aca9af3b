"""Where a run is informative: the width of the posterior by lateral acceleration.

The stated uncertainty of a quantity stays or grows where the measurements do not show it, and falls where they do. For
a car's friction that is the case near the limit of the tyres (Lex 2015), so the section is there for runs that were
drawn with a lateral acceleration.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.models.quantities import Quantity, quantity
from harness.reporting import style
from harness.reporting.document import Block, Prose, Sheet, plain
from harness.study.report.analysis import Analysis
from harness.study.results import run_in_words

EDGES = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, np.inf)
"""m/s^2; borders of the classes."""

WINDOW = 2.0
"""s; a sample belongs to the class of the largest acceleration in this time before it, as estimates have memory."""

SHOWN = 2.0
"""A quantity counts as shown by a class if its stated standard deviation is that many times below the widest."""

_SPARSE = 0.5  # s; shorter stays in a class say nothing


def blocks(analysis: Analysis) -> list[Block]:
    """Return a table for each run drawn with a lateral acceleration and stated uncertainties; else nothing."""
    return [block for data in analysis.store.histories for block in _run(data)]


def classes(data: xr.Dataset) -> tuple[NDArray[np.intp], str] | None:
    """Return the class of each sample and the name of the acceleration; nothing without one.

    The acceleration is the true one, of a car or, for a combination, of the tractor.
    """
    names = [str(t) for t in data["target"].values]
    wanted = [n for n in ("lateral_acceleration", "lateral_acceleration_tractor") if n in names]
    if not wanted:
        return None
    acceleration = np.abs(data["truth"].sel(target=wanted[0]).values)
    time = data["time"].values
    if not np.isfinite(acceleration).all() or len(time) < 2:
        return None
    samples = max(1, round(WINDOW / float(time[1] - time[0])))
    padded = np.concatenate([np.zeros(samples - 1), acceleration])
    largest = np.lib.stride_tricks.sliding_window_view(padded, samples).max(axis=-1)
    return np.digitize(largest, EDGES[1:-1]), wanted[0]


def widths(data: xr.Dataset, target: str, number: NDArray[np.intp]) -> dict[str, list[float]]:
    """Return the median standard deviation that each estimator states by class, in SI; NaN for a class hardly seen.

    Args:
        data: The run.
        target: Name of the quantity.
        number: From ``classes``.
    """
    step = float(data["time"].values[1] - data["time"].values[0])
    by_estimator: dict[str, list[float]] = {}
    for name in data["estimator"].values:
        std = data["std"].sel(target=target, estimator=name).values
        if not np.isfinite(std).any() or not np.nanmax(std) > 0:
            continue
        row = []
        for kind in range(len(EDGES) - 1):
            mine = std[(number == kind) & np.isfinite(std)]
            row.append(float(np.median(mine)) if len(mine) * step >= _SPARSE else np.nan)
        by_estimator[str(name)] = row
    return by_estimator


def _label(kind: int) -> str:
    low, high = EDGES[kind], EDGES[kind + 1]
    return f"above {low:g}" if np.isinf(high) else f"{low:g} to {high:g}"


def _run(data: xr.Dataset) -> list[Block]:
    classed = classes(data)
    if classed is None:
        return []
    number, acceleration = classed
    step = float(data["time"].values[1] - data["time"].values[0])
    seen = [k for k in range(len(EDGES) - 1) if np.sum(number == k) * step >= _SPARSE]
    if len(seen) < 2:
        return []
    rows: list[list[str]] = []
    said: list[str] = []
    for name in data["target"].values:
        if str(name) == acceleration:
            continue
        target = quantity(str(name))
        widths_of = widths(data, target.name, number)
        for i, (estimator, row) in enumerate(widths_of.items()):
            cells = [style.number(target.scale * row[k]) if np.isfinite(row[k]) else "–" for k in seen]
            unit = f" ({target.unit})" if target.unit else ""
            rows.append(["" if i else target.words + unit, estimator, *cells])
        said += _sentence(target, widths_of)
    if not rows:
        return []
    which = run_in_words(data)
    header = ["target", "estimator", *(f"{_label(k)} m/s²" for k in seen)]
    caption = (
        f"The run “{which}”: median of the standard deviation stated by each estimator, by the largest lateral "
        f"acceleration in the {WINDOW:g} s before."
    )
    return [Prose(plain(f"{which}: {' '.join(said)}")), Sheet(header, rows, caption, left=2)]


def _sentence(target: Quantity, widths: dict[str, list[float]]) -> list[str]:
    """Say for one quantity in which classes it is seen, by the estimators' median width."""
    if not widths:
        return []
    table = np.array(list(widths.values()))
    finite = np.isfinite(table).all(axis=0)
    if finite.sum() < 2:
        return []
    middle = np.where(finite, np.median(np.where(finite, table, 0.0), axis=0), np.nan)
    widest, narrowest = int(np.nanargmax(middle)), int(np.nanargmin(middle))
    if middle[widest] < SHOWN * middle[narrowest]:
        span = style.span(target.scale * middle[narrowest], target.scale * middle[widest], target.unit)
        return [f"The {target.words} is known about equally well throughout: the stated standard deviation is {span}."]
    numbers = (
        f"{style.with_unit(target.scale * middle[widest], target.unit)} at {_label(widest)} m/s² and "
        f"{style.with_unit(target.scale * middle[narrowest], target.unit)} at {_label(narrowest)} m/s²"
    )
    from_here = [k for k in range(len(middle)) if finite[k] and middle[k] * SHOWN <= middle[widest]]
    return [
        f"The {target.words} shows in the measurements at {' and at '.join(_label(k) for k in from_here)} m/s²: "
        f"the stated standard deviation is {numbers}."
    ]
