"""Find what a model lacks: forward selection over everything it may lack, checked backwards at the end.

In each round (``selection_round``) the score test ranks all hypotheses, the best few are fitted jointly with the
nominal parameters, and the best of these is added if it meets three criteria: the Bayes information criterion on the
fitted drives, the likelihood and the simulation error of drives that were never fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from harness.common.arrays import Floats
from harness.common.failures import RAISED, Failures
from harness.diagnosis.criteria import BIC_NEEDED, ROUNDS, TRIED
from harness.diagnosis.fitting.fit import Fitted, Fitting
from harness.diagnosis.fitting.kept_fits import KeptFits
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.selection.acceptance import Round, with_further
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, Say
from harness.diagnosis.selection.model_comparison import compared
from harness.diagnosis.selection.posterior import Posterior
from harness.diagnosis.selection.selection_round import SelectionRound, selection_round
from harness.diagnosis.selection.validation import HeldOut, Judgement
from harness.identification.data import Drive
from harness.identification.signal_noise import white_noise
from harness.models.quantities import listed


@dataclass(frozen=True)
class Trace:
    """What was found.

    Attributes:
        fitting: The fitted drives.
        held_out: The held-out drives.
        free: Parameters of the nominal model that were fitted.
        nominal: The nominal model fitted; of its fits the one of least simulation error on the held-out drives.
        final: The model with everything added.
        added: In the order added, without what the checks at the end took away, and with what they put in its place.
        rounds: Of the selection.
        dropped: What the checks at the end took away.
        before: The nominal model on the held-out drives.
        after: The final one there.
        cut_short: Why the search ended before everything was tried; empty if it did not.
        posterior: How likely each model is that was fitted; ``None`` if that could not be computed.
    """

    fitting: Fitting
    held_out: HeldOut
    free: tuple[str, ...]
    nominal: Fitted
    final: Fitted
    added: tuple[Hypothesis, ...]
    rounds: tuple[Round, ...]
    dropped: tuple[Hypothesis, ...]
    before: Judgement
    after: Judgement
    cut_short: str = ""
    posterior: Posterior | None = None

    @property
    def effects(self) -> tuple[Hypothesis, ...]:
        """Effects among what was added."""
        return tuple(h for h in self.added if h.kind == "effect")


def trace(
    augmented: AugmentedModel,
    train: Sequence[Drive],
    test: Sequence[Drive],
    free: Sequence[str],
    say: Say = lambda _: None,
    rounds: int = ROUNDS,
    stated_noise: bool = False,
    failures: Failures = RAISED,
    kept: KeptFits | None = None,
) -> Trace:
    """Find what the model lacks.

    Args:
        augmented: The nominal model with everything it may lack.
        train: Drives to fit.
        test: Held-out drives.
        free: Parameters of the nominal model that are fitted in any case.
        say: Is told what is being tried.
        rounds: Largest number of additions.
        stated_noise: Whether the noise is the stated one, that of the sensors at least, and not refitted. A model of
            a real vehicle is never quite right, and process noise that is fitted to that takes up what is missing.
        failures: Takes a round that cannot be computed; what earlier ones found stands. By default it is raised.
        kept: Fits of the same trace, where it was interrupted; they are not fitted again.
    """
    variances = first_variances(augmented, [*train, *test], stated_noise)
    fitting = Fitting(augmented, train, variances, stated_noise, [*train, *test])
    candidate_fits = CandidateFits(fitting, HeldOut(augmented, test, variances), tuple(free), say, kept)
    return _Search(candidate_fits, rounds, failures).run()


def first_variances(augmented: AugmentedModel, drives: Sequence[Drive], stated_noise: bool = False) -> Floats:
    """Return the white noise of every output ``(ny,)``; that of the model where a signal is too coarse to show it.

    With ``stated_noise`` it is that of the model where the signals have less.
    """
    stated = np.array([augmented.spec.measurement_noise[n] for n in augmented.model.outputs])
    found = np.array([white_noise(drives, a) for a in range(len(stated))])
    found = np.where(found > 1e-12 * stated, found, stated)
    return np.maximum(found, stated) if stated_noise else found


class _Search:
    def __init__(self, candidate_fits: CandidateFits, rounds: int, failures: Failures = RAISED) -> None:
        self.candidate_fits, self.rounds, self.failures = candidate_fits, rounds, failures
        self.cut_short = ""

    def run(self) -> Trace:
        """Return what was found: round after round until nothing is accepted, then the checks of all additions."""
        candidate_fits = self.candidate_fits
        candidate_fits.say("fitting the nominal model")
        nominal = best = candidate_fits.fit((), candidate_fits.fitting.first(), 25)
        added: Added = ()
        rounds: list[Round] = []
        while len(rounds) <= self.rounds:
            number = len(rounds) + 1
            tried, passed = self.failures.attempt(
                f"round {number} of the search", partial(self._round, added, best, number), self._lost
            )
            if tried is not None:
                best = tried.best
                if not added:
                    nominal = min(tried.without, key=lambda f: candidate_fits.judge((), f.point).normalised_excess_mse)
            rounds += passed or [Round((), candidate_fits.judge(added, best.point), None, self.cut_short, ())]
            if rounds[-1].added is None:
                break
            for r in passed:
                assert r.added is not None
                assert r.added.fitted is not None
                added, best = (*added, *r.added.hypothesis.single), r.added.fitted
        kept, best = self.failures.attempt(
            "the checks of what was added", lambda: self._checked(added, best, rounds), lambda _: (added, best)
        )
        posterior = self.failures.attempt(
            "the probability of each model", lambda: compared(candidate_fits, rounds, kept, best), lambda _: None
        )
        return Trace(
            candidate_fits.fitting,
            candidate_fits.held_out,
            candidate_fits.free,
            nominal,
            best,
            kept,
            tuple(rounds),
            tuple(h for h in added if h not in kept),
            candidate_fits.judge((), nominal.point),
            candidate_fits.judge(kept, best.point),
            self.cut_short,
            posterior,
        )

    def _round(self, added: Added, best: Fitted, number: int) -> tuple[SelectionRound | None, list[Round]]:
        """Try everything once; return what was tried and the round, or two."""
        tried = selection_round(self.candidate_fits, added, [best], number)
        return tried, self._passed(tried)

    def _lost(self, why: str) -> tuple[SelectionRound | None, list[Round]]:
        """Note why a round could not be computed; return that nothing was tried."""
        self.cut_short = f"it could not be computed: {why}"
        return None, []

    def _checked(self, added: Added, best: Fitted, rounds: Sequence[Round]) -> tuple[Added, Fitted]:
        """Return what stays of all additions, and with what in the place of some, fitted."""
        kept, fitted = self._backward(added, best)
        return self._parameters_instead(kept, fitted, rounds)

    def _passed(self, tried: SelectionRound) -> list[Round]:
        """Return a round; if its best candidate is hopeful, with the next one if that adds something to it.

        Of two effects one may cause the simulation error and the other most of the innovations: then neither passes
        alone.
        """
        room = self.rounds + 1 - tried.number
        found = tried.decided(room)
        if found.hopeful is not None:
            assert found.hopeful.fitted is not None
            with_it = (*tried.added, *found.hopeful.hypothesis.single)
            further = selection_round(self.candidate_fits, with_it, [found.hopeful.fitted], tried.number + 1).decided(
                room - 1
            )
            if further.added is not None:
                return [with_further(found, further), further]
        return [found if found.added is not None else tried.decided_by_sensor(room)]

    def _backward(self, added: Added, best: Fitted) -> tuple[Added, Fitted]:
        """Remove what the later additions made redundant: all but one of them, or one after the other.

        What is missing may have been taken for something else at first, and for the rest of it thereafter.
        """
        if len(added) > 1:
            self.candidate_fits.say(f"is one of {listed([h.name.replace('_', ' ') for h in added[1:]])} enough?")
        for h, (alone, lost) in zip(added[1:], self._without(added, [(h,) for h in added[1:]], best), strict=True):
            if lost < BIC_NEEDED:
                return (h,), alone
        for h in added if len(added) > 2 else ():  # without one of two the other would be alone
            rest = tuple(k for k in added if k != h)
            self.candidate_fits.say(f"is {h.name.replace('_', ' ')} still needed?")
            without, lost = self.candidate_fits.without(added, rest, best)
            if lost < BIC_NEEDED:
                added, best = rest, without
        return added, best

    def _without(self, added: Added, rests: Sequence[Added], best: Fitted) -> list[tuple[Fitted, float]]:
        """Return the model with only some of its additions, for several choices at once, and what each loses in BIC."""
        fits = self.candidate_fits
        return fits.augmented.share(lambda rest: fits.without(added, rest, best), rests)

    def _parameters_instead(self, added: Added, best: Fitted, rounds: Sequence[Round]) -> tuple[Added, Fitted]:
        """Put a wrong parameter in place of an effect if it explains as much together with those added thereafter.

        Of several wrong parameters none alone reaches an effect that resembles their sum; what that leaves is then
        taken for one of them.
        """
        for i, h in enumerate(added):
            rest = tuple(k for k in added if k != h)
            if h.kind != "effect" or all(k.kind != "parameter" for k in added[i + 1 :]):
                continue
            parameters = _stand_ins(rounds, added)[:TRIED]
            if not parameters:
                continue
            names = [p.name.replace("_", " ") for p in parameters]
            self.candidate_fits.say(f"may {listed(names)} stand for {h.name.replace('_', ' ')}?")
            fits = self._without(added, [(*rest, p) for p in parameters], best)
            p, (fitted, lost) = min(zip(parameters, fits, strict=True), key=lambda item: item[1][1])
            if lost < BIC_NEEDED:
                return (*rest, p), fitted
        return added, best


def _stand_ins(rounds: Sequence[Round], added: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return parameters that the drives hardly distinguish from those that were added, the best of each round first."""
    found: dict[Hypothesis, None] = {}
    for r in rounds:
        if r.added is not None and r.added.hypothesis in added and r.added.hypothesis.kind == "parameter":
            alike = [c.hypothesis for c in r.candidates if c.hypothesis.name in r.alike]
            found |= {h: None for h in alike if h.kind == "parameter" and h.name != ALL_PARAMETERS and h not in added}
    return list(found)
