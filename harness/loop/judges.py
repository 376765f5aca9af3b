"""Judge what was tried in a round: what is added, why, and what the drives can hardly tell from it."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

from harness.loop.fit import Fitted
from harness.loop.held_out import EXCESS, Judgement
from harness.loop.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.loop.score import Score, cosine
from harness.report.store import words

BIC_NEEDED = 50.0
"""Gain in BIC on the fitted drives below which nothing is added."""

ERROR_NEEDED = 0.2
"""Share of the held-out error, beyond the noise of the sensors, that an addition must take away."""

AHEAD = 50.0
"""Gain in BIC by which the best must lead a hypothesis of like response, or both are reported together."""

HOPEFUL = 500.0
"""Gain in BIC from which an addition that leaves the free-running error is tried with a further one: the error may be
that of another effect."""

SENSOR_NEEDED = 0.5
"""Share of its own signal's held-out error, beyond the noise, that a fault of one sensor must take away where the error
of other signals, on which it does not act, hides what it does to that of all."""

IMPLAUSIBLE = 3.0
"""Standard deviations of the prior, a factor of 1.8 on the stated value, beyond which no parameter of many is believed
to be wrong: large enough, anything that is missing has them fit it somehow."""

ALIKE = 0.9
"""Cosine of two responses from which hypotheses count as hard to tell apart."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis as tried in a round.

    Attributes:
        score: What it promised.
        fitted: Fitted jointly with everything found before; ``None`` if it promised too little.
        bic: Gain in BIC over the model without it, promised or fitted.
        held_out: What the held-out drives say; ``None`` if it was not fitted.
    """

    score: Score
    fitted: Fitted | None
    bic: float
    held_out: Judgement | None

    @property
    def hypothesis(self) -> Hypothesis:
        """What was tried."""
        return self.score.hypothesis


@dataclass(frozen=True)
class Round:
    """One round of the selection.

    Attributes:
        candidates: Everything tried, best first.
        before: The model without any of them, on the held-out drives, where it was refitted as its fits do best there.
        added: The one that was added; ``None`` in the last round.
        reason: Why, or why not, in a sentence.
        confusable: Names of what these drives can hardly tell from the best, itself first.
        hopeful: What was not added, but may be with a further addition.
    """

    candidates: tuple[Candidate, ...]
    before: Judgement
    added: Candidate | None
    reason: str
    confusable: tuple[str, ...]
    hopeful: Candidate | None = None


def decide(candidates: tuple[Candidate, ...], before: Judgement, room: int) -> Round:
    """Return a round with what is added.

    Args:
        candidates: Everything tried, best first.
        before: The model without any of them, on the held-out drives.
        room: How much may be added yet.
    """
    tried = [c for c in candidates if c.fitted is not None]
    if not tried:
        return Round(candidates, before, None, "nothing promises enough to be fitted", ())
    best = preferred([c for c in tried if not objections(c, before)])
    hopeful = None if best or room < 2 else next((c for c in tried if is_hopeful(c, before)), None)
    best = best or hopeful or tried[0]
    against = objections(best, before)
    reason = "; ".join(against) or "passes all three judges"
    alike = [c.hypothesis.name for c in candidates if c is not best and _alike(best, c)]
    added = None if against or room < 1 else best
    return Round(candidates, before, added, reason, (best.hypothesis.name, *alike), hopeful)


def with_sensor(found: Round) -> Round:
    """Return a round in which nothing passed with the likeliest fault of a sensor added that clears its own signal."""
    best = next((c for c in found.candidates if clears_its_sensor(c, found.before)), None)
    if best is None:
        return found
    reason = "takes away half of the error, or more, of the one signal on which it acts"
    alike = [c.hypothesis.name for c in found.candidates if c is not best and acts_alike(c.score, best.score)]
    return Round(found.candidates, found.before, best, reason, (best.hypothesis.name, *alike))


def clears_its_sensor(c: Candidate, before: Judgement) -> bool:
    """Whether a fault of one sensor takes away half of the error of its signal, while that of all does not grow."""
    own = c.hypothesis.output
    if own is None or c.held_out is None or before.excesses[own] <= EXCESS:
        return False
    likelier = c.bic >= BIC_NEEDED and c.held_out.log_likelihood > before.log_likelihood
    less = c.held_out.excesses[own] <= (1 - SENSOR_NEEDED) * before.excesses[own]
    return likelier and less and c.held_out.excess < before.excess


def is_hopeful(c: Candidate, before: Judgement) -> bool:
    """Whether all that speaks against adding a hypothesis is that the free-running error falls too little."""
    assert c.held_out is not None
    likelier = c.bic >= HOPEFUL and c.held_out.log_likelihood > before.log_likelihood
    return c.hypothesis.name != ALL_PARAMETERS and likelier and EXCESS < c.held_out.excess <= before.excess


def with_further(found: Round, further: Round) -> Round:
    """Return a round with what was hopeful added, because with a further addition it is among what passes."""
    assert further.added is not None
    reason = f"passes all three judges together with {words(further.added.hypothesis.name.replace('@', ' of '))}"
    return replace(found, added=found.hopeful, reason=reason)


def _alike(best: Candidate, other: Candidate) -> bool:
    return best.bic - other.bic < AHEAD or acts_alike(other.score, best.score)


def acts_alike(one: Score, other: Score) -> bool:
    """Whether the drives, which show one hypothesis, can hardly tell it from another."""
    return one.excited and abs(cosine(one, other)) > ALIKE


def objections(c: Candidate, before: Judgement) -> list[str]:
    """Return what speaks against adding a candidate that was fitted to the model ``before``."""
    assert c.held_out is not None
    found = []
    if c.bic < BIC_NEEDED:
        found.append(f"the gain in BIC is {c.bic:.0f}, less than {BIC_NEEDED:.0f}")
    if c.held_out.log_likelihood <= before.log_likelihood:
        found.append("the held-out drives are not more likely with it")
    if c.held_out.excess > (1 - ERROR_NEEDED) * before.excess:
        found.append("the free-running error on the held-out drives does not fall by a fifth")
    # Where they leave nothing they are shown for what they are, and the verdict doubts them.
    if c.hypothesis.name == ALL_PARAMETERS and c.held_out.excess >= EXCESS:
        assert c.fitted is not None
        if far := beyond_belief(c.fitted):
            found.append(f"stated values would be wrong by factors that nobody believes: {far}")
    return found


def beyond_belief(fitted: Fitted) -> str:
    """Return which of many parameters would be wrong by too much, and by what factors; nothing if none is."""
    factors = {}
    for at in fitted.coordinates:
        away = at.coordinate(fitted.point.value(at)) - at.centre
        if abs(away) > IMPLAUSIBLE * at.prior:
            factors[words(at.name)] = math.exp(away)
    worst = sorted(factors, key=lambda n: -abs(math.log(factors[n])))[:3]
    return ", ".join(f"{n} {factors[n]:.2g}" for n in worst)


def preferred(passing: Sequence[Candidate]) -> Candidate | None:
    """Return what is added of what passes, best first: many parameters at once only if nothing alone strays less.

    Many parameters fit anything a little; on drives that they were not fitted to the right one does better.
    """
    best = next(iter(passing), None)
    if best is None or best.hypothesis.name != ALL_PARAMETERS or best.held_out is None:
        return best
    reached = best.held_out.excess
    return next((c for c in passing if c.held_out is not None and c.held_out.excess < reached), best)


def hardest(judged: Sequence[Judgement]) -> Judgement:
    """Return a model without addition as its fits do best on the held-out drives.

    The likeliest on the fitted drives may be the worst on these; an addition shall not pass for that.
    """
    best = min(judged, key=lambda j: j.excess)
    return replace(best, log_likelihood=max(j.log_likelihood for j in judged))


def lookalikes(
    winner: Candidate, before: Judgement, promised: Sequence[Score], tried: Container[Hypothesis]
) -> list[Score]:
    """Return what acts like the best of what was tried, if that passes, or may yet, but leaves something.

    Another may be meant: a promise is linear, and of two that act alike, one that bends may promise less than half and
    reach far more.
    """
    assert winner.held_out is not None
    passes = not objections(winner, before) or is_hopeful(winner, before)
    if winner.held_out.excess < EXCESS or not passes:
        return []
    single = [s for s in promised if s.hypothesis not in tried and s.hypothesis.name != ALL_PARAMETERS]
    return [s for s in single if acts_alike(s, winner.score)]


def distinct(scores: Sequence[Score]) -> list[Score]:
    """Return scores, best first, without those whose response is that of a better one to a thousandth."""
    kept: list[Score] = []
    for s in scores[:12]:
        if all(abs(cosine(s, k)) < 0.999 for k in kept):
            kept.append(s)
    return kept
