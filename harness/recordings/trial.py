"""Which causes are worth a line of the map? A recording that is mended of them is compared again.

A cause that is not sure, or without which the comparisons agree as well, is stated and not mended: a wrong line makes
a right channel wrong. Where a nominal model is given, neither is one without which that fits better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.recordings.cause import DELAY, Cause, mended
from harness.recordings.consistency import LEAST_DELAY, LEAST_SCALE, Smoothed, compare
from harness.recordings.pair_fit import Agreement
from harness.recordings.responses import tells

SURE = 2 / 3
"""Least probability of what is mended: to mend a right channel is twice as bad as to leave a wrong one."""

_COARSE = 0.03
"""s; a delay that is known no better is stated and not mended."""


_WORSE = 0.05
"""Share by which the squared error of the fitted model must be larger with a line of the map than without it."""

_STANDARD_ERRORS = 2.0
"""Of the mean over the blocks, that it must be larger by."""

FitError = Callable[[xr.Dataset], Floats]
"""Squared error of the nominal model in each block of a recording that it was fitted to ``(blocks,)``."""


def spoils(reached: Floats, without: Floats) -> bool:
    """Return whether the nominal model fits worse with a line of the map than without it.

    Args:
        reached: Squared errors of the blocks with it, as ``FitError`` returns them.
        without: The same without it; blocks that only one of them has do not count.
    """
    count = min(len(reached), len(without))
    growth = reached[:count] - without[:count]
    usable = growth[np.isfinite(growth)]
    if usable.size < 2:
        return bool(np.isinf(np.nanmax(reached)) and np.isfinite(np.nanmax(without)))
    sure = _STANDARD_ERRORS * usable.std(ddof=1) / np.sqrt(usable.size)
    return bool(usable.mean() > max(_WORSE * np.nanmean(without), sure))


def worth_mending(causes: Sequence[Cause], fits: Sequence[Agreement], smoothed: Smoothed) -> list[Cause]:
    """Return the causes that are sure and without which the comparisons would agree less.

    Args:
        causes: What is off by a little.
        fits: Comparisons of the signals as they are.
        smoothed: The signals that they compare.
    """
    kept = [c for c in causes if c.posterior > SURE and not (c.kind == DELAY and c.std > _COARSE)]
    touched = {n for c in kept for n in c.signals}
    of = [f for f in fits if touched & set(f.relation.signals)]
    reached = _disagreement(kept, of, smoothed) if kept else (0, 0.0)
    for cause in sorted(kept, key=lambda c: c.posterior):
        fewer = [c for c in kept if c is not cause]
        without = _disagreement(fewer, of, smoothed)
        if without <= reached:
            kept, reached = fewer, without
    return kept


def _disagreement(causes: Sequence[Cause], fits: Sequence[Agreement], smoothed: Smoothed) -> tuple[int, float]:
    """Return in how much comparisons disagree once the causes are mended, and how far they are from agreement."""
    if causes:
        without = mended(causes, smoothed)
        fits = [compare(f.relation, without) for f in fits]
    return sum(len(f.off) for f in fits), sum(_deviation(f) for f in fits)


def _deviation(fit: Agreement) -> float:
    """Return how far a comparison is from agreement, as a sum of squares of standard errors."""
    relation = fit.relation
    if relation.circular or not tells(fit):
        return 0.0
    centre, factor = relation.slope
    least = LEAST_SCALE[relation.through_zero] / 3
    parts = [np.log(fit.slope / centre) / np.sqrt((fit.slope_std / fit.slope) ** 2 + least**2 + np.log(factor) ** 2)]
    if relation.exact:
        parts += [
            fit.delay / np.hypot(fit.delay_std, LEAST_DELAY / 3),
            fit.drift / np.hypot(fit.drift_std, LEAST_DELAY / 3),
            fit.offset / fit.offset_std if not relation.through_zero else 0.0,
        ]
    return float(np.nansum(np.square(parts)))
