"""One round of a trace: the score test ranks all hypotheses, and the promising ones are fitted and judged.

A nominal fit that ended too early looks like an effect, so it is repeated from the parameters of the best hypothesis
before that one is judged. Random processes have no response to be tested: the likelihood at a few intensities ranks
them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.criteria import BIC_NEEDED, EXCESS, MOST, TRIED
from harness.diagnosis.fitting import FittedHypothesis, ParameterPoint
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, still_open
from harness.diagnosis.selection.acceptance import (
    Candidate,
    Round,
    decide,
    distinct,
    hardest,
    implausible,
    likelier_held_out,
    lookalikes,
    objections,
    same,
    with_sensor,
)
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.diagnosis.selection.posterior import log_odds
from harness.diagnosis.selection.score_test import Score, ScoreTest
from harness.diagnosis.selection.validation import Judgement, leaves_nothing
from harness.diagnosis.selection.wald import Curvature
from harness.models.quantities import listed

_Values = tuple[float, ...]
"""Of what all drives share of a process."""


def random_scores(fits: CandidateFits, point: ParameterPoint, tried: Sequence[Hypothesis]) -> list[Score]:
    """Return what random processes gain in likelihood at the best values of their grids, in place of a score test.

    Each process is the likeliest by itself, also where there are several at once.
    """
    if not tried:
        return []
    single = list(dict.fromkeys(process for h in tried for process in h.single))
    grids = [[_at(fits, point, process), *_grid(fits, process)] for process in single]
    alone = [
        _with(fits, point, {process: values}) for process, grid in zip(single, grids, strict=True) for values in grid
    ]
    likelihoods = np.split(_log_likelihoods(fits, alone), np.cumsum([len(grid) for grid in grids[:-1]]))
    best = {process: grid[int(np.argmax(own))] for process, grid, own in zip(single, grids, likelihoods, strict=True)}
    points = [_with(fits, point, {process: best[process] for process in h.single}) for h in tried]
    gains = _log_likelihoods(fits, [point, *points])
    return [_score(fits, h, p, float(gain)) for h, p, gain in zip(tried, points, gains[1:] - gains[0], strict=True)]


def _score(fits: CandidateFits, h: Hypothesis, point: ParameterPoint, gain: float) -> Score:
    """Return what a process gains at a point; no drive shows a response, and none is needed."""
    drives = fits.fitting.drives
    at = dict(zip(h.shared, _at(fits, point, h), strict=True))
    amplitudes, shapes = (np.array([at[n] for n in names]) for names in (h.amplitudes, h.shapes))
    nothing = (np.zeros(1, dtype=np.float32),)
    unknown, never = np.full(len(amplitudes), np.inf), np.zeros((len(drives), 0))
    return Score(h, gain, amplitudes, unknown, float(len(amplitudes)), shapes, never, nothing, True)


def _grid(fits: CandidateFits, h: Hypothesis) -> list[_Values]:
    """Return the values at which a process is tried."""
    parameters = [fits.augmented.model.parameters[fits.augmented.row(n)] for n in h.shared]
    return list(itertools.product(*(p.grid for p in parameters)))


def _at(fits: CandidateFits, point: ParameterPoint, h: Hypothesis) -> _Values:
    """Return the values of a process at a point."""
    return tuple(float(point.values[fits.augmented.row(n), 0]) for n in h.shared)


def _with(fits: CandidateFits, point: ParameterPoint, processes: Mapping[Hypothesis, _Values]) -> ParameterPoint:
    """Return a point with other values of some processes."""
    values = point.values.copy()
    for h, own in processes.items():
        values[[fits.augmented.row(n) for n in h.shared]] = np.array(own)[:, None]
    return replace(point, values=values)


def _log_likelihoods(fits: CandidateFits, points: Sequence[ParameterPoint]) -> Floats:
    return fits.augmented.log_likelihoods(fits.fitting.drives, fits.fitting.candidates(points))


def _itself(point: ParameterPoint) -> ParameterPoint:
    return point


def selection_round(
    candidate_fits: CandidateFits, added: Added, without: list[FittedHypothesis], number: int
) -> SelectionRound:
    """Try everything once.

    Args:
        candidate_fits: Fits and judges.
        added: What the model has already.
        without: Fits of that model, the likeliest last.
        number: Of the round.
    """
    tried = SelectionRound(candidate_fits, added, without, f"round {number}")
    again = tried.run()
    return tried if again is None else selection_round(candidate_fits, added, [*without, again], number)


class SelectionRound:
    """A round from one fit of the model without addition.

    Args:
        candidate_fits: Fits and judges.
        added: What the model has already.
        without: Fits of that model, the likeliest last.
        name: Of the round.
        test: Of that model, if it is not done at the likeliest of its fits.
    """

    def __init__(
        self,
        candidate_fits: CandidateFits,
        added: Added,
        without: list[FittedHypothesis],
        name: str,
        test: ScoreTest | None = None,
    ) -> None:
        self.candidate_fits, self.added, self.without, self.name = candidate_fits, added, without, name
        self._test = test
        self.promised: list[Score] = []
        self.shortlist: list[Score] = []
        self.fits: dict[Hypothesis, FittedHypothesis] = {}

    @property
    def best(self) -> FittedHypothesis:
        """The likeliest fit of the model without addition."""
        return self.without[-1]

    @property
    def before(self) -> Judgement:
        """The model without addition on the held-out drives."""
        return hardest([self.candidate_fits.judge(self.added, f.point) for f in self.without])

    def run(self) -> FittedHypothesis | None:
        """Fit what is worth it; return a fit without addition from which the round has to start again, if any."""
        self.rank()
        self.fit_worthy()
        self.fit_behind_refused()
        self.fit_like_the_best()
        if not self.fits:
            return None
        self.fit_large()
        again = self.again()
        gain = max(f.objective for f in self.fits.values()) - self.best.objective
        if again.objective - self.best.objective > max(BIC_NEEDED, MOST * gain):
            return again
        if again is not self.best:
            self.without = [*self.without, again]
        return None

    def decided(self, room: int) -> Round:
        """Return the round with what is added, if so much may be added yet."""
        candidates = [self.judged(s) if s.hypothesis in self.fits else self.unfitted(s) for s in self.promised]
        candidates.sort(key=lambda c: (c.fitted is not None, c.bic), reverse=True)
        return decide(tuple(candidates), self.before, room)

    def say(self, what: str) -> None:
        """Tell what is being done in this round."""
        self.candidate_fits.say(f"{self.name}: {what}")

    def rank(self) -> None:
        """Score everything that is not in force yet, and choose what is worth a fit."""
        self.say("score test of every effect and every fixed parameter")
        fits = self.candidate_fits
        scores = self.scores(self.open()) if self._test else fits.scores_at(self.best.point, self.open(), self.scores)

        def promise(s: Score) -> float:
            return self.predicted_bic_gain(s) + 2.0 * self.log_odds(s)

        self.promised = sorted(scores, key=promise, reverse=True)
        # The predicted gain of many things at once is large whatever is missing, and so is that of a process, which
        # follows anything slow; it must not exclude others.
        plain, random = ([s for s in self.promised if s.hypothesis.random == kind] for kind in (False, True))
        alone = [self.predicted_bic_gain(s) for s in plain if not s.hypothesis.many]
        enough = MOST * max([BIC_NEEDED, *alone])
        self.shortlist = [s for s in (*distinct(plain), *random) if self.predicted_bic_gain(s) > enough]
        several = [s for s in self.shortlist if s.hypothesis.random and s.hypothesis.parts]
        self.shortlist = [s for s in self.shortlist if s not in several or self.leads_its_parts(s)]

    def scores(self, tried: Sequence[Hypothesis]) -> list[Score]:
        """Return the scores of hypotheses at the fit without addition; under stated noise nothing is random."""
        fits = self.candidate_fits
        test = self._test or fits.score_test(self.best)
        scores = test.of([h for h in tried if not h.random])
        processes = [] if fits.fitting.noise_held else [h for h in tried if h.random]
        point = self.best.point
        return scores + fits.scores_at(point, processes, partial(random_scores, fits, point))

    @cached_property
    def _odds(self) -> dict[tuple[str, str], float]:
        return log_odds(self.candidate_fits.hypotheses)

    def log_odds(self, s: Score) -> float:
        """Return the logarithm of the odds of a hypothesis before the drives are seen."""
        return sum(self._odds[h.kind, h.name] for h in s.hypothesis.single)

    def belief(self, s: Score) -> tuple[float, float]:
        """Return what orders hypotheses that the drives do not tell apart: log odds, then with how few values."""
        return self.log_odds(s), -s.freedom

    def open(self) -> list[Hypothesis]:
        """Return what is not in force yet, and not refuted."""
        fits = self.candidate_fits
        taken = {n for h in (*self.added, *fits.refuted, *fits.always) for n in h.amplitudes} | set(fits.free)
        hypotheses_left = (still_open(h, taken) for h in fits.hypotheses)
        return [h for h in hypotheses_left if h is not None]

    def leads_its_parts(self, several: Score) -> bool:
        """Whether random processes at once promise more than each of them alone."""
        parts = [self.predicted_bic_gain(s) for s in self.promised if s.hypothesis in several.hypothesis.parts]
        return self.predicted_bic_gain(several) - max(parts) > BIC_NEEDED

    def fit_worthy(self) -> None:
        """Fit the shortlist, and many parameters at once where they may reach more.

        Large effects act nonlinearly: what a score predicts may be half of what a hypothesis reaches, or twice.
        Processes act on sensors of their own, so what leads as several at once is fitted as that alone, unless it
        is refused.
        """
        worthy = [s for s in self.shortlist if s.hypothesis.name != ALL_PARAMETERS]
        several = [s for s in worthy if s.hypothesis.random and s.hypothesis.parts]
        parts = {p for s in several for p in s.hypothesis.parts}
        self.fit([s for s in worthy if s.hypothesis not in parts])
        if any(objections(self.judged(s), self.before) for s in several):
            self.fit([s for s in worthy if s.hypothesis in parts])
        gains = [(self.judged(s).bic, self.predicted_bic_gain(s)) for s in self.tried()]
        reached, predicted = max(gains, default=(0.0, 1.0))
        short = max(1.0, reached / predicted)
        many = [s for s in self.shortlist if s.hypothesis.name == ALL_PARAMETERS]
        if not self.settled():
            self.fit([s for s in many if short * self.predicted_bic_gain(s) >= reached])

    def fit_behind_refused(self) -> None:
        """Fit also what promises less of a change, where the held-out drives speak against all that promises most.

        A bias of the day leads on the day that is fitted. What it leads by is no bar for a change that stays.
        """
        before = self.before
        if any(likelier_held_out(self.judged(s), before) for s in self.tried()):
            return
        plain = [s for s in self.promised if not (s.hypothesis.random or s.hypothesis.many) and s.hypothesis.changed]
        rest = [s for s in distinct(plain) if s.hypothesis not in self.fits]
        self.fit([s for s in rest if self.predicted_bic_gain(s) > MOST * BIC_NEEDED][:TRIED])

    def settled(self) -> bool:
        """Whether a single hypothesis is accepted and explains everything; then many parameters need no fit."""
        before = self.before
        passing = [c for c in map(self.judged, self.tried()) if not objections(c, before)]
        return any(c.held_out is not None and leaves_nothing(c.held_out, before) for c in passing)

    def fit_like_the_best(self) -> None:
        """Fit also what is hardly distinguishable from the best of the fits, where it may explain more.

        Of those that say the same the one stands for all that is likelier beforehand, unless something else would then
        come before it.
        """
        tried = [self.judged(s) for s in self.tried()]
        if not tried:
            return
        winner = max(tried, key=lambda c: c.bic)
        assert winner.fitted is not None
        start = self.taken_back(winner.hypothesis, winner.fitted)
        likes = lookalikes(winner, self.before, self.promised, self.fits)[:TRIED] or self.likelier_names(winner)
        self.fit(likes, start)
        others = [c.bic for c in map(self.judged, self.tried()) if not same(c.score, winner.score)]

        def stands(s: Score) -> tuple[bool, float, float]:
            return self.judged(s).bic > max(others, default=-math.inf), *self.belief(s)

        for_all = winner.score
        for s in likes:
            between = 2.0 * abs(self.fits[s.hypothesis].objective - self.fits[for_all.hypothesis].objective)
            if same(s, winner.score) and between < BIC_NEEDED:  # what is left between them is where fits end
                less, for_all = sorted((s, for_all), key=stands)
                del self.fits[less.hypothesis]
                self.candidate_fits.forget(self.candidate_fits.joined(self.added, less.hypothesis))

    def fit_large(self) -> None:
        """Fit what is large by nature from the values that it has then, if what leads is implausible.

        About none of it a score promises little of an axle that is up, and a fit that starts there may end in another
        maximum. The vehicle's own values begin as they are, and as stated: without it they stand for it.
        """
        fits = self.candidate_fits
        leads, winner = max(self.fits.items(), key=lambda item: item[1].objective)
        if not implausible(fits.augmented.model.parameters, winner, leads):
            return
        starts = [start for s in self.promised if not s.hypothesis.many for start in self.large(s)]
        likely = _log_likelihoods(fits, [point for _, point in starts]) if starts else np.zeros(0)
        nearest: dict[Hypothesis, tuple[Score, ParameterPoint]] = {}
        for i in np.argsort(-np.where(np.isnan(likely), -np.inf, likely)):
            nearest.setdefault(starts[i][0].hypothesis, starts[i])
        chosen = [*nearest.values()][:TRIED]
        if not chosen:
            return
        self.say(f"fitting {listed([s.hypothesis.name.replace('_', ' ') for s, _ in chosen])} as large as by nature")
        models = [(fits.joined(self.added, s.hypothesis), partial(_itself, point)) for s, point in chosen]
        for (s, _), fitted in zip(chosen, fits.fit_all(models, winner.objective, self.best.objective), strict=True):
            before = self.fits.get(s.hypothesis)
            self.fits[s.hypothesis] = fitted if before is None or fitted.objective > before.objective else before

    def large(self, s: Score) -> list[tuple[Score, ParameterPoint]]:
        """Return a hypothesis with where its fit may start if it is as large as it is by nature; nothing of others."""
        h, augmented = s.hypothesis, self.candidate_fits.augmented
        rows, free = ([augmented.row(n) for n in names] for names in (h.amplitudes, self.candidate_fits.free))
        naturals = itertools.product(*(augmented.model.parameters[row].natural for row in rows))
        as_stated = self.best.point.values.copy()
        as_stated[free] = augmented.stated()[free, None]
        starts = []
        for natural, base in itertools.product(naturals, (self.best.point.values, as_stated)):
            values = base.copy()
            values[rows] = np.array(natural)[:, None]
            for name, value in zip(h.shapes, s.shapes, strict=True):
                values[augmented.row(name)] = value
            for j, name in enumerate(h.change_times):
                values[augmented.row(name)] = s.change_times[:, j]
            starts.append((s, replace(self.best.point, values=values)))
        return starts

    def likelier_names(self, winner: Candidate) -> list[Score]:
        """Return what says the same as a hypothesis that explains everything, and is likelier beforehand, if any is."""
        passes = not objections(winner, self.before)
        apart = [s for s in self.promised if s.excited and not s.hypothesis.many and s.hypothesis not in self.fits]
        likelier = [s for s in apart if same(s, winner.score) and self.belief(s) > self.belief(winner.score)]
        return sorted(likelier, key=self.belief)[-1:] if passes else []

    def decided_by_sensor(self, room: int) -> Round:
        """Return a round without accepted hypothesis with the best sensor fault added, if it clears its own signal.

        A large unexplained error of other signals masks from the criteria what acts on one signal alone.
        """
        likeliest = []
        for column, normalised_excess_mse in enumerate(self.before.normalised_excess_mses if room > 0 else ()):
            own = [
                s
                for s in self.promised
                if s.hypothesis.output == column and not s.hypothesis.random and self.predicted_bic_gain(s) > BIC_NEEDED
            ]
            if normalised_excess_mse > EXCESS and own and own[0].hypothesis not in self.fits:
                likeliest.append(own[0])
        self.fit(likeliest)
        decided = self.decided(room)
        return with_sensor(decided) if room > 0 and decided.added is None else decided

    def tried(self) -> list[Score]:
        """Return what was fitted and is not many parameters at once, the largest predicted gain first."""
        return [s for s in self.promised if s.hypothesis in self.fits and s.hypothesis.name != ALL_PARAMETERS]

    def fit(self, scores: Sequence[Score], near: ParameterPoint | None = None) -> None:
        """Fit and judge hypotheses, all at once, from the amplitudes that their scores predict.

        Args:
            scores: Of the hypotheses.
            near: Another point without them, from which they may start as well.
        """
        if not scores:
            return
        self.say(f"fitting {listed([s.hypothesis.name.replace('_', ' ') for s in scores])}")

        fits = self.candidate_fits

        def start(s: Score) -> ParameterPoint:
            starts = [fits.start(point, s) for point in (self.best.point, near) if point is not None]
            return fits.fitting.best(starts)

        reached = max((f.objective for f in self.fits.values()), default=-math.inf)
        models = [(fits.joined(self.added, s.hypothesis), partial(start, s)) for s in scores]
        fitted = fits.fit_all(models, reached, self.best.objective)
        self.fits |= {s.hypothesis: f for s, f in zip(scores, fitted, strict=True)}
        fits.augmented.share(self.judged, scores)

    def judged(self, s: Score) -> Candidate:
        """Return a hypothesis that was fitted, with its judgement on the held-out drives."""
        fitted = self.fits[s.hypothesis]
        fits = self.candidate_fits
        judged = fits.judge(fits.joined(self.added, s.hypothesis), fitted.point)
        return Candidate(s, fitted, fits.bic(fitted.objective - self.best.objective, s.freedom), judged)

    def unfitted(self, s: Score) -> Candidate:
        """Return a hypothesis whose predicted gain is too small for a fit."""
        return Candidate(s, None, self.predicted_bic_gain(s), None)

    def predicted_bic_gain(self, s: Score) -> float:
        """Return the gain in BIC that a score predicts."""
        return self.candidate_fits.bic(s.gain, s.freedom)

    def taken_back(self, h: Hypothesis, fitted: FittedHypothesis) -> ParameterPoint:
        """Return where a hypothesis left the model's parameters and noise, without itself."""
        values, augmented = fitted.point.values.copy(), self.candidate_fits.augmented
        rows = [augmented.row(n) for n in (*h.shared, *h.change_times)]
        values[rows] = self.best.point.values[rows]
        return replace(fitted.point, values=values)

    def again(self) -> FittedHypothesis:
        """Refit the model without addition from where the best hypothesis left its parameters and noise.

        A model that cannot be driven takes the place of none that can.
        """
        h, winner = max(self.fits.items(), key=lambda item: item[1].objective)
        self.say("fitting the model without it again")
        fits, best, fitting = self.candidate_fits, self.best.objective, self.candidate_fits.fitting
        points = Curvature(fits, winner).without(h.single, self.added).points
        # The noise is that of a model without it already.
        start = fitting.best([replace(self.best.point, values=p.values) for p in points])
        again = fits.fit_near(self.added, start, winner.objective, best)
        lost = fitting.admits(self.best.point) and not fitting.admits(again.point)
        return again if again.objective > best and not lost else self.best
