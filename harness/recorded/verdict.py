"""Whether a model and its noise fit recordings, by all that an estimator's run over them shows, in a sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.common.statistics import average_bounds
from harness.identification.whiteness import LAGS, Whiteness, is_white
from harness.models.quantities import listed, quantity, words
from harness.recorded.summary import Error, Summary
from harness.reporting import style

_FEWEST = 100
"""Samples with a measurement below which the share of NIS in its band says nothing: one in twenty is outside."""

_CONSISTENT = (0.90, 0.99)
"""Share of NIS in its 95 % band that counts as consistent."""

_COLOURED = 0.05
"""Sum of squared correlations of the innovations with their past, beyond that of white noise, from which they count as
coloured: of a long recording a test rejects also what changes nothing, such as the steps of a sensor."""

_TOO_LARGE = 1.5
"""Factor between NIS or NEES, over their degrees of freedom, and 1 that does not matter."""

_LEVEL = 0.99
"""Of the bounds of an average that a right estimator keeps."""


def verdicts(summaries: Sequence[Summary]) -> str:
    """Return the verdict on each estimator, those that come to the same together."""
    said: dict[str, list[str]] = {}
    for name in dict.fromkeys(s.estimator for s in summaries):
        said.setdefault(verdict([s for s in summaries if s.estimator == name]), []).append(name)
    return " ".join(f"With {listed(names)} {text}." for text, names in said.items())


def verdict(runs: Sequence[Summary]) -> str:
    """Return whether model and noise fit, and because of what, of one estimator on all recordings.

    What weighs most comes first: errors that are larger than stated, then coloured innovations, then NIS. Where NIS
    alone is not as stated, it is the noise. Else it may be either: a wrong ratio of process noise to measurement noise
    colours the innovations, too.
    """
    if lost := [s.recording for s in runs if math.isfinite(s.diverged_at)]:
        return f"the estimate diverges on {listed(lost)}"
    inside = [s.nis_inside for s in runs if math.isfinite(s.nis_inside)]
    if not inside:
        return "no covariance is stated"
    if (samples := sum(s.updates for s in runs)) < _FEWEST:
        return f"there are only {samples} samples with a measurement, too few to judge its NIS"
    share = float(np.mean(inside))
    of_nis = f"{style.percent(share)} of NIS in its 95 % band"
    errors = [(n, e) for s in runs for n, e in s.errors.items() if math.isfinite(e.rmse)]
    if reasons := [*_large(errors), *_coloured(runs)]:
        return f"model or noise does not fit: {'; '.join([*reasons, of_nis])}"
    nis = float(np.mean([s.nis for s in runs if math.isfinite(s.nis)]))
    if not _CONSISTENT[0] <= share <= _CONSISTENT[1] or not 1.0 / _TOO_LARGE <= nis <= _TOO_LARGE:
        size = "small" if nis > 1.0 else "large"
        return f"the noise does not fit: it is stated too {size}, with {of_nis}, {style.number(nis)} in the mean, not 1"
    as_stated = f", errors of {_names(errors)} no larger than stated" if errors else ", no reference"
    noisy = [(n, e) for n, e in errors if e.mostly_noise]
    own = f"; those of {_names(noisy)} are mostly noise of the reference" if noisy else ""
    return f"model and noise fit: {of_nis}, innovations almost white{as_stated}{own}"


def is_large(error: Error) -> bool:
    """Whether errors are larger than stated, with the noise of the reference, by more than chance.

    Neighbouring errors are alike, so that the mean is that of fewer independent ones.
    """
    _, most = average_bounds(1, error.independent, _LEVEL)
    return error.nees_with_noise > max(_TOO_LARGE, most)


def is_coloured(found: Whiteness) -> bool:
    """Whether innovations are coloured by so much that it matters."""
    samples = 2 * len(found.frequency)
    return not is_white(found) and found.correlation - LAGS / max(samples, 1) > _COLOURED


def _large(errors: Sequence[tuple[str, Error]]) -> list[str]:
    large = sorted((pair for pair in errors if is_large(pair[1])), key=lambda pair: -pair[1].nees_with_noise)
    if not large:
        return []
    name, worst = large[0]
    times, inside = style.number(math.sqrt(worst.nees_with_noise)), style.percent(worst.inside_with_noise)
    return [f"errors of the {words(name)} are {times} times as large as stated ({inside} in their 95 % band)"]


def _coloured(runs: Sequence[Summary]) -> list[str]:
    names = dict.fromkeys(n for s in runs for n, w in s.whiteness.items() if is_coloured(w))
    return [f"innovations of {listed([words(n) for n in names])} are coloured"] if names else []


def _names(errors: Sequence[tuple[str, Error]]) -> str:
    return listed([quantity(n).words for n in dict.fromkeys(n for n, _ in errors)])
