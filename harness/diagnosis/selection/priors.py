"""What is known of hypotheses before the drives are seen: one table of odds, and how far a stated value may be off."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.identification.uncertainty import marginal
from harness.models.assembly.placement import split


def kind_of(h: Hypothesis) -> str:
    """Return the kind of a hypothesis in the table of odds."""
    if h.kind == "parameter":
        return "many" if h.name == ALL_PARAMETERS else "parameter"
    return "effect" if h.output is None else "sensor"


def log_odds(tried: Sequence[Hypothesis]) -> dict[tuple[str, str], float]:
    """Return the logarithm of the odds of every hypothesis by kind and name.

    Args:
        tried: All of them.
    """
    tried = [h for h in tried if not h.parts]
    files = {(kind_of(h), split(h.name)[0]) for h in tried}
    of_kind = Counter(kind for kind, _ in files)
    of_file = Counter((kind_of(h), split(h.name)[0]) for h in tried)

    def odds(h: Hypothesis) -> float:
        kind = kind_of(h)
        return PRIORS.odds[kind] / of_kind[kind] / of_file[kind, split(h.name)[0]]

    return {(h.kind, h.name): math.log(odds(h)) for h in tried}


def log_size(fitted: Fitted, added: Sequence[Hypothesis]) -> float:
    """Return the logarithm of how plausible the errors of stated values are, over no error.

    A parameter is off by what its set states, in its coordinate. Where that says nothing, a positive one is off by a
    factor whose logarithm is normal with the standard deviation ``PRIORS.stated``, so that a factor of 1.8 costs four
    units and one of ten more than sixty; that of a length on the vehicle has ``PRIORS.length``.
    """
    stated = {n for h in added if h.kind == "parameter" for n in h.amplitudes}
    moved = [c for c in fitted.coordinates if c.name in stated]
    return -0.5 * sum(((c.coordinate(fitted.point.value(c)) - c.centre) / c.known) ** 2 for c in moved)


def log_stand_in(fitted: Fitted, added: Sequence[Hypothesis], information: Floats) -> float:
    """Return the log odds by which the values of many parameters at once rather stand for something unlisted.

    Values that are only stated wrongly scatter as they are known to. Many that a fit moves to take up what no
    hypothesis holds scatter ``PRIORS.implausible`` times as widely, the width at which a single one is not believed.
    Both are normal, and the likelihood too (Laplace's approximation about the fit), so the integral over all values
    is known. A single one that is added alone is free to be off by any factor.

    Args:
        fitted: A fit.
        added: What it holds, all parameters at once among it.
        information: Fisher information, with that of the priors, on what the fit moved ``(n, n)``.
    """
    many = {n for h in added if h.name == ALL_PARAMETERS for n in h.amplitudes}
    rows = [i for i, c in enumerate(fitted.coordinates) if c.name in many]
    moved = [fitted.coordinates[i] for i in rows]
    known = np.array([c.known for c in moved])
    z = np.array([c.coordinate(fitted.point.value(c)) - c.centre for c in moved])
    left = marginal(information, rows) * np.outer(known, known)
    values, vectors = np.linalg.eigh(left - np.eye(len(rows)))  # the drives' own
    values = np.maximum(values, 0.0)
    pull = (1.0 + values) * (vectors.T @ (z / known))  # where the prior's holds it in balance

    def evidence(width: float) -> float:
        total = values + width**-2.0
        return float(0.5 * (pull**2 / total - np.log(width**2 * total)).sum())

    return evidence(PRIORS.implausible) - evidence(1.0)
