"""Which parameter of a model is another one in new drives: each is refitted there alone, over all its range.

The score test promises what a small change would bring. Ice for dry road is none: halfway there the car may slide, and
the likelihood has more than one maximum. So every parameter is first tried at values far and near.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.diagnosis.fitting.fit import Fitting, Point
from harness.diagnosis.model.augmented_model import Whole
from harness.diagnosis.model.hypotheses import Coordinate, coordinates
from harness.diagnosis.selection.acceptance import BIC_NEEDED, ERROR_NEEDED
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut, Judgement
from harness.identification.data import Drive
from harness.models.contracts import Parameter

_FURTHEST = 5.0
"""Largest factor by which a parameter may have changed; one that may be zero is tried over its range."""

_TRIED = 33
_ITERATIONS = 8


@dataclass(frozen=True)
class Change:
    """One parameter, refitted alone.

    Attributes:
        parameter: Which.
        stated: Its value before, in SI units.
        value: Its value in these drives.
        std: Standard error of that by the likelihood.
        bic: Gain in BIC on the fitted drives.
        held_out: What the held-out drives say.
    """

    parameter: Parameter
    stated: float
    value: float
    std: float
    bic: float
    held_out: Judgement


@dataclass(frozen=True)
class Changes:
    """Every parameter, refitted alone.

    Attributes:
        before: The model as stated, on the held-out drives.
        tried: The parameters, the likeliest change first.
    """

    before: Judgement
    tried: tuple[Change, ...]

    @property
    def found(self) -> Change | None:
        """The likeliest change, if it passes the judges that an addition to a model has to pass."""
        best = self.tried[0]
        passes = (
            best.bic >= BIC_NEEDED
            and best.held_out.log_likelihood > self.before.log_likelihood
            and best.held_out.excess <= (1 - ERROR_NEEDED) * self.before.excess
        )
        return best if passes else None


def single_changes(
    whole: Whole,
    train: Sequence[Drive],
    test: Sequence[Drive],
    stated_noise: bool,
    say: Callable[[str], None] = lambda _: None,
) -> Changes:
    """Refit every parameter of a model alone.

    Args:
        whole: The model as it was before.
        train: Drives to fit.
        test: Drives to judge on.
        stated_noise: Whether errors count against the noise that the model states, as in ``trace``.
        say: Is told what is being tried.
    """
    variances = first_variances(whole, [*train, *test], stated_noise)
    fitting, held_out = Fitting(whole, train, variances, stated_noise), HeldOut(whole, test, variances)
    first = fitting.first()
    likelihood, found = fitting.log_likelihood(first), []
    for p in whole.nominal.parameters:
        if p.numerical or p.lower == p.upper:
            continue
        say(f"did {p.name.replace('_', ' ')} change?")
        (c,) = coordinates(whole, (p.name,), (), len(train))
        fitted = fitting.only((c,), fitting.best(_starts(c, first)), _ITERATIONS)
        gain = 2.0 * (fitted.log_likelihood - likelihood) - math.log(fitting.samples)
        value, stated = float(fitted.point.values[c.row, 0]), float(first.values[c.row, 0])
        judged = held_out.judge((), fitted.point)
        found.append(Change(p, stated, value, _std(fitting, c, fitted.point), gain, judged))
    found.sort(key=lambda change: change.bic, reverse=True)
    return Changes(held_out.judge((), first), tuple(found))


def _starts(c: Coordinate, first: Point) -> list[Point]:
    """Return points with other values of a parameter, its stated one among them."""
    here = c.coordinate(float(first.values[c.row, 0]))
    low, high = c.bounds
    if c.logarithmic:
        reach = math.log(_FURTHEST)
        low, high = max(low, here - reach), min(high, here + reach)
    points = [first]
    for z in np.linspace(low, high, _TRIED):
        values = first.values.copy()
        values[c.row] = c.value(float(z))
        points.append(replace(first, values=values))
    return points


def _std(fitting: Fitting, c: Coordinate, point: Point) -> float:
    information = 0.0
    for i, kept in enumerate(fitting.passes(point)):
        information += float(np.sum(fitting.columns((c,), point, i, kept) ** 2))
    slope = c.slope(c.coordinate(float(point.values[c.row, 0])))
    return slope / math.sqrt(information) if information > 0 else math.nan
