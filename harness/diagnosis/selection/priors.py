"""What is known of hypotheses before the drives are seen: one table of odds, and how far a stated value may be off."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, PRIOR, Hypothesis
from harness.models.assembly.placement import split

ODDS = {
    "effect": 0.3,  # of the vehicle: a model that somebody believes in lacks something in every fourth case or so
    "sensor": 0.3,  # a fault of one sensor is as common: mountings, scales, clocks
    "parameter": 0.3,  # and so is one stated value that is off by more than its tolerance
    "many": 0.03,  # that many are off at once is rarer, and such a model fits whatever is missing
    "none": 0.1,  # something that the library does not hold; it has thirty effects because they are what is met
}
"""Odds, against the same model without it, that something of a kind is there; all hypotheses of a kind share them.

That the odds are shared corrects for how many hypotheses are tried (Scott and Berger 2010, section 2). An effect that
is tried at several places shares those of its file.
"""


def kind_of(h: Hypothesis) -> str:
    """Return the kind of a hypothesis in ``ODDS``."""
    if h.kind == "parameter":
        return "many" if h.name == ALL_PARAMETERS else "parameter"
    return "effect" if h.output is None else "sensor"


def log_odds(tried: Sequence[Hypothesis]) -> dict[tuple[str, str], float]:
    """Return the logarithm of the odds of every hypothesis by kind and name.

    Args:
        tried: All of them.
    """
    files = {(kind_of(h), split(h.name)[0]) for h in tried}
    of_kind = Counter(kind for kind, _ in files)
    of_file = Counter((kind_of(h), split(h.name)[0]) for h in tried)
    return {
        (h.kind, h.name): math.log(ODDS[kind_of(h)] / of_kind[kind_of(h)] / of_file[kind_of(h), split(h.name)[0]])
        for h in tried
    }


def log_size(fitted: Fitted, added: Sequence[Hypothesis]) -> float:
    """Return the logarithm of how plausible the errors of stated values are, over no error.

    A positive parameter is off by a factor whose logarithm is normal with the standard deviation ``PRIOR``, so that a
    factor of 1.8 costs four units and one of ten more than sixty.
    """
    stated = {n for h in added if h.kind == "parameter" for n in h.amplitudes}
    moved = [c for c in fitted.coordinates if c.name in stated and c.logarithmic]
    return -0.5 * sum(((c.coordinate(fitted.point.value(c)) - c.centre) / PRIOR) ** 2 for c in moved)
