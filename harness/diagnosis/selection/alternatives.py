"""Fit what may stand in the place of each addition of a model: as a round of the search that begins without it.

What a round of the search saw was a model that lacked what later ones added. Of two things that are missing it may take
a third for both, and beside the other one something else is right in its place. So the model without an addition is
fitted, with all else in it, and the score test asks of everything what it would gain there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable
from dataclasses import replace
from functools import partial

from harness.diagnosis.criteria import HOPEFUL, TRIED
from harness.diagnosis.fitting.fit import Fitted, Point
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.selection.acceptance import same
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.diagnosis.selection.score_test import Score
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import Judgement, leaves_nothing
from harness.diagnosis.selection.wald import losses

_Models = dict[frozenset[Hypothesis], tuple[Added, Callable[[], Point]]]


class Alternatives:
    """What may stand in the place of additions, with what was ranked of it already.

    Args:
        fits: Of the drives.
    """

    def __init__(self, fits: CandidateFits) -> None:
        self._fits = fits
        self._ranked: dict[frozenset[Hypothesis], tuple[list[Score], list[Score]]] = {}

    def fit(self, added: Added, best: Fitted, needed: Container[Hypothesis]) -> None:
        """Fit a model without each of its additions, and with what may stand in its place, if that was not done yet.

        Nothing replaces a late channel; the model without one is fitted where that is in question.

        Args:
            added: What the model has.
            best: Its fit.
            needed: Without which it is out of the question.
        """
        fits, lost = self._fits, losses(self._fits, added, best)
        rests = {h: tuple(k for k in added if k != h) for h in added}
        open_ = [h for h in added if not h.clock or (lost[h] < HOPEFUL and h not in needed)]
        less: _Models = {frozenset(rests[h]): (rests[h], partial(fits.without, best.point, h, rests[h])) for h in open_}
        self._fit_new(less, best, -math.inf)
        places: _Models = {}
        many: dict[Hypothesis, Score] = {}
        for h in (h for h in added if not h.clock):
            for s in self._stand_ins(h, rests[h]):
                if s.hypothesis.name == ALL_PARAMETERS:
                    many[h] = s
                else:
                    places |= self._place(rests[h], best, s)
        self._fit_new(places, best, best.objective - fits.doubt)
        left = {h: s for h, s in many.items() if not self._settled(rests[h], [frozenset(added), *places])}
        for h, s in left.items():
            self._fit_new(self._place(rests[h], best, s), best, best.objective - fits.doubt)

    def _settled(self, rest: Added, tried: Iterable[frozenset[Hypothesis]]) -> bool:
        """Whether a model with less than many parameters explains everything; then those need no fit."""
        before = self._judged(frozenset(rest))
        return any(leaves_nothing(self._judged(key), before) for key in tried)

    def _judged(self, key: frozenset[Hypothesis]) -> Judgement:
        added, fitted = self._fits.models[key]
        return self._fits.judge(added, fitted.point)

    def _place(self, rest: Added, best: Fitted, s: Score) -> _Models:
        """Return a model with something in the place of an addition."""
        other = (*rest, *s.hypothesis.single)
        return {frozenset(other): (other, partial(self._start, rest, best.point, s))}

    def _fit_new(self, models: _Models, best: Fitted, needed: float) -> None:
        new = [model for key, model in models.items() if key not in self._fits.models]
        if new:
            self._fits.say("fitting what may stand in the place of what was found")
            self._fits.fit_all(new, best.objective, afresh=False, needed=needed)

    def _start(self, rest: Added, found: Point, s: Score) -> Point:
        """Return where a fit of something in the place of an addition starts, with the noise of the model with that."""
        point = self._fits.models[frozenset(rest)][1].point
        return self._fits.start(replace(found, values=point.values), s)

    def _stand_ins(self, h: Hypothesis, rest: Added) -> list[Score]:
        """Return what promises most in the place of an addition, the best first, but for what says the same as it.

        Many parameters at once gain whatever is missing, so they have to promise more than what they would replace.
        """
        key = frozenset(rest)
        if key not in self._ranked:
            name = f"in the place of {h.name.replace('_', ' ')}"
            tried = SelectionRound(self._fits, rest, [self._fits.models[key][1]], name)
            tried.rank()
            self._ranked[key] = tried.promised, tried.shortlist
        promised, shortlist = self._ranked[key]
        own = next((s for s in promised if s.hypothesis == h), None)
        found = [s for s in shortlist if h not in s.hypothesis.single and not (own and same(s, own))]
        found = [s for s in found if s.hypothesis.name != ALL_PARAMETERS or own is None or s.gain > own.gain]
        return found[:TRIED]
