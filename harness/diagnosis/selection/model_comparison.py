"""Compare all models that a trace has fitted: gather them, predict the held-out drives with each, weigh them.

What may stand in the place of an addition is fitted (``alternatives``), and so is the model without it: a hypothesis
that was not tried has no probability. What was added stays where it is likely. Later additions make earlier ones
redundant, or what was missing was taken for something else at first and for the rest of it thereafter: a search goes on
from the likeliest model so far, until none is likelier.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import logsumexp

from harness.common.arrays import Floats
from harness.diagnosis.criteria import HOPEFUL, HORIZONS, PRIORS
from harness.diagnosis.fitting.fit import Fitted, Fitting, Point
from harness.diagnosis.innovations.prediction import Ahead, Prediction
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, hypotheses
from harness.diagnosis.selection.acceptance import Candidate, Round, same
from harness.diagnosis.selection.alternatives import Alternatives
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.diagnosis.selection.posterior import (
    Alike,
    Model,
    Posterior,
    by_block,
    coloured,
    coverage,
    farther,
    interval,
    probabilities,
    shared_horizons,
)
from harness.diagnosis.selection.priors import log_odds, log_size, log_stand_in
from harness.diagnosis.selection.wald import Curvature


@dataclass(frozen=True)
class _Predicted:
    """The held-out drives as a model predicts them, sample by sample, with what it costs to fit its change times there.

    ``blocks`` is the log density by block ``(blocks, horizons)``.
    """

    added: Added
    fitted: Fitted
    aheads: tuple[Ahead, ...]
    penalty: float
    blocks: Floats


def likeliest(
    fits: CandidateFits, rounds: Sequence[Round], added: Added, best: Fitted
) -> tuple[Added, Fitted, Posterior]:
    """Return what of the additions stays or takes their place, its fit, and how likely every model of a trace is.

    Args:
        fits: With all models that were fitted.
        rounds: Of the selection.
        added: What they added.
        best: The fit with all of it.
    """
    compared, alternatives = _Comparison(fits, rounds), Alternatives(fits, rounds)
    seen: set[frozenset[Hypothesis]] = set()
    while True:
        added, best, needed = _lessened(fits, compared, added, best)
        seen.add(frozenset(added))
        alternatives.fit(added, best, needed)
        kept, fitted = compared.likeliest([m for m in fits.models.values() if _may_follow(m[0], added)])
        if frozenset(kept) in seen:
            return added, best, compared.posterior()
        added, best = kept, fitted


def _lessened(
    fits: CandidateFits, compared: _Comparison, added: Added, best: Fitted
) -> tuple[Added, Fitted, set[Hypothesis]]:
    """Return a model without those of its additions, one after the other, without which it is likelier, and its fit.

    And the additions without which it was out of the question.
    """
    left = added
    reached: dict[Hypothesis, float] = {}  # without it
    while left:
        curvature = Curvature(fits, best)
        rests = {h: tuple(k for k in added if k != h) for h in left}
        less = {h: curvature.without((h,), rests[h]) for h in left}
        open_ = [h for h in left if less[h].loss < HOPEFUL]
        left = ()
        for i, h in enumerate(open_):
            rest = rests[h]
            if frozenset(rest) not in fits.models:
                fits.say(f"still needed? {h.name.replace('_', ' ')}")
                start = partial(fits.fitting.best, less[h].points)
                fits.fit_all([(rest, start)], best.objective, afresh=False, needed=best.objective - fits.doubt)
                reached[h] = fits.models[frozenset(rest)][1].objective
            kept, fitted = compared.likeliest([fits.models[frozenset(a)] for a in (added, rest)])
            if set(kept) == set(rest):
                added, best, left = kept, fitted, tuple(open_[i + 1 :])
                break
    return added, best, {h for h, objective in reached.items() if objective < best.objective - fits.doubt}


def _may_follow(one: Added, added: Added) -> bool:
    """Whether a model may take the place of another: it has no more additions, and is as late.

    What a round refused does not come back: an addition to a model that is nearly right, or quite wrong, is likelier
    than none, whatever it is. Nothing replaces a late channel: recordings have clocks of their own, and a lag of the
    steering that resembles one would be an effect of a vehicle that has none.
    """
    lost, new = set(added) - set(one), set(one) - set(added)
    return len(new) <= len(lost) and not (new and any(h.clock for h in lost))


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


class _Comparison:
    """The models of a trace, each with what it predicts of the held-out drives, which is computed once.

    Args:
        fits: With all models that were fitted.
        rounds: Of the selection.
    """

    def __init__(self, fits: CandidateFits, rounds: Sequence[Round]) -> None:
        self.fits, self.rounds = fits, rounds
        self._prediction = Prediction(fits.augmented)
        self._known: dict[int, _Predicted] = {}  # by the fit, which is kept beside
        self._odds = log_odds(hypotheses(fits.augmented, fits.free))
        self._alike: dict[Hypothesis, Alike] = {}

    def likeliest(self, models: Sequence[tuple[Added, Fitted]]) -> tuple[Added, Fitted]:
        """Return the likeliest of some models, weighed among themselves.

        Beside all others both may have no probability that a number can hold.
        """
        models = self._in_doubt(models)
        weighed = self._weighed(models)
        return models[int(np.argmax(probabilities(weighed.priors, weighed.densities)))]

    def _in_doubt(self, models: Sequence[tuple[Added, Fitted]]) -> list[tuple[Added, Fitted]]:
        """Return the models whose fit is not so far behind the best one that they are out of the question.

        Far behind, one has no probability that a number can hold, and its fit was given up.
        """
        best = max(fitted.objective for _, fitted in models)
        return [m for m in models if not m[1].objective < best - self.fits.doubt]

    def posterior(self) -> Posterior:
        """Return how likely every model is that was fitted and is in doubt."""
        self.fits.say("how likely is each model?")
        compared = self._in_doubt([*self.fits.models.values()])
        nominal = self.fits.models.get(frozenset())
        if nominal is not None and nominal not in compared:
            compared.append(nominal)  # which users know: how much likelier is what was found?
        weighed = self._weighed(compared)
        priors, densities = weighed.priors, weighed.densities
        shares = probabilities(priors, densities)
        order = np.argsort(-shares, kind="stable")
        first = weighed.predicted[order[0]]
        # What is unlisted acts beside it, or is what its many parameters stand for; then it predicts as well.
        unlisted = densities[order[0]] + np.vstack([self._lacking(first), np.zeros(densities.shape[1])])
        odds = np.array([0.0, self._stand_in(first)]) + math.log(PRIORS.odds["none"])
        joint = probabilities(np.append(priors, priors[order[0]] + odds), np.vstack([densities, unlisted]))
        found = tuple(
            Model(
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
        return Posterior(found, float(joint[len(order) :].sum()), coverage(first.aheads))

    def _weighed(self, models: Sequence[tuple[Added, Fitted]]) -> _Weighed:
        """Return models with what is compared of them."""
        new = [m for m in models if id(m[1]) not in self._known]
        found = self.fits.augmented.share(lambda model: self._predicted(*model), new)
        self._known |= {id(p.fitted): p for p in found}
        predicted = [self._known[id(fitted)] for _, fitted in models]
        for h in dict.fromkeys(h for p in predicted for h in p.added if h not in self._alike):
            self._alike[h] = _alike(h, self.rounds, self._odds)
        classes = [[self._alike[h] for h in p.added] for p in predicted]
        priors = [_log_prior(p, c, self._odds) for p, c in zip(predicted, classes, strict=True)]
        return _Weighed(predicted, classes, np.array(priors), shared_horizons(np.array([p.blocks for p in predicted])))

    def _predicted(self, added: Added, fitted: Fitted) -> _Predicted:
        held_out = self.fits.held_out
        judged = self.fits.judge(added, fitted.point)
        aheads = self._aheads(held_out.fitting, judged.point)
        each = sum(d.log_likelihood for d in judged.drives)  # neither has one where a free run leaves the model's range
        penalty = each - judged.log_likelihood if math.isfinite(each) else 0.0
        blocks = by_block([a.densities for a in aheads], held_out.drives, penalty)
        return _Predicted(added, fitted, aheads, penalty, blocks)

    def _aheads(self, fitting: Fitting, point: Point) -> tuple[Ahead, ...]:
        """Return how a model predicts drives at all horizons."""
        step = self.fits.augmented.spec.step
        samples = [max(1.0, h if math.isinf(h) else round(h / step)) for h in HORIZONS]
        each = zip(fitting.drives, fitting.candidates([point]), strict=True)
        return tuple(fitting.augmented.share(lambda one: self._prediction.of(*one, samples), each))

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
        if not any(h.name == ALL_PARAMETERS for h in p.added):
            return -math.inf
        return log_stand_in(p.fitted, p.added, self.fits.fitting.information(p.fitted))


def _log_prior(p: _Predicted, classes: Sequence[Alike], odds: dict[tuple[str, str], float]) -> float:
    """Return the logarithm of the prior of a model, over that of the nominal one; what is alike counts together."""
    each = [logsumexp([odds[h.kind, h.name] for h in c.hypotheses]) for c in classes]
    return float(sum(each)) + log_size(p.fitted, p.added)


def _alike(h: Hypothesis, rounds: Sequence[Round], odds: dict[tuple[str, str], float]) -> Alike:
    """Return a hypothesis with those that were not fitted, because these drives show the same of them."""
    found = [h]
    own = _tried(h, rounds)
    if own is not None:
        r, c = own
        found += [
            o.hypothesis
            for o in r.candidates
            if o.fitted is None and not o.hypothesis.parts and o.score.excited and same(o.score, c.score)
        ]
    weights = np.exp([odds[k.kind, k.name] for k in found])
    return Alike(tuple(found), tuple(map(float, weights / weights.sum())))


def _tried(h: Hypothesis, rounds: Sequence[Round]) -> tuple[Round, Candidate] | None:
    """Return the first round in which a hypothesis was fitted; a random process also where several were at once."""

    def fitted(r: Round, c: Candidate) -> bool:
        at_once = (o for o in r.candidates if h.random and h in o.hypothesis.parts)
        return any(o.fitted is not None for o in (c, *at_once))

    return next(((r, c) for r in rounds for c in r.candidates if c.hypothesis == h and fitted(r, c)), None)
