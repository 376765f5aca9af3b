"""Fit what may stand in the place of each addition of a model: as a round of the search that begins without it.

What a round of the search saw was a model that lacked what later ones added. Of two things that are missing it may take
a third for both, and beside the other one something else is right in its place. So the score test asks of everything
what it would gain in the model without an addition, with all else in it, which is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import replace
from functools import partial

from harness.diagnosis.criteria import HOPEFUL, TRIED
from harness.diagnosis.fitting.fit import Fitted, Point
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.selection.acceptance import Round, same
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, own_of
from harness.diagnosis.selection.score_test import Score, ScoreTest
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import Judgement, leaves_nothing
from harness.diagnosis.selection.wald import Curvature

_Models = dict[frozenset[Hypothesis], tuple[Added, Callable[[], Point]]]


class Alternatives:
    """What may stand in the place of additions, with what was ranked of it already.

    Args:
        fits: Of the drives.
        rounds: Of the search.
    """

    def __init__(self, fits: CandidateFits, rounds: Sequence[Round] = ()) -> None:
        self._fits, self._rounds = fits, rounds
        self._ranked: dict[frozenset[Hypothesis], tuple[list[Score], list[Score]]] = {}

    def fit(self, added: Added, best: Fitted, needed: Container[Hypothesis]) -> None:
        """Fit a model without each of its additions, and with what may stand in its place, if that was not done yet.

        Nothing replaces what recordings have anyway, late channels and drifts: a drift had the better of all else in
        its round. The model without one is fitted where that is in question.

        Args:
            added: What the model has.
            best: Its fit.
            needed: Without which it is out of the question.
        """
        fits, curvature = self._fits, Curvature(self._fits, best)
        rests = {h: tuple(k for k in added if k != h) for h in added}
        less = {h: curvature.without((h,), rests[h]) for h in added}
        open_ = [h for h in added if not h.expected or (less[h].loss < HOPEFUL and h not in needed)]
        models: _Models = {frozenset(rests[h]): (rests[h], partial(fits.fitting.best, less[h].points)) for h in open_}
        self._fit_new(models, best, -math.inf)
        places: _Models = {}
        many: dict[Hypothesis, _Models] = {}
        for h in (h for h in added if not h.expected):
            for s in self._stand_ins(h, rests[h], best):
                other = fits.joined(rests[h], s.hypothesis)
                model: _Models = {frozenset(other): (other, partial(self._start, h, rests[h], best.point, s))}
                if s.hypothesis.name == ALL_PARAMETERS:
                    many[h] = model
                else:
                    places |= model
        self._fit_new(places, best, best.objective - fits.doubt)
        for h, model in many.items():
            before, [wrong] = self._judged(frozenset(rests[h])), model
            # Something simpler explains everything: many parameters need no fit.
            simpler = (k for k in (frozenset(added), *places) if self._simpler(k, wrong, best))
            if not any(leaves_nothing(self._judged(k), before) for k in simpler):
                self._fit_new(model, best, best.objective - fits.doubt)

    def _simpler(self, key: frozenset[Hypothesis], many: frozenset[Hypothesis], best: Fitted) -> bool:
        """Whether a model is simpler than one with many parameters: one addition, or a likelier part of that model."""
        if sum(not (h.clock or h.random) for h in key) < 2:
            return True
        covered = {name for h in many if h.kind == "parameter" for name in h.amplitudes}
        within = all(h in many or (h.kind == "parameter" and covered.issuperset(h.amplitudes)) for h in key)
        return within and self._fits.models[key][1].objective >= best.objective

    def _judged(self, key: frozenset[Hypothesis]) -> Judgement:
        added, fitted = self._fits.models[key]
        return self._fits.judge(added, fitted.point)

    def _fit_new(self, models: _Models, best: Fitted, needed: float) -> None:
        new = [model for key, model in models.items() if key not in self._fits.models]
        if new:
            self._fits.say("fitting what may stand in the place of what was found")
            self._fits.fit_all(new, best.objective, afresh=False, needed=needed)

    def _start(self, h: Hypothesis, rest: Added, found: Point, s: Score) -> Point:
        """Return where a fit of something in the place of an addition starts, with the noise of the model with that.

        It is what the score predicts in the model without the addition; or what was fitted of the same in another
        model, because of a large effect slopes predict little: with the parameters of this model, or of that one.
        """
        fits = self._fits
        starts = [fits.start(replace(found, values=fits.models[frozenset(rest)][1].point.values), s)]
        known = fits.with_addition(s.hypothesis)
        if known is not None:
            here = fits.without(found, (h,), rest).values
            rows = [fits.augmented.row(n) for n in (*s.hypothesis.shared, *s.hypothesis.change_times)]
            free = [fits.augmented.row(n) for n in fits.free]
            here[rows] = known.values[rows]
            there = here.copy()
            there[free] = known.values[free]
            starts += [replace(found, values=values) for values in (here, there)]
        return fits.fitting.best(starts)

    def _stand_ins(self, h: Hypothesis, rest: Added, best: Fitted) -> list[Score]:
        """Return what promises most in the place of an addition, the best first, but for what says the same as it.

        And what came nearest to it in its round.

        Many parameters at once gain whatever is missing, so they have to promise more than what they would replace.
        """
        key = frozenset(rest)
        if key not in self._ranked:
            name = f"in the place of {h.name.replace('_', ' ')}"
            ranked = SelectionRound(self._fits, rest, [self._fits.models[key][1]], name, self._test(h, rest, best))
            ranked.rank()
            self._ranked[key] = ranked.promised, ranked.shortlist
        promised, shortlist = self._ranked[key]
        own = next((s for s in promised if s.hypothesis == h), None)

        def other(s: Score) -> bool:
            return h not in s.hypothesis.single and not (own and same(s, own))

        found = [s for s in shortlist if other(s)]
        found = [s for s in found if s.hypothesis.name != ALL_PARAMETERS or own is None or s.gain > own.gain][:TRIED]
        second, tried = self._second(h), [s.hypothesis for s in found]
        return [*found, *(s for s in promised if s.hypothesis == second and second not in tried and other(s))]

    def _second(self, h: Hypothesis) -> Hypothesis | None:
        """Return what came nearest to an addition in its round, where both were fitted.

        A score promises little of a large effect, and less beside others that act alike.
        """
        for r in self._rounds:
            if r.added is not None and h in r.added.hypothesis.single:
                tried = [c for c in r.candidates if c.fitted is not None and h not in c.hypothesis.single]
                tried = [c for c in tried if not (c.hypothesis.expected or c.hypothesis.many)]
                return max(tried, key=lambda c: c.bic).hypothesis if tried else None
        return None

    def _test(self, h: Hypothesis, rest: Added, best: Fitted) -> ScoreTest | None:
        """Return the score test of a model without an addition, by the columns of the model with it.

        What the drives show of it is then what something else would have to explain, and nothing is to be computed
        again. Without a random process the filter is another one.
        """
        if h.random:
            return None
        fits = self._fits
        return fits.score_test(best).without(h, own_of((h,), rest), fits.without(best.point, (h,), rest))
