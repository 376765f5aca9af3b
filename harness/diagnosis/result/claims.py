"""Claims of a trace: the verdict, and how likely each addition and its rivals are.

Headline, table of odds, ``trace.json`` and page read what is claimed here and nowhere else, so they cannot disagree.

A final model whose simulation of the held-out drives is worse than that of the nominal one is no answer: the nominal
model stays, the verdict is ``unresolved``, and what was refused is stated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from harness.diagnosis.criteria import BIC_NEEDED, EXCESS
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.residuals.localisation import Localisation
from harness.diagnosis.result.confounded import Direction
from harness.diagnosis.selection.acceptance import beyond_belief, ends_at_bound
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.posterior import ComparedModel, Posterior
from harness.diagnosis.selection.validation import ErrorGrowth, Judgement, error_growth, leaves_nothing

Verdict = Literal["adequate", "amended", "unresolved"]

RIVAL = 0.1
"""Probability from which what may be there in the place of an addition is named with it."""


@dataclass(frozen=True)
class Refused:
    """Additions with which the held-out drives are simulated worse than without them.

    Attributes:
        trace: As it was searched, with its final model.
        growth: Of the simulation error over that of the nominal model.
    """

    trace: Trace
    growth: ErrorGrowth


def refusal(trace: Trace) -> Refused | None:
    """Return the additions of a trace if they are refused as worse than none; ``None`` if they stay."""
    if not trace.added:
        return None
    growth = error_growth(trace.held_out, trace.before, trace.after)
    return Refused(trace, growth) if growth.beyond_noise else None


def without_additions(refused: Refused) -> Trace:
    """Return the trace with the nominal model as the final one; all models that are as bad lose their probability."""
    trace = refused.trace

    def worse(m: ComparedModel) -> bool:
        judged = trace.held_out.judge([a.hypotheses[0] for a in m.added], m.fitted.point)
        return error_growth(trace.held_out, trace.before, judged).beyond_noise

    posterior = None if trace.posterior is None else trace.posterior.refusing(worse)
    return replace(trace, final=trace.nominal, added=(), after=trace.before, posterior=posterior)


@dataclass(frozen=True)
class Rival:
    """What may be there in the place of an addition: a hypothesis, or nothing, with its probability."""

    hypothesis: Hypothesis | None
    probability: float


@dataclass(frozen=True)
class Claims:
    """What a trace claims.

    Attributes:
        verdict: On the model.
        added: What the final model has beyond the nominal one.
        posterior: How likely each model is; ``None`` if that is not known.
        at_bound: Amplitudes of the additions that ended at a bound.
        refused: Additions that the final model lacks because they are worse than none, if there were any.
        confounded: Directions in which the drives do not tell what was added or refitted from something else.
    """

    verdict: Verdict
    added: tuple[Hypothesis, ...]
    posterior: Posterior | None
    at_bound: tuple[str, ...] = ()
    refused: Refused | None = None
    confounded: tuple[Direction, ...] = ()

    @property
    def conditional(self) -> bool:
        """Whether probabilities are those if one of the models is right, because probably none is."""
        return self.posterior is not None and 0.5 < self.posterior.none < 1.0

    @property
    def given_right(self) -> float:
        """Factor by which the probabilities of models are told: that of one right model where they are conditional."""
        assert self.posterior is not None
        return 1.0 / (1.0 - self.posterior.none) if self.conditional else 1.0

    def probability(self, hypotheses: Iterable[Hypothesis]) -> float | None:
        """Return the probability that all of some additions are right; ``None`` where it was not computed."""
        wanted = tuple(hypotheses)
        if self.posterior is None or not set(self.added).issuperset(wanted):  # a random process is none of the models
            return None
        return self.given_right * self.posterior.probability_of(wanted)

    @property
    def hinging(self) -> tuple[Direction, ...]:
        """The directions with something that was added, of which the drives know a combination alone."""
        added = {n for h in self.added for n in h.amplitudes if h.name != ALL_PARAMETERS}
        return tuple(d for d in self.confounded if added.intersection((d.parameter, *d.named)))

    @property
    def all_rivals(self) -> tuple[Hypothesis, ...]:
        """What may be there in the place of any of the additions."""
        return tuple({r.hypothesis: None for h in self.added for r in self.rivals(h) if r.hypothesis is not None})

    def adequate(self) -> float | None:
        """Return the probability of the model without additions, if there are none; ``None`` where it is not known."""
        alone = None if self.posterior is None or self.added else self.posterior.model_with(())
        return None if alone is None else self.given_right * alone.probability

    def rivals(self, h: Hypothesis) -> tuple[Rival, ...]:
        """Return what may be there in the place of an addition, the likeliest first.

        That is what models without it have that the final one has not, and what the drives cannot tell from it.
        """
        if self.posterior is None:
            return ()
        found: dict[Hypothesis | None, float] = {}
        for m in self.posterior.models:
            instead = [a for a in m.added if not set(self.added).intersection(a.hypotheses)]
            own = [a for a in m.added if h in a.hypotheses]
            for alike in own or instead:
                for rival, share in zip(alike.hypotheses, alike.shares, strict=True):
                    if rival not in self.added:
                        found[rival] = found.get(rival, 0.0) + self.given_right * m.probability * share
            if not own and not instead:
                found[None] = found.get(None, 0.0) + self.given_right * m.probability
        likely = [Rival(rival, p) for rival, p in found.items() if p >= RIVAL]
        return tuple(sorted(likely, key=lambda rival: -rival.probability))


def claims_of(trace: Trace, localisation: Localisation, coloured: bool, refused: Refused | None = None) -> Claims:
    """Return what a trace claims.

    Nothing is settled by what was refused, by an addition that ended at a bound, which stands for something else, or
    where probably something else is there that was not described either.

    Args:
        trace: What was found, without what was refused.
        localisation: Where something is missing that has no name.
        coloured: Whether the innovations of the final model on the held-out drives are coloured.
        refused: What was refused.
    """
    posterior = final_posterior(trace, localisation)
    bounds = ends_at_bound(trace.fitting.augmented.model.parameters, trace.final, trace.added)
    named = localisation.unmodelled is not None or localisation.random_process is not None
    unlisted = posterior is not None and posterior.none > 0.5 and not named
    open_ = refused is not None or bounds or unlisted
    verdict = "unresolved" if open_ else verdict_of(trace, localisation, coloured)
    return Claims(verdict, trace.added, posterior, bounds, refused)


def verdict_of(trace: Trace, localisation: Localisation, coloured: bool) -> Verdict:
    """Return whether the model is adequate, amended, or lacks something that has no name here.

    Something is still missing if the innovations of the final model on the held-out drives are coloured, whatever was
    added: then an effect may have been mistaken for another. So it is if the simulation error there, with the
    unmodelled disturbance if one was found, exceeds the sensor noise and what random processes may do, and either one
    was found or the last round held a hypothesis that gained enough but was not accepted. A random process is accepted
    where it leaves white innovations, or almost. Many wrong parameters explain nothing if one would be wrong by an
    implausible factor. A search that was cut short has not tried everything.
    """
    if trace.cut_short or trace.discrepancy or beyond_belief(trace.final, trace.added):
        return "unresolved"
    if localisation.random_process is not None:
        return "amended" if localisation.random_process.white else "unresolved"
    if coloured and (trace.effects or localisation.unmodelled is None):
        return "unresolved"
    if localisation.unmodelled is not None and final_judgement(trace, localisation).unexplained > EXCESS:
        return "unresolved"
    if localisation.unmodelled is None and _failed(trace) and not leaves_nothing(trace.after, trace.before):
        return "unresolved"
    return "amended" if trace.effects or localisation.unmodelled is not None else "adequate"


def final_judgement(trace: Trace, localisation: Localisation) -> Judgement:
    """Return the final model on the held-out drives, with the unmodelled disturbance if that lowers its error."""
    if (
        localisation.unmodelled is not None
        and localisation.unmodelled.judgement.normalised_excess_mse < trace.after.normalised_excess_mse
    ):
        return localisation.unmodelled.judgement
    return trace.after


def final_posterior(trace: Trace, localisation: Localisation) -> Posterior | None:
    """Return how likely each model is; what has no name, where that was found, makes it likelier that none is right."""
    if trace.posterior is None or localisation.unmodelled is None:
        return trace.posterior
    return trace.posterior.with_unlisted(trace.final, localisation.unmodelled.held_out_gain)


def strays(trace: Trace) -> bool:
    """Whether something is left that the named effects do not explain."""
    return not leaves_nothing(trace.after, trace.before) and (_failed(trace) or not trace.effects)


def _failed(trace: Trace) -> bool:
    """Whether the last round held a hypothesis that gained enough on the fitted drives but was not accepted."""
    last = trace.rounds[-1]
    return last.added is None and any(c.fitted is not None and c.bic >= BIC_NEEDED for c in last.candidates)
