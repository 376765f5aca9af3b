"""Single parameters of a model refitted to new drives, each alone and over all its range.

The score test predicts the gain of a small change. From dry road to ice is none: halfway there the car may slide, and
the likelihood has more than one maximum. So every parameter is first tried at values far and near.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.diagnosis.criteria import BIC_NEEDED
from harness.diagnosis.fitting import Fitting, ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import coordinates
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut, Judgement, predicts_better
from harness.identification.coordinates import Coordinate
from harness.identification.data import DriveData
from harness.models.contracts import Parameter

_FURTHEST = 5.0
"""Largest factor by which a parameter may have changed; one that may be zero is tried over its range."""

_TRIED = 33
_ITERATIONS = 8


@dataclass(frozen=True)
class ParameterChange:
    """One parameter, refitted alone.

    Attributes:
        parameter: Which.
        stated: Its value before, in SI units.
        value: Its value in these drives.
        std: Standard error of that by the likelihood; infinite if these drives do not determine it.
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
    tried: tuple[ParameterChange, ...]

    @property
    def change(self) -> ParameterChange | None:
        """The likeliest change, if it meets the criteria of an addition to a model."""
        best = self.tried[0]
        passes = (
            best.bic >= BIC_NEEDED
            and best.held_out.log_likelihood > self.before.log_likelihood
            and predicts_better(best.held_out, self.before)
        )
        return best if passes else None


def single_changes(
    augmented: AugmentedModel,
    train: Sequence[DriveData],
    test: Sequence[DriveData],
    stated_noise: bool,
    say: Callable[[str], None] = lambda _: None,
) -> Changes:
    """Refit every parameter of a model alone.

    Args:
        augmented: The model as it was before.
        train: Drives to fit.
        test: Held-out drives.
        stated_noise: Whether errors count against the noise that the model states, as in ``trace``.
        say: Is told what is being tried.
    """
    variances = first_variances(augmented, [*train, *test], stated_noise)
    fitting, held_out = Fitting(augmented, train, variances, stated_noise), HeldOut(augmented, test, variances)
    first = fitting.first()
    likelihood, changes = fitting.log_likelihood(first), []
    for p in augmented.nominal.parameters:
        if p.numerical or p.lower == p.upper:
            continue
        say(f"did {p.name.replace('_', ' ')} change?")
        (c,) = coordinates(augmented, (p.name,), (), len(train))
        fitted = fitting.only((c,), fitting.best(_starts(c, first)), _ITERATIONS)
        gain = 2.0 * (fitted.log_likelihood - likelihood) - math.log(fitting.samples)
        std, judged = float(fitting.standard_errors(fitted)[0]), held_out.judge((), fitted.point)
        changes.append(ParameterChange(p, first.value(c), fitted.point.value(c), std, gain, judged))
    changes.sort(key=lambda change: change.bic, reverse=True)
    return Changes(held_out.judge((), first), tuple(changes))


def _starts(c: Coordinate, first: ParameterPoint) -> list[ParameterPoint]:
    """Return points with other values of a parameter, its stated one among them."""
    here, low, high = c.coordinate(first.value(c)), c.lower, c.upper
    if c.logarithmic:
        reach = math.log(_FURTHEST)
        low, high = max(low, here - reach), min(high, here + reach)
    points = [first]
    for z in np.linspace(low, high, _TRIED):
        values = first.values.copy()
        values[c.rows[0]] = c.value(float(z))
        points.append(replace(first, values=values))
    return points
