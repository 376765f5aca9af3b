"""Find what a model lacks: forward selection over everything it may lack; what is likely of it stays.

In each round (``selection_round``) the score test ranks all hypotheses, the promising ones are fitted jointly with the
nominal parameters, and the best of these is added if it meets three criteria: the Bayes information criterion on the
fitted drives, the likelihood and the simulation error of drives that were never fitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from harness.common.arrays import Floats
from harness.common.failures import RAISED, Failures
from harness.diagnosis.criteria import DIFFERENCES, EXCESS, FURTHER_CHANGE, ROUNDS, WHITE
from harness.diagnosis.fitting import FittedHypothesis, Fitting, KeptFits, ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis, random_processes
from harness.diagnosis.selection.acceptance import Candidate, Round, beyond_belief, strayed, with_further
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits, Say
from harness.diagnosis.selection.discrepancy import first_point, hinges, with_discrepancy
from harness.diagnosis.selection.earlier_models import NO_DRIVES, EarlierDrives, EarlierModel, fit_earlier
from harness.diagnosis.selection.growth import all_parameters, grown, spacing_of
from harness.diagnosis.selection.model_comparison import Comparison, likeliest
from harness.diagnosis.selection.posterior import Posterior
from harness.diagnosis.selection.selection_round import SelectionRound, selection_round
from harness.diagnosis.selection.validation import HeldOut, Judgement, colour_left, error_growth, leaves_nothing
from harness.identification.data import DriveData
from harness.identification.signal_noise import thinned, white_noise


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
        discrepancy: Random processes that every model has, because the model is not quite right anyway; none where the
            drives do not need them.
        known: What the model has from earlier drives of the vehicle.
        hinging: Sizes of what was added that would be others, by more than their intervals, without those.
    """

    fitting: Fitting
    held_out: HeldOut
    free: tuple[str, ...]
    nominal: FittedHypothesis
    final: FittedHypothesis
    added: tuple[Hypothesis, ...]
    rounds: tuple[Round, ...]
    dropped: tuple[Hypothesis, ...]
    before: Judgement
    after: Judgement
    cut_short: str = ""
    posterior: Posterior | None = None
    discrepancy: tuple[Hypothesis, ...] = ()
    hinging: tuple[str, ...] = ()
    known: tuple[Hypothesis, ...] = ()

    @property
    def effects(self) -> tuple[Hypothesis, ...]:
        """Effects among what was added."""
        return tuple(h for h in self.added if h.kind == "effect")


def trace(
    augmented: AugmentedModel,
    train: Sequence[DriveData],
    test: Sequence[DriveData],
    free: Sequence[str],
    say: Say = lambda _: None,
    rounds: int | None = None,
    stated_noise: bool = False,
    failures: Failures = RAISED,
    kept: KeptFits | None = None,
    earlier: EarlierDrives = NO_DRIVES,
) -> Trace:
    """Find what the model lacks.

    Args:
        augmented: The nominal model with everything it may lack.
        train: Drives to fit.
        test: Held-out drives.
        free: Parameters of the nominal model that are fitted in any case.
        say: Receives what is being tried, in words.
        rounds: Largest number of additions; by default ``ROUNDS``, of a growth ``DIFFERENCES``.
        stated_noise: Whether the noise is the stated one, that of the sensors at least, and not refitted. A model of
            a real vehicle is never quite right, and process noise that is fitted to that takes up what is missing.
        failures: Takes a round that cannot be computed; what earlier ones found stands. By default it is raised.
        kept: Fits of the same trace, where it was interrupted; they are not fitted again.
        earlier: What is known from earlier drives of the vehicle.
    """
    variances = first_variances(augmented, [*train, *test], stated_noise)
    fitting = Fitting(augmented, train, variances, stated_noise, [*train, *test])
    held_out = HeldOut(augmented, test, variances)
    fits = CandidateFits(fitting, held_out, tuple(free), say, kept, earlier.always)
    search = _ForwardSelection(fits, rounds or ROUNDS, failures, earlier.models)
    first = search.first()
    if not augmented.discrepancy or earlier.always:
        return replace(search.completed(first), discrepancy=earlier.always)
    growth = _Growth(fits, rounds or DIFFERENCES, failures, earlier.models)
    full = _size(first.added) >= search.most and not first.cut_short
    if full and not _is_whole(first) and (differing := growth.answer(first, completed=False)) is not None:
        return differing
    plain = search.completed(first)
    if plain.cut_short or _is_whole(plain):
        return plain
    return growth.answer(plain) or plain


