"""What is known of hypotheses before the drives are seen: one table of odds, and how far a stated value may be off."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

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
    """Return the log odds by which values of many parameters at once rather stand for something unlisted.

    Values that are only stated wrongly scatter as they are known to. Some of many that a fit moves may take up what no
    hypothesis holds, and those scatter ``PRIORS.implausible`` times as widely, the width at which a single one is not
    believed. Both are normal, and the likelihood too (Laplace's approximation about the fit), each value with all
    others open. A single one that is added alone is free to be off by any factor; beside many it is one of them.

    Args:
        fitted: A fit.
        added: What it holds, all parameters at once among it.
        information: Fisher information, with that of the priors, on what the fit moved ``(n, n)``.
    """
    many = {n for h in added if h.name == ALL_PARAMETERS for n in h.amplitudes}
    gains = []
    for i, c in enumerate(fitted.coordinates):
        if c.name in many:
            held = (c.known / c.prior) ** 2  # by its prior; not at all where it is free
            seen = max(0.0, float(marginal(information, [i])[0, 0]) * c.known**2 - held)  # by the drives
            pull = (seen + held) * (c.coordinate(fitted.point.value(c)) - c.centre) / c.known
            wide, narrow = (_log_evidence(seen, pull, width) for width in (PRIORS.implausible, 1.0))
            gains.append(wide - narrow)
    return log_some_of(np.array(gains))


def _log_evidence(seen: float, pull: float, width: float) -> float:
    """Return the logarithm of the integral of ``exp(pull x - seen x^2 / 2)`` over a normal prior."""
    total = seen + width**-2.0
    return 0.5 * (pull**2 / total - math.log(width**2 * total))


def log_some_of(gains: Floats) -> float:
    """Return the log likelihood ratio of all choices of some of several changes, each choice as likely as any other.

    Args:
        gains: In log-likelihood of each change ``(n,)``.
    """
    together = float(np.logaddexp(0.0, gains).sum())  # with the choice of none
    some = together + math.log(-math.expm1(-together)) if together > 1e-6 else float(logsumexp(gains))
    return some - math.log(2.0 ** len(gains) - 1.0)
