"""Growth of a model by everything that drives show beyond it, with all stated parameters free within their priors.

A real vehicle differs from its model in many ways at once. What is added need not explain most of the error, as a
single missing effect does: it is added by evidence that is strong and no more, and a higher likelihood of held-out
drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from harness.diagnosis.criteria import CORRELATED, DIFFERENCES, INDEPENDENT, STRONG, TRIED
from harness.diagnosis.fitting import FittedHypothesis
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, hypotheses
from harness.diagnosis.selection.acceptance import Round, distinct
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, Say
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.identification.data import DriveData
from harness.identification.signal_noise import white_spacing
from harness.models.quantities import words

_STANDS = f"gains more than {STRONG:.0f} units of BIC, and the held-out drives are likelier with it"
_FALLS = f"nothing gains {STRONG:.0f} units of BIC and makes the held-out drives likelier as well"


def all_parameters(augmented: AugmentedModel) -> Hypothesis:
    """Return the hypothesis that all stated values differ from the vehicle's."""
    return next(h for h in hypotheses(augmented, ()) if h.name == ALL_PARAMETERS)


def spacing_of(augmented: AugmentedModel, drives: Sequence[DriveData], say: Say) -> tuple[int, ...]:
    """Return how many steps apart samples of each output are taken, and say where that is not every one ``(ny,)``.

    Process noise, parameters and effects would all describe the spectrum of coloured noise.
    """
    spacing = white_spacing(drives, CORRELATED, INDEPENDENT)
    for output, every in zip(augmented.nominal.outputs, spacing, strict=True):
        if every > 1:
            say(f"samples of {words(output)} are taken {every} steps apart, where their noise is white")
    return spacing


def grown(
    fits: CandidateFits, added: Added, best: FittedHypothesis, what: str, most: int = DIFFERENCES
) -> tuple[Added, FittedHypothesis, list[Round]]:
    """Return a model with what drives show beyond it, effect by effect, its fit, and the rounds of that.

    Args:
        fits: Of the drives.
        added: What the model has.
        best: Its fit.
        what: Grows, in words.
        most: Largest number of additions.
    """
    refused: set[Hypothesis] = set()
    rounds: list[Round] = []
    for number in range(1, most + 1):
        rounds.append(_next(SelectionRound(fits, added, [best], f"{what}, round {number}"), refused))
        further = rounds[-1].added
        if further is None or further.fitted is None:
            break
        added, best = fits.joined(added, further.hypothesis), further.fitted
    return added, best, rounds


def _next(current: SelectionRound, refused: set[Hypothesis]) -> Round:
    """Return a round with the effect that the drives show most plainly, or with none.

    What promises most is fitted first, and what does not pass is noted as refused and comes last from then on.
    """
    current.say("score test of every effect")
    lasting = [h for h in current.open() if not (h.random or h.change_times or h.many)]
    scores = current.candidate_fits.score_test(current.best).of(lasting)
    current.promised = sorted(scores, key=current.predicted_bic_gain, reverse=True)
    promising = [s for s in distinct(current.promised) if current.predicted_bic_gain(s) >= STRONG]
    promising.sort(key=lambda s: s.hypothesis in refused)
    before = current.before.log_likelihood
    for first in range(0, len(promising), TRIED):
        chosen = promising[first : first + TRIED]
        current.fit(chosen)
        judged = [current.judged(s) for s in chosen]
        passing = [c for c in judged if c.bic >= STRONG and c.held_out and c.held_out.log_likelihood > before]
        refused.update({s.hypothesis for s in chosen} - {c.hypothesis for c in passing})
        if passing:
            best = max(passing, key=lambda c: c.bic)
            return replace(current.decided(0), added=best, reason=_STANDS, best=best.hypothesis.name)
    return replace(current.decided(0), added=None, reason=_FALLS, best="")
