"""Goal of a trace: the confusable set told apart, and at the same price as much as possible of all that was tried.

The set is what the calm drives so far left; the right name may be none of it, or be in it together with another one. So
drives are weighed by the compound of T- and D-optimality (Atkinson 2008, doi 10.1016/j.jspi.2007.03.029): the logarithm
of the bound on the probability of a wrong name, as far as that is not settled, and that of the width of what stays open
of the likeliest model and of the amplitudes of all other hypotheses, by coordinate.
"""

from __future__ import annotations

import math

import numpy as np

from harness.experiment.contract import Evidence
from harness.experiment.detection import LIMIT, LikeliestModel
from harness.experiment.open_trace import OpenTrace
from harness.experiment.rehearsal import Rehearsed
from harness.experiment.separation import SeparationGoal

_WEIGHT = 0.5


class TraceGoal(SeparationGoal):
    """The confusable set of a trace to be told apart, and what it had no reason to take in.

    Args:
        trace: What it left.
        weight: Of T-optimality in what drives are chosen by: 1 asks for that alone, 0 for D-optimality.
    """

    def __init__(self, trace: OpenTrace, weight: float = _WEIGHT) -> None:
        limits: dict[str, float] = {}
        for name, limit in ((n, v) for sizes in trace.detectable.values() for n, v in sizes.items()):
            if name not in trace.rivals[0].values:
                limits[name] = min(limit, limits.get(name, math.inf))
        super().__init__(trace)
        widened = SeparationGoal(trace, also=limits)
        limits = {name: limit for name, limit in limits.items() if name in widened.model.names}
        self._weight, self._likeliest = weight, LikeliestModel(widened, limits)
        ranges = [LIMIT * widened.range_of(name) for name in limits]
        units = np.r_[np.ones(self._likeliest.own), np.minimum(list(limits.values()), ranges)]
        self._units = np.outer(units, units)
        self._known = np.eye(len(units))
        self._known[: self._likeliest.own, : self._likeliest.own] += self._likeliest.so_far

    def evidence(self, drive: Rehearsed) -> Evidence:
        """Return what separates the set, and the Fisher information on all that the library has."""
        return (*super().evidence(drive), self._likeliest.information(drive) * self._units)

    def surrogate(self, drive: Rehearsed) -> Evidence:
        """Return the same by one linearisation of each rival."""
        return (*super().surrogate(drive), self._likeliest.information(drive) * self._units)

    def preference(self, evidence: Evidence | None) -> float:
        """Return the compound criterion."""
        apart = max(self.value(evidence), self.enough)
        return self._weight * apart - (1.0 - self._weight) * self.learnt(evidence)

    def learnt(self, evidence: Evidence | None) -> float:
        """Return the logarithm by which coordinates are known better, in the mean; half of the drives are fitted."""
        if evidence is None:
            return 0.0
        more = 0.5 * evidence[-1]
        before, after = (np.linalg.slogdet(m)[1] for m in (self._known, self._known + more))
        return float(after - before) / (2 * len(self._known))
