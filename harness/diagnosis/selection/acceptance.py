"""Judge the candidates of a round: what is added, why, and what the drives hardly distinguish from it."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

from harness.diagnosis.criteria import (
    BIC_NEEDED,
    EXCESS,
    HOPEFUL,
    MOST,
    PRIORS,
    SAME,
)
from harness.diagnosis.fitting import FittedHypothesis
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.selection.score_test import Score, cosine
from harness.diagnosis.selection.validation import Judgement, predicts_better
from harness.identification.uncertainty import at_bound
from harness.models.contracts import Parameter
from harness.study.results import words


@dataclass(frozen=True)
class Candidate:
    """A hypothesis as tried in a round.

    Attributes:
        score: Of the test, with the predicted gain.
        fitted: Fitted jointly with everything found before; ``None`` if its predicted gain is too small.
        bic: Gain in BIC over the model without it, predicted or fitted.
        held_out: What the held-out drives say; ``None`` if it was not fitted.
    """

    score: Score
    fitted: FittedHypothesis | None
    bic: float
    held_out: Judgement | None

    @property
    def hypothesis(self) -> Hypothesis:
        """What was tried."""
        return self.score.hypothesis

    @property
    def detectable(self) -> dict[str, float]:
        """Detection limit of each amplitude: three standard errors; infinite where the drives could show none."""
        return {a: 3.0 * float(e) for a, e in zip(self.hypothesis.amplitudes, self.score.error, strict=True)}


@dataclass(frozen=True)
class Round:
    """One round of the selection.

    Attributes:
        candidates: Everything tried, best first.
        before: The model without any of them, on the held-out drives, where it was refitted as its fits do best there.
        added: The one that was added; ``None`` in the last round.
        reason: Why, or why not, in a sentence.
        best: Name of what was added, or of what came nearest to it; empty if nothing was fitted.
        hopeful: What was not added, but may be with a further addition.
    """

    candidates: tuple[Candidate, ...]
    before: Judgement
    added: Candidate | None
    reason: str
    best: str
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
        return Round(candidates, before, None, "the score test predicts too little gain for any hypothesis", "")
    best = preferred([c for c in tried if not objections(c, before)])
    hopeful = None if best or room < 2 else next((c for c in tried if passes_except_error(c, before)), None)
    best = best or hopeful or tried[0]
    against = objections(best, before)
    met = "both criteria of a random process" if best.hypothesis.random else "all three criteria"
    reason = "; ".join(against) or f"meets {met}"
    added = None if against or room < 1 else best
    return Round(candidates, before, added, reason, best.hypothesis.name, hopeful)


def with_sensor(decided: Round) -> Round:
    """Return a round without accepted hypothesis with the likeliest fault of a sensor that clears its own signal."""
    best = next((c for c in decided.candidates if clears_its_sensor(c, decided.before)), None)
    if best is None:
        return decided
    reason = "takes away half of the simulation error, or more, of the one signal on which it acts"
    return Round(decided.candidates, decided.before, best, reason, best.hypothesis.name)


def clears_its_sensor(c: Candidate, before: Judgement) -> bool:
    """Whether a fault of one sensor takes away half of the error of its signal, while that of all does not grow."""
    own = c.hypothesis.output
    if own is None or c.hypothesis.random or c.held_out is None or before.normalised_excess_mses[own] <= EXCESS:
        return False
    likelier = c.bic >= BIC_NEEDED and likelier_held_out(c, before)
    less = c.held_out.normalised_excess_mses[own] <= (1 - MOST) * before.normalised_excess_mses[own]
    return likelier and less and c.held_out.normalised_excess_mse < before.normalised_excess_mse


def likelier_held_out(c: Candidate, before: Judgement) -> bool:
    """Whether the held-out drives speak for a candidate.

    What changed since a baseline is taken up by the parameters too, as far as the baseline leaves these open, and then
    predicts as well: what tells is what the baseline says of their values. There all drives together have to be
    evidence enough.
    """
    assert c.held_out is not None
    rise = c.held_out.log_likelihood - before.log_likelihood
    return rise > 0.0 or (c.hypothesis.changed and c.bic + 2.0 * rise >= BIC_NEEDED)


def passes_except_error(c: Candidate, before: Judgement) -> bool:
    """Whether the only objection to a hypothesis is that the simulation error falls too little."""
    assert c.held_out is not None
    likelier = c.bic >= HOPEFUL and likelier_held_out(c, before)
    return (
        c.hypothesis.name != ALL_PARAMETERS
        and likelier
        and EXCESS < c.held_out.normalised_excess_mse <= before.normalised_excess_mse
    )


def with_further(decided: Round, further: Round) -> Round:
    """Return a round with the hopeful candidate added, because with a further addition it meets the criteria."""
    assert further.added is not None
    reason = f"meets all three criteria together with {words(further.added.hypothesis.name.replace('@', ' of '))}"
    return replace(decided, added=decided.hopeful, reason=reason)


def acts_alike(score: Score, other: Score) -> bool:
    """Whether the drives excite one hypothesis, and it explains most of what another does.

    Of what a response gains another takes over the squared cosine of the two.
    """
    return score.excited and cosine(score, other) ** 2 > MOST


def objections(c: Candidate, before: Judgement) -> list[str]:
    """Return which criteria a candidate that was fitted to the model ``before`` does not meet."""
    assert c.held_out is not None
    sentences = []
    if c.bic < BIC_NEEDED:
        sentences.append(f"the gain in BIC is {c.bic:.0f}, less than {BIC_NEEDED:.0f}")
    if not likelier_held_out(c, before):
        sentences.append("the likelihood of the held-out drives does not rise")
    if not c.hypothesis.random and not predicts_better(c.held_out, before):  # which no simulation predicts
        sentences.append("the simulation error on the held-out drives does not fall by a fifth")
    return sentences


def beyond_belief(fitted: FittedHypothesis, added: Sequence[Hypothesis]) -> str:
    """Return which of many parameters would be wrong by implausible factors, and by which; empty if none is.

    Args:
        fitted: A fit.
        added: What it holds; only the hypothesis that many parameters are wrong at once has such factors, of which
            one that was added besides is one.
    """
    return strayed(fitted, {n for h in added if h.name == ALL_PARAMETERS for n in h.amplitudes})


def strayed(fitted: FittedHypothesis, names: Container[str]) -> str:
    """Return which of some parameters a fit has by implausible factors of what is stated, the three farthest."""
    beyond: list[tuple[float, str]] = []
    for at in (c for c in fitted.coordinates if c.name in names):
        value = fitted.point.value(at)
        deviations = abs(at.coordinate(value) - at.centre) / at.stated_std
        if deviations > PRIORS.implausible:
            beyond.append((deviations, f"{words(at.name)} {value / at.value(at.centre):.2g}"))
    return ", ".join(text for _, text in sorted(beyond, reverse=True)[:3])


def implausible(parameters: Sequence[Parameter], fitted: FittedHypothesis, h: Hypothesis) -> bool:
    """Whether what a fit says of a hypothesis is hard to believe, so that something large by nature may be there.

    A stated value is off by more than ``PRIORS.implausible`` of its standard deviations, an amplitude ended at a bound,
    or one is nearer to what it is where the effect is large by nature than to none of it.
    """
    if h.random:
        return False
    stated = [c for c in fitted.coordinates if h.kind == "parameter" and c.name in h.amplitudes]
    off = (abs(c.coordinate(fitted.point.value(c)) - c.centre) / c.stated_std for c in stated)
    if any(deviations > PRIORS.implausible for deviations in off) or ends_at_bound(parameters, fitted, [h]):
        return True
    natural = [(p, v) for p in parameters if p.name in h.amplitudes for v in p.natural]
    values = {c.name: fitted.point.value(c) for c in fitted.coordinates}
    return any(abs(values[p.name] - v) < abs(values[p.name] - (p.neutral or 0.0)) for p, v in natural)


def ends_at_bound(
    parameters: Sequence[Parameter], fitted: FittedHypothesis, added: Sequence[Hypothesis]
) -> tuple[str, ...]:
    """Return the amplitudes of additions whose fit ended at a bound of what is possible.

    Such a one stands for something else, or for more than it can. That an effect is absent is no bound of it, and of
    one that is large by nature, as an axle that is up, neither is the value that it has there.

    Args:
        parameters: Of the augmented model.
        fitted: A fit.
        added: What it holds.
    """
    declared = {p.name: p for p in parameters}
    amplitudes = {n for h in added if not h.random for n in h.amplitudes}
    ended = []
    for c in (c for c in fitted.coordinates if c.name in amplitudes):
        p, value = declared[c.name], fitted.point.value(c)
        near = 0.01 * (p.upper - p.lower)
        usual = any(abs(value - v) < near for v in (*p.natural, *([] if p.neutral is None else [p.neutral])))
        if at_bound(c.coordinate(value), c.lower, c.upper) and not usual:
            ended.append(c.name)
    return tuple(ended)


def preferred(passing: Sequence[Candidate]) -> Candidate | None:
    """Return which of the accepted candidates, best first, is added.

    Many parameters at once are added only if nothing else makes the free run over the held-out drives likelier: they
    fit anything a little, and out of sample the right one does better. Nor is a random process, where the other gains
    most of what it does: it takes up whatever is slow, a constant as well, and then hides it from score tests, while
    the rest of it can be added to what is no process. The error for which it allows counts against it.
    """
    best = next(iter(passing), None)
    if best is None or best.held_out is None or not (best.hypothesis.random or best.hypothesis.name == ALL_PARAMETERS):
        return best
    reached, enough = best.held_out.log_density, MOST * best.bic if best.hypothesis.random else -math.inf
    plain = [c for c in passing if not c.hypothesis.random and c.bic > enough]
    return next((c for c in plain if c.held_out is not None and c.held_out.log_density > reached), best)


def hardest(judged: Sequence[Judgement]) -> Judgement:
    """Return a model without addition with the best that its fits reach on the held-out drives.

    The likeliest fit may be the worst out of sample; an addition must not be accepted because of that.
    """
    best = min(judged, key=lambda j: j.normalised_excess_mse)
    return replace(best, log_likelihood=max(j.log_likelihood for j in judged))


def lookalikes(
    winner: Candidate, before: Judgement, promised: Sequence[Score], tried: Container[Hypothesis]
) -> list[Score]:
    """Return what acts like the best of what was tried, if that passes, or may yet, but leaves something.

    Another may be the right one: the prediction is linear, and of two of like response, a nonlinear one may be
    predicted less than half the gain and reach far more.
    """
    assert winner.held_out is not None
    passes = not objections(winner, before) or passes_except_error(winner, before)
    if winner.held_out.normalised_excess_mse < EXCESS or not passes:
        return []
    single = [s for s in promised if s.hypothesis not in tried and not s.hypothesis.many]
    return distinct([s for s in single if acts_alike(s, winner.score)])


def distinct(scores: Sequence[Score]) -> list[Score]:
    """Return scores, best first, without those that are the same as a better one."""
    kept: list[Score] = []
    for s in scores[:12]:
        if not any(same(s, k) for k in kept):
            kept.append(s)
    return kept


def same(score: Score, other: Score) -> bool:
    """Whether responses say the same: one hypothesis stands for both, unless more than responses tells them apart."""
    return abs(cosine(score, other)) > SAME


def ratio(score: Score, other: Score) -> float:
    """Return the step of one hypothesis's amplitude over that of another's; NaN where one has several."""
    single = len(score.steps) == len(other.steps) == 1 and other.steps[0] != 0.0
    return float(score.steps[0] / other.steps[0]) if single else math.nan
