"""Comparison of all models that a trace has fitted: gather them, predict the held-out drives with each, weigh them.

What may stand in the place of an addition is fitted (``Alternatives``), and so is the model without it: a hypothesis
that was not tried has no probability. What was added stays where it is likely. Later additions make earlier ones
redundant, or what was missing was taken for something else at first and for the rest of it thereafter: a search goes on
from the likeliest model so far, until none is likelier.

A round of the search saw a model that lacked what later ones added. Of two things that are missing it may take a third
for both, and with the other one something else is right in its place. So the score test asks of everything what it
would gain in the model without an addition, with all else in it, which is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import logsumexp

from harness.common.arrays import Floats
from harness.diagnosis.criteria import HOPEFUL, HORIZONS, PRIORS, TRIED
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.innovations.prediction import Ahead, Prediction
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, called
from harness.diagnosis.selection.acceptance import Candidate, Round, ratio, same
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, own_of
from harness.diagnosis.selection.posterior import (
    Alike,
    ComparedModel,
    Posterior,
    by_block,
    coloured,
    coverage,
    farther,
    interval,
    log_odds,
    log_size,
    log_stand_in,
    probabilities,
    shared_horizons,
)
from harness.diagnosis.selection.score_test import Score, ScoreTest
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import Judgement, leaves_nothing
from harness.diagnosis.selection.wald import Curvature

_Models = dict[frozenset[Hypothesis], tuple[Added, Callable[[], ParameterPoint]]]


class Alternatives:
    """What may stand in the place of additions, with what was ranked of it already.

    Args:
        fits: Of the drives.
        rounds: Of the search.
    """

    def __init__(self, fits: CandidateFits, rounds: Sequence[Round] = ()) -> None:
        self._fits, self._rounds = fits, rounds
        self._ranked: dict[frozenset[Hypothesis], tuple[list[Score], list[Score]]] = {}

    def fit(self, added: Added, best: FittedHypothesis, needed: Container[Hypothesis]) -> None:
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

    def _simpler(self, key: frozenset[Hypothesis], many: frozenset[Hypothesis], best: FittedHypothesis) -> bool:
        """Whether a model is simpler than one with many parameters: one addition, or a likelier part of that model."""
        if sum(not (h.clock or h.random) for h in key) < 2:
            return True
        covered = {name for h in many if h.kind == "parameter" for name in h.amplitudes}
        within = all(h in many or (h.kind == "parameter" and covered.issuperset(h.amplitudes)) for h in key)
        return within and self._fits.models[key][1].objective >= best.objective

    def _judged(self, key: frozenset[Hypothesis]) -> Judgement:
        added, fitted = self._fits.models[key]
        return self._fits.judge(added, fitted.point)

    def _fit_new(self, models: _Models, best: FittedHypothesis, needed: float) -> None:
        new = [model for key, model in models.items() if key not in self._fits.models]
        if new:
            self._fits.say("fitting what may stand in the place of what was found")
            self._fits.fit_all(new, best.objective, afresh=False, needed=needed)

    def _start(self, h: Hypothesis, rest: Added, point: ParameterPoint, s: Score) -> ParameterPoint:
        """Return where a fit of something in the place of an addition starts, with the noise of the model with that.

        It is what the score predicts in the model without the addition; or what was fitted of the same in another
        model, because of a large effect slopes predict little: with the parameters of this model, or of that one.
        """
        fits = self._fits
        starts = [fits.start(replace(point, values=fits.models[frozenset(rest)][1].point.values), s)]
        elsewhere = fits.with_addition(s.hypothesis)
        if elsewhere is not None:
            here = fits.without(point, (h,), rest).values
            rows = [fits.augmented.row(n) for n in (*s.hypothesis.shared, *s.hypothesis.change_times)]
            free = [fits.augmented.row(n) for n in fits.free]
            here[rows] = elsewhere.values[rows]
            there = here.copy()
            there[free] = elsewhere.values[free]
            starts += [replace(point, values=values) for values in (here, there)]
        return fits.fitting.best(starts)

    def _stand_ins(self, h: Hypothesis, rest: Added, best: FittedHypothesis) -> list[Score]:
        """Return what promises most in the place of an addition, the best first, but for what says the same as it.

        And what came nearest to it in its round.

        Many parameters at once gain whatever is missing, so they have to promise more than what they would replace.
        """
        key = frozenset(rest)
        if key not in self._ranked:
            name = f"in the place of {called(h.name, ' of ')}"
            ranked = SelectionRound(self._fits, rest, [self._fits.models[key][1]], name, self._test(h, rest, best))
            ranked.rank()
            self._ranked[key] = ranked.promised, ranked.shortlist
        promised, shortlist = self._ranked[key]
        own = next((s for s in promised if s.hypothesis == h), None)

        def other(s: Score) -> bool:
            return h not in s.hypothesis.single and not (own and same(s, own))

        chosen = [s for s in shortlist if other(s)]
        chosen = [s for s in chosen if s.hypothesis.name != ALL_PARAMETERS or own is None or s.gain > own.gain][:TRIED]
        second, tried = self._second(h), [s.hypothesis for s in chosen]
        return [*chosen, *(s for s in promised if s.hypothesis == second and second not in tried and other(s))]

    def _second(self, h: Hypothesis) -> Hypothesis | None:
        """Return what came nearest to an addition in its round, where both were fitted.

        A score promises little of a large effect, and less with others that act alike.
        """
        for r in self._rounds:
            if r.added is not None and h in r.added.hypothesis.single:
                tried = [c for c in r.candidates if c.fitted is not None and h not in c.hypothesis.single]
                tried = [c for c in tried if not (c.hypothesis.expected or c.hypothesis.many)]
                return max(tried, key=lambda c: c.bic).hypothesis if tried else None
        return None

    def _test(self, h: Hypothesis, rest: Added, best: FittedHypothesis) -> ScoreTest | None:
        """Return the score test of a model without an addition, by the columns of the model with it.

        What the drives show of it is then what something else would have to explain, and nothing is to be computed
        again. Without a random process the filter is another one.
        """
        if h.random:
            return None
        fits = self._fits
        return fits.score_test(best).without(h, own_of((h,), rest), fits.without(best.point, (h,), rest))


@dataclass(frozen=True)
class _Predicted:
    """The held-out drives as a model predicts them, sample by sample, with what it costs to fit its change times there.

    ``blocks`` is the log density by block ``(blocks, horizons)``.
    """

    added: Added
    fitted: FittedHypothesis
    aheads: tuple[Ahead, ...]
    penalty: float
    blocks: Floats


def likeliest(
    fits: CandidateFits, rounds: Sequence[Round], added: Added, best: FittedHypothesis, turns: float = math.inf
) -> tuple[Added, FittedHypothesis, Posterior]:
    """Return what of the additions stays or takes their place, its fit, and how likely every model of a trace is.

    Args:
        fits: With all models that were fitted.
        rounds: Of the selection.
        added: What they added.
        best: The fit with all of it.
        turns: How often what takes the place of additions is questioned in turn, at most.
    """
    compared, alternatives = Comparison(fits, rounds), Alternatives(fits, rounds)
    seen: set[frozenset[Hypothesis]] = set()
    while True:
        added, best, needed = _lessened(fits, compared, added, best)
        seen.add(frozenset(added))
        alternatives.fit(added, best, needed)
        kept, fitted = compared.likeliest([m for m in fits.models.values() if _may_follow(m[0], added)])
        if frozenset(kept) not in seen:
            added, best = kept, fitted
        if frozenset(added) in seen or len(seen) >= turns:
            return added, best, compared.posterior()


def _lessened(
    fits: CandidateFits, compared: Comparison, added: Added, best: FittedHypothesis
) -> tuple[Added, FittedHypothesis, set[Hypothesis]]:
    """Return a model without those of its additions, one after the other, without which it is likelier, and its fit.

    And the additions without which it was out of the question.
    """
    removable = added
    reached: dict[Hypothesis, float] = {}  # without it
    while removable:
        curvature = Curvature(fits, best)
        rests = {h: tuple(k for k in added if k != h) for h in removable}
        less = {h: curvature.without((h,), rests[h]) for h in removable}
        open_ = [h for h in removable if less[h].loss < HOPEFUL]
        removable = ()
        for i, h in enumerate(open_):
            rest = rests[h]
            if frozenset(rest) not in fits.models:
                fits.say(f"still needed? {h.name.replace('_', ' ')}")
                start = partial(fits.fitting.best, less[h].points)
                fits.fit_all([(rest, start)], best.objective, afresh=False, needed=best.objective - fits.doubt)
                reached[h] = fits.models[frozenset(rest)][1].objective
            kept, fitted = compared.likeliest([fits.models[frozenset(a)] for a in (added, rest)])
            if set(kept) == set(rest):
                added, best, removable = kept, fitted, tuple(open_[i + 1 :])
                break
    return added, best, {h for h, objective in reached.items() if objective < best.objective - fits.doubt}


def _may_follow(former: Added, added: Added) -> bool:
    """Whether a model may take the place of another: it has no more additions, and is as late.

    What a round refused does not come back: an addition to a model that is nearly right, or quite wrong, is likelier
    than none, whatever it is. Nothing replaces a late channel: recordings have clocks of their own, and a lag of the
    steering that resembles one would be an effect of a vehicle that has none.
    """
    lost, new = set(added) - set(former), set(former) - set(added)
    return len(new) <= len(lost) and not (new and any(h.clock and not h.changed for h in lost))


@dataclass(frozen=True)
class _Weighed:
    """Models with what is compared of them, in their order.

    Attributes:
        predicted: The held-out drives as each predicts them.
        classes: Its additions, with what is alike.
        priors: Logarithms ``(models,)``.
        densities: Mean log density over the horizons that count, by block ``(models, blocks)``.
    """

    predicted: list[_Predicted]
    classes: list[list[Alike]]
    priors: Floats
    densities: Floats


class Comparison:
    """The models of a trace, each with what it predicts of the held-out drives, which is computed once.

    Args:
        fits: With all models that were fitted.
        rounds: Of the selection.
    """

    def __init__(self, fits: CandidateFits, rounds: Sequence[Round]) -> None:
        self.fits, self.rounds = fits, rounds
        self._prediction = Prediction(fits.augmented)
        self._known: dict[int, _Predicted] = {}  # by the fit, which is kept with it
        self._odds = log_odds(fits.hypotheses)
        self._alike: dict[Hypothesis, Alike] = {}
        step, longest = fits.augmented.spec.step, min(len(d.time) for d in fits.held_out.drives)
        self._samples = np.array([max(1.0, h if math.isinf(h) else round(h / step)) for h in HORIZONS])
        # A model that knows its discrepancy states the density of the drives one step ahead; of the errors of a
        # prediction that goes on for a second a hundred samples are one.
        whole = np.ones(len(HORIZONS))
        self._shares = 1.0 / np.minimum(self._samples, longest) if fits.disturbed else whole

    def likeliest(self, models: Sequence[tuple[Added, FittedHypothesis]]) -> tuple[Added, FittedHypothesis]:
        """Return the likeliest of some models, weighed among themselves.

        Against all others both may have no probability that a number can hold.
        """
        models = self._in_doubt(models)
        weighed = self._weighed(models)
        return models[int(np.argmax(probabilities(weighed.priors, weighed.densities)))]

    def _in_doubt(self, models: Sequence[tuple[Added, FittedHypothesis]]) -> list[tuple[Added, FittedHypothesis]]:
        """Return the models whose fit is not so far behind the best one that they are out of the question.

        Far behind, one has no probability that a number can hold, and its fit was given up.
        """
        best = max(fitted.objective for _, fitted in models)
        return [m for m in models if not m[1].objective < best - self.fits.doubt]

    def posterior(self) -> Posterior:
        """Return how likely every model is that was fitted and is in doubt."""
        self.fits.say("how likely is each model?")
        compared = self._in_doubt([*self.fits.models.values()])
        fitted = self.fits.models
        stay = [fitted[key] for key in (frozenset[Hypothesis](), *self.fits.stay) if key in fitted]
        compared += [m for m in stay if m not in compared]  # how much likelier is what was found?
        weighed = self._weighed(compared)
        priors, densities = weighed.priors, weighed.densities
        shares = probabilities(priors, densities)
        order = np.argsort(-shares, kind="stable")
        first = weighed.predicted[order[0]]
        # What is unlisted acts with it, or is what its many parameters stand for; then it predicts as well. Where a
        # discrepancy stands for it already, it is the model with that alone, and what may act as what was named.
        nothing = np.zeros(densities.shape[1])
        lacking = nothing if self.fits.disturbed else self._lacking(first)
        unlisted = densities[order[0]] + np.vstack([lacking, nothing])
        odds = np.array([0.0, self._stand_in(first)]) + math.log(PRIORS.odds["none"])
        joint = probabilities(np.append(priors, priors[order[0]] + odds), np.vstack([densities, unlisted]))
        models = tuple(
            ComparedModel(
                tuple(weighed.classes[i]),
                weighed.predicted[i].fitted,
                float(priors[i]),
                weighed.predicted[i].blocks.sum(axis=0),
                interval(densities[i] - densities[order[0]]),
                float(shares[i]),
                float(joint[i]),
            )
            for i in order
        )
        return Posterior(models, float(joint[len(order) :].sum()), coverage(first.aheads))

    def _weighed(self, models: Sequence[tuple[Added, FittedHypothesis]]) -> _Weighed:
        """Return models with what is compared of them."""
        new = [m for m in models if id(m[1]) not in self._known]
        predictions = self.fits.augmented.share(lambda model: self._predicted(*model), new)
        self._known |= {id(p.fitted): p for p in predictions}
        predicted = [self._known[id(fitted)] for _, fitted in models]
        for h in dict.fromkeys(h for p in predicted for h in p.added if h not in self._alike):
            self._alike[h] = _alike(h, self.rounds, self._odds)
        classes = [[self._alike[h] for h in p.added] for p in predicted]
        priors = [
            _log_prior(p, c, self._odds) + log_held(self.fits.augmented, p.fitted)
            for p, c in zip(predicted, classes, strict=True)
        ]
        return _Weighed(predicted, classes, np.array(priors), self._shared(predicted))

    def _shared(self, predicted: Sequence[_Predicted]) -> Floats:
        return shared_horizons(np.array([p.blocks for p in predicted]), self._shares)

    def _predicted(self, added: Added, fitted: FittedHypothesis) -> _Predicted:
        held_out = self.fits.held_out
        judged = self.fits.judge(added, fitted.point)
        aheads = self._aheads(held_out.fitting, judged.point)
        each = sum(d.log_likelihood for d in judged.drives)  # neither has one where a free run leaves the model's range
        penalty = each - judged.log_likelihood if math.isfinite(each) else 0.0
        blocks = by_block([a.densities for a in aheads], held_out.drives, penalty)
        return _Predicted(added, fitted, aheads, penalty, blocks)

    def _aheads(self, fitting: Fitting, point: ParameterPoint) -> tuple[Ahead, ...]:
        """Return how a model predicts drives at all horizons."""
        each = zip(fitting.drives, fitting.candidates([point]), strict=True)
        return tuple(fitting.augmented.share(lambda arguments: self._prediction.of(*arguments, [*self._samples]), each))

    def _lacking(self, p: _Predicted) -> Floats:
        """Return by block how much likelier the held-out drives are if a model lacks something ``(blocks,)``."""
        fits, point = self.fits, p.fitted.point
        judged = fits.judge(p.added, point).point
        runs = (fits.fitting.runs(point), fits.held_out.fitting.runs(judged))
        here, there = ([run.whitened[1:] for run in each] for each in runs)
        squares = [
            by_block([np.column_stack([a.squares, a.seen]) for a in aheads], drives)
            for aheads, drives in (
                (self._aheads(fits.fitting, point), fits.fitting.drives),
                (p.aheads, fits.held_out.drives),
            )
        ]
        return coloured(here, there) / len(p.blocks) + farther(*squares)

    def _stand_in(self, p: _Predicted) -> float:
        """Return the log odds by which the many parameters of a model stand for something unlisted."""
        many = any(h.name == ALL_PARAMETERS for h in p.added)
        return log_stand_in(p.fitted, p.added, self.fits.fitting.information(p.fitted)) if many else -math.inf


def log_held(augmented: AugmentedModel, fitted: FittedHypothesis) -> float:
    """Return the logarithm of how plausible the moves of a fit are by earlier drives together, over no move.

    A change is taken up by many parameters at once, a little of each, and predicts no worse then. What tells is that
    the earlier drives contradict these values.
    """
    moved = [c for c in fitted.coordinates if c.held]
    joint = augmented.joint_prior(moved)
    if joint is None:
        return 0.0
    away = np.array([c.coordinate(fitted.point.value(c)) - c.centre for c in moved])
    return -0.5 * float(away @ joint @ away)


def _log_prior(p: _Predicted, classes: Sequence[Alike], odds: dict[tuple[str, str], float]) -> float:
    """Return the logarithm of the prior of a model, over that of the nominal one; what is alike counts together."""
    each = [logsumexp([odds[h.kind, h.name] for h in c.hypotheses]) for c in classes]
    return float(sum(each)) + log_size(p.fitted, p.added)


def _alike(h: Hypothesis, rounds: Sequence[Round], odds: dict[tuple[str, str], float]) -> Alike:
    """Return a hypothesis with those that were not fitted, because these drives show the same of them."""
    alike, ratios = [h], [1.0]
    own = _tried(h, rounds)
    if own is not None:
        r, c = own
        others = [
            o
            for o in r.candidates
            if o.fitted is None and not o.hypothesis.parts and o.score.excited and same(o.score, c.score)
        ]
        alike += [o.hypothesis for o in others]
        ratios += [ratio(o.score, c.score) for o in others]
    weights = np.exp([odds[k.kind, k.name] for k in alike])
    return Alike(tuple(alike), tuple(map(float, weights / weights.sum())), tuple(ratios))


def _tried(h: Hypothesis, rounds: Sequence[Round]) -> tuple[Round, Candidate] | None:
    """Return the first round in which a hypothesis was fitted; a random process also where several were at once."""

    def fitted(r: Round, c: Candidate) -> bool:
        at_once = (o for o in r.candidates if h.random and h in o.hypothesis.parts)
        return any(o.fitted is not None for o in (c, *at_once))

    return next(((r, c) for r in rounds for c in r.candidates if c.hypothesis == h and fitted(r, c)), None)