class _Growth:
    """Traces with discrepancy, of vehicles that differ from their model in many ways.

    Process noise, parameters and effects would all describe the spectrum of coloured noise, so samples are taken as far
    apart as it is white. All stated parameters are free within their priors, and the model grows by whatever the drives
    show. What is likely of that stays.
    """

    def __init__(
        self, fits: CandidateFits, most: int, failures: Failures, earlier: Sequence[EarlierModel] = ()
    ) -> None:
        """Keep what growth needs.

        Args:
            fits: Of the search without discrepancy.
            most: Largest number of additions.
            failures: As in ``trace``.
            earlier: Models of an earlier trace, which compete with what grows.
        """
        self.fits, self.most, self.failures, self.earlier = fits, most, failures, earlier
        self.tried = False
        self.differing: Trace | None = None

    def answer(self, plain: Trace, completed: bool = True) -> Trace | None:
        """Return the grown trace of a vehicle that differs in many ways, else the plain one with what hinges on that.

        Args:
            plain: What a search without discrepancy found.
            completed: Whether that search is over; if not, there is no answer without growth.

        Returns:
            ``None`` where no discrepancy is worth it, or a search without it goes on.
        """
        return self.failures.attempt(
            "the discrepancy of the model", partial(self._answer, plain, completed), lambda _: None
        )

    def _answer(self, plain: Trace, completed: bool) -> Trace | None:
        less, disturbed = self._fits_with(()), self._fits_with(self._always)
        before = less.fit(plain.added, plain.final.point, afresh=False)
        whole = with_discrepancy(disturbed, plain.added, before)
        if whole is None:
            return None
        if not self.tried:  # of what the plain search found it takes over no more than the correlation time
            self.tried = True
            self.differing = self._grown(whole.point)
        nominal = less.fit((), plain.nominal.point, afresh=False)
        if self.differing is not None:
            needed = disturbed.judge(plain.added, whole.point).log_likelihood
            differing = replace(self.differing, nominal=nominal, before=less.judge((), nominal.point))
            worse = error_growth(differing.held_out, differing.before, differing.after).beyond_noise
            if differing.after.log_likelihood > needed and not worse:
                return replace(differing, hinging=self._hinging(differing))
        if not completed:
            return None
        return replace(plain, hinging=hinges(before, whole, disturbed.fitting.standard_errors(whole), plain.added))

    def _grown(self, start: ParameterPoint) -> Trace | None:
        """Return what grows from the nominal model; ``None`` where its stated values are of no vehicle."""
        parameters = all_parameters(self.fits.augmented)
        everything = self._fits_with((*self._always, parameters))
        search = _ForwardSelection(everything, self.most, self.failures, self.earlier)
        differing = search.grown(first_point(everything.fitting, start))
        return None if strayed(differing.final, parameters.amplitudes) else replace(differing, discrepancy=self._always)

    def _hinging(self, differing: Trace) -> tuple[str, ...]:
        """Return the sizes of a grown model that hinge on its random processes."""
        augmented, final = differing.fitting.augmented, differing.final
        fits = self._fits_with((all_parameters(augmented),))
        undisturbed = replace(final.point, values=_undisturbed(augmented, final.point))
        without = fits.fit(differing.added, undisturbed)
        return hinges(without, final, differing.fitting.standard_errors(final), differing.added)

    @property
    def _always(self) -> Added:
        """Random processes of vehicles, roads and recordings."""
        return random_processes(self.fits.augmented)

    def _fits_with(self, always: Added) -> CandidateFits:
        """Return fits of samples whose noise is white, with hypotheses that every model has."""
        fitting, held_out = self._drives
        return CandidateFits(fitting, held_out, self.fits.free, self.fits.say, self.fits.kept, always)

    @cached_property
    def _drives(self) -> tuple[Fitting, HeldOut]:
        """Fitted and held-out drives, samples as far apart as their noise is white."""
        augmented, fitting, held_out = self.fits.augmented, self.fits.fitting, self.fits.held_out
        spacing = spacing_of(augmented, [*fitting.drives, *held_out.drives], self.fits.say)
        train, test = ([thinned(d, spacing) for d in each] for each in (fitting.drives, held_out.drives))
        judged = HeldOut(augmented, test, held_out.variances)
        return Fitting(augmented, train, held_out.variances, fitting.noise_held, [*train, *test]), judged


def _undisturbed(augmented: AugmentedModel, point: ParameterPoint) -> Floats:
    """Return the parameters of a point without discrepancy ``(np, drives)``."""
    values = point.values.copy()
    values[[augmented.row(n) for h in random_processes(augmented) for n in h.amplitudes]] = 0.0
    return values


