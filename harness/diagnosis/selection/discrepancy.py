"""Discrepancy of a model: how wrong it is anyway, as a coloured disturbance of force and moment of each body.

Where a search ends in a model that is whole, nothing of this is used. Else the model that it ended in is fitted with
the disturbance (``models/effects/unmodelled_force.py``), a road whose bank varies and gyroscopes that drift: if that is
worth as much as an addition to a model, a model grows with these (``growth``). Its score tests and fits are then
generalised least squares, standard errors and probabilities know what the model leaves out, and the floor of a free run
holds what the disturbance does (Kennedy and O'Hagan 2001; Kristensen, Madsen and Jorgensen 2004).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.diagnosis.criteria import BIC_NEEDED
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.model.augmented_model import MEMORY, AugmentedModel, intensities
from harness.diagnosis.model.hypotheses import Hypothesis, random_processes
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits

_SIZES = (0.003, 0.01, 0.03, 0.1)
"""Intensities at which a fit may start: shares of the lateral force, and levers in m."""

MEMORIES = (0.2, 1.0, 5.0)
"""s; correlation times, of which the likeliest is kept: a search knows it no better than by a factor."""


def starts(augmented: AugmentedModel, point: ParameterPoint, memories: Sequence[float]) -> list[ParameterPoint]:
    """Return a point with a discrepancy of several sizes and correlation times, and little of all other processes."""
    rows = [augmented.row(n) for name in augmented.discrepancy for n in intensities(name)]
    others = [h for h in random_processes(augmented) if h.name in augmented.processes]
    first = {n: 0 for h in others for n in h.amplitudes} | {n: -1 for h in others for n in h.shapes}
    points = []
    for size, memory in itertools.product(_SIZES, memories):
        values = point.values.copy()
        values[rows], values[augmented.row(MEMORY)] = size, memory
        for name, place in first.items():  # little of each, and as slow as any
            values[augmented.row(name)] = augmented.model.parameters[augmented.row(name)].grid[place]
        points.append(replace(point, values=values))
    return points


def likeliest_memory(fits: CandidateFits, added: Added, point: ParameterPoint) -> FittedHypothesis:
    """Return a model fitted with a discrepancy of the likeliest of the correlation times.

    Args:
        fits: Fits of models with a discrepancy.
        added: What the model has.
        point: Of the model without discrepancy.
    """
    each = [fits.fitting.best(starts(fits.augmented, point, [memory])) for memory in MEMORIES]
    fitted = [fits.fit(added, start, turns=1) for start in each]
    best = max(fitted, key=lambda f: f.objective)
    return fits.fit(added, best.point, afresh=False)


def with_discrepancy(fits: CandidateFits, added: Added, fitted: FittedHypothesis) -> FittedHypothesis | None:
    """Return a model fitted with a discrepancy; ``None`` where that is not worth it.

    It has to meet what an addition has to that no simulation predicts: evidence on the fitted drives, and a higher
    likelihood of the held-out ones.

    Args:
        fits: Fits of models with a discrepancy.
        added: What the model has.
        fitted: Its fit without discrepancy.
    """
    fits.say("does the model leave out what no effect of the library holds?")
    whole = likeliest_memory(fits, added, fitted.point)
    count = sum(len(h.amplitudes) for h in fits.always) + 1
    likelier = fits.bic(whole.objective - fitted.objective, count) >= BIC_NEEDED
    before, after = (fits.judge(added, f.point).log_likelihood for f in (fitted, whole))
    return whole if likelier and after > before else None


def first_point(fitting: Fitting, point: ParameterPoint) -> ParameterPoint:
    """Return where the nominal model with a discrepancy is first fitted, with the correlation time of a point."""
    augmented = fitting.augmented
    memory = float(point.values[augmented.row(MEMORY), 0])
    return fitting.best(starts(augmented, fitting.first(), [memory]))


def hinges(
    plain: FittedHypothesis, whole: FittedHypothesis, errors: np.ndarray, added: Sequence[Hypothesis]
) -> tuple[str, ...]:
    """Return the sizes of additions that move by more than their 95 % interval where a discrepancy is allowed.

    Args:
        plain: The model fitted without discrepancy.
        whole: The same with it.
        errors: Standard errors of the second one's coordinates ``(n,)``.
        added: What both have.
    """
    own = {n for h in added if not h.random for n in h.amplitudes}
    moved = []
    for c, error in zip(whole.coordinates, errors, strict=True):
        if c.name in own and abs(whole.point.value(c) - plain.point.value(c)) > 1.96 * error:
            moved.append(c.name)
    return tuple(dict.fromkeys(moved))