def _is_whole(found: Trace) -> bool:
    """Whether a final model leaves nothing that its drives show: white innovations, an error within its floor."""
    white = not any(w.p_value < WHITE for d in found.after.drives for w in d.whiteness)
    return white and leaves_nothing(found.after, found.before) and not beyond_belief(found.final, found.added)


def first_variances(augmented: AugmentedModel, drives: Sequence[DriveData], stated_noise: bool = False) -> Floats:
    """Return the white noise of every output ``(ny,)``; that of the model where a signal is too coarse to show it.

    With ``stated_noise`` it is that of the model where the signals have less.
    """
    stated = np.array([augmented.spec.measurement_noise[n] for n in augmented.model.outputs])
    variances = np.array([white_noise(drives, a) for a in range(len(stated))])
    variances = np.where(variances > 1e-12 * stated, variances, stated)
    return np.maximum(variances, stated) if stated_noise else variances


_TURNS = 2
"""How often what takes the place of additions to a grown model is questioned: of ten, each turn is some thirty fits."""


class _ForwardSelection:
    def __init__(
        self,
        candidate_fits: CandidateFits,
        rounds: int,
        failures: Failures = RAISED,
        earlier: Sequence[EarlierModel] = (),
    ) -> None:
        self.candidate_fits, self.most, self.failures = candidate_fits, rounds, failures
        self.earlier = earlier
        self.seen: set[frozenset[Hypothesis]] = set()
        self.rounds: list[Round] = []
        self.cut_short = ""

    def first(self) -> Trace:
        """Return what rounds from the nominal model add until nothing is accepted."""
        fits = self.candidate_fits
        fits.say("fitting the nominal model")
        self._begin(fits.fitting.first())
        return self._traced(*self._forward((), self.nominal), None)

    def _begin(self, start: ParameterPoint) -> None:
        """Fit the nominal model, and those of an earlier trace."""
        fits = self.candidate_fits
        self.nominal = fits.fit((), start, 25)
        self.earlier_fits = self.failures.attempt(
            "the models of the earlier trace", lambda: fit_earlier(fits, self.earlier, self.nominal), lambda _: []
        )

    def completed(self, first: Trace) -> Trace:
        """Return what was found by going on from the first rounds, and from the likeliest model of an earlier trace.

        Both see what the other has fitted. A search from the nominal model alone may end elsewhere with other noise.
        """
        fits = self.candidate_fits
        added, best, posterior = self._from(first.added, first.final)
        start = Comparison(fits, self.rounds).likeliest(self.earlier_fits) if self.earlier_fits else None
        if start is not None and frozenset(start[0]) not in self.seen:
            other, second, posterior = self._from(*self._forward(*start))
            ends = [end for end in ((added, best), (other, second)) if not fits.refuted.intersection(end[0])]
            added, best = Comparison(fits, self.rounds).likeliest(ends)
        return self._traced(added, best, posterior)

    def grown(self, start: ParameterPoint) -> Trace:
        """Return what was found of a vehicle that differs from its model in many ways: what is likely of a growth."""
        self._begin(start)
        added, best, self.rounds = grown(self.candidate_fits, (), self.nominal, "growth", self.most)
        return self._traced(*self._lasting(added, best, _TURNS))

    def _traced(self, added: Added, best: FittedHypothesis, posterior: Posterior | None) -> Trace:
        """Return the trace that ends in a model."""
        fits = self.candidate_fits
        in_force = {n for h in added for n in h.amplitudes}
        of_rounds = [h for r in self.rounds if r.added for h in r.added.hypothesis.single]
        return Trace(
            fits.fitting,
            fits.held_out,
            fits.free,
            self.nominal,
            best,
            added,
            tuple(self.rounds),
            tuple(h for h in of_rounds if not in_force.issuperset(h.amplitudes)),
            fits.judge((), self.nominal.point),
            fits.judge(added, best.point),
            self.cut_short,
            posterior,
        )

    def _from(self, added: Added, best: FittedHypothesis) -> tuple[Added, FittedHypothesis, Posterior | None]:
        """Return what of a model that rounds have led to stays or takes its place.

        Where something took the place of an addition, what it leaves is another rest, so rounds go on from there. So
        they do without a random process of the vehicle or its road that does not make the model whole.
        """
        fits = self.candidate_fits
        while True:
            self.seen.add(frozenset(added))
            kept, best, posterior = self._lasting(added, best)
            instead = set(kept) - set(added)
            added = kept
            if instead and frozenset(added) not in self.seen:
                self.seen.add(frozenset(added))  # what follows may lead back to it
                added, best = self._forward(added, best)
                continue
            processes = [h for h in added if h.random and not h.of_recording]
            for h in processes:
                added, best = self._if_whole(added, best, h)
            if not fits.refuted.intersection(processes):
                return added, best, posterior
            added, best = self._forward(added, best)

    def _lasting(
        self, added: Added, best: FittedHypothesis, turns: float = math.inf
    ) -> tuple[Added, FittedHypothesis, Posterior | None]:
        """Return what of the additions stays or takes their place, its fit, and how likely every model is."""
        return self.failures.attempt(
            "the probability of each model",
            partial(likeliest, self.candidate_fits, self.rounds, added, best, turns),
            partial(_as_added, added, best),
        )

    def _if_whole(self, added: Added, best: FittedHypothesis, process: Hypothesis) -> tuple[Added, FittedHypothesis]:
        """Return a model without one of its random processes, unless nothing else seems to be missing.

        It takes up whatever is slow. In the place of what is missing it leaves what that does quickly, so innovations
        stay coloured, or values are implausible.
        """
        fits, rest = self.candidate_fits, tuple(h for h in added if h != process)
        less = fits.fit(rest, fits.without(best.point, (process,), rest))
        before, after = (fits.judge(a, f.point).drives for a, f in ((rest, less), (added, best)))
        if colour_left(before, after) <= EXCESS and not beyond_belief(best, added):
            return added, best
        fits.refute(process)
        return rest, less

    def _forward(self, added: Added, best: FittedHypothesis) -> tuple[Added, FittedHypothesis]:
        """Return a model with what round after round adds, until nothing is accepted, and its fit."""
        fits = self.candidate_fits
        while True:
            number = len(self.rounds) + 1
            tried, passed = self.failures.attempt(
                f"round {number} of the search", partial(self._round, added, best, number), self._lost
            )
            if tried is not None:
                best = tried.best
                if not added:
                    self.nominal = min(tried.without, key=lambda f: fits.judge((), f.point).normalised_excess_mse)
            self.rounds += passed or [Round((), fits.judge(added, best.point), None, self.cut_short, "")]
            if self.rounds[-1].added is None:
                return added, best
            for r in passed:
                assert r.added is not None
                assert r.added.fitted is not None
                added, best = fits.joined(added, r.added.hypothesis), r.added.fitted

    def _round(self, added: Added, best: FittedHypothesis, number: int) -> tuple[SelectionRound | None, list[Round]]:
        """Try everything once; return what was tried and the round, or two."""
        tried = selection_round(self.candidate_fits, added, [best], number)
        return tried, self._passed(tried, number)

    def _lost(self, why: str) -> tuple[SelectionRound | None, list[Round]]:
        """Note why a round could not be computed; return that nothing was tried."""
        self.cut_short = f"it could not be computed: {why}"
        return None, []

    def _passed(self, tried: SelectionRound, number: int) -> list[Round]:
        """Return a round; if its best candidate is hopeful, with the next one if that adds something to it.

        Of two effects one may cause the simulation error and the other most of the innovations: then neither passes
        alone.
        """
        room = self.most - _size(tried.added)
        decided = tried.decided(room)
        if decided.added is not None and self._is_little(tried, decided.added):
            reason = "the gain in BIC is little against that of what changed already"
            return [replace(decided, added=None, hopeful=None, reason=reason)]
        if decided.hopeful is not None:
            assert decided.hopeful.fitted is not None
            with_it = self.candidate_fits.joined(tried.added, decided.hopeful.hypothesis)
            further = selection_round(self.candidate_fits, with_it, [decided.hopeful.fitted], number + 1).decided(
                room - 1
            )
            if further.added is not None:
                return [with_further(decided, further), further]
        return [decided if decided.added is not None else tried.decided_by_sensor(room)]

    def _is_little(self, tried: SelectionRound, further: Candidate) -> bool:
        """Whether a further change since a baseline explains little against what others explain."""
        fits = self.candidate_fits
        explained = fits.bic(tried.best.objective - self.nominal.objective, 0.0)
        return bool(tried.added and fits.augmented.held.names) and further.bic < FURTHER_CHANGE * explained


def _size(added: Added) -> int:
    """Return the number of additions; channels that are late are one, as they are added at once."""
    return sum(not h.clock for h in added) + any(h.clock for h in added)


def _as_added(added: Added, best: FittedHypothesis, _: str) -> tuple[Added, FittedHypothesis, Posterior | None]:
    """Return what rounds added as it is, where probabilities could not be computed."""
    return added, best, None
