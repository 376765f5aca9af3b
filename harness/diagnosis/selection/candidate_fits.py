"""Fit and judge a model with some additions: what the rounds of a trace and the checks at its end share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from harness.config.parameter_set import stated_std
from harness.diagnosis.criteria import BIC_NEEDED, HOPEFUL, MOST
from harness.diagnosis.fitting import TURNS, FittedHypothesis, Fitting, KeptFits, ParameterPoint
from harness.diagnosis.model.hypotheses import Hypothesis, coordinates, hypotheses
from harness.diagnosis.selection.score_test import Score, ScoreTest
from harness.diagnosis.selection.validation import HeldOut, Judgement
from harness.models.assembly.placement import split

Say = Callable[[str], None]
Added = tuple[Hypothesis, ...]

ITERATIONS = 8
"""Most steps of the parameters in a turn of a fit."""


def own_of(gone: Added, rest: Added) -> list[str]:
    """Return the parameters of additions that no other of a model has."""
    kept = {n for k in rest for n in (*k.shared, *k.change_times)}
    return [n for h in gone for n in (*h.shared, *h.change_times) if n not in kept]


class CandidateFits:
    """Models with additions, on the fitted and on the held-out drives.

    Args:
        fitting: The fitted drives.
        held_out: The held-out drives.
        free: Parameters of the nominal model that are fitted in any case.
        say: Receives what is being tried, in words.
        kept: Fits of an earlier, unfinished trace; none by default.
        always: Random processes that are a part of every model.

    Attributes:
        hypotheses: Everything to be tried.
        models: Every model that was fitted, by what it has, with its likeliest fit.
        stay: Models that are compared even where they are out of the question: users know them.
        refuted: What was added and left what it must not leave; it is tried no more.
        doubt: Log-likelihood that one may be behind another and still be in question: as much as is gained beyond
            doubt. Under stated noise every sample of a model that is not quite right counts as if it were independent
            evidence, and what is far behind may well predict the held-out drives better.
    """

    def __init__(
        self,
        fitting: Fitting,
        held_out: HeldOut,
        free: tuple[str, ...],
        say: Say,
        kept: KeptFits | None = None,
        always: Added = (),
    ) -> None:
        self.always = always
        self.kept = kept or KeptFits()
        self.fitting, self.held_out, self.free, self.say = fitting, held_out, free, say
        self.augmented = fitting.augmented
        self._known = stated_std(self.augmented.spec)
        self.hypotheses = hypotheses(self.augmented, free)
        self._effects = {h.name: h for h in self.hypotheses if h.kind == "effect"}
        self._log_samples = math.log(fitting.samples)
        self.doubt = math.inf if fitting.noise_held and not self.disturbed else 0.5 * HOPEFUL
        self.models: dict[frozenset[Hypothesis], tuple[Added, FittedHypothesis]] = {}
        self.stay: tuple[frozenset[Hypothesis], ...] = ()
        self.refuted: set[Hypothesis] = set()
        self._judged: dict[tuple[Added, int], tuple[Judgement, ParameterPoint]] = {}
        self._test: tuple[FittedHypothesis, ScoreTest] | None = None
        self._scores: dict[int, tuple[set[Hypothesis], list[Score], ParameterPoint]] = {}

    @property
    def disturbed(self) -> bool:
        """Whether models allow for their discrepancy."""
        return any(h.name in self.augmented.discrepancy for h in self.always)

    def fit(
        self,
        added: Added,
        start: ParameterPoint,
        iterations: int = ITERATIONS,
        turns: int = TURNS,
        afresh: bool = True,
        least: float = -math.inf,
    ) -> FittedHypothesis:
        """Fit the free parameters, additions and noise, as ``Fitting.fit`` does."""
        whole = (*added, *self.always)
        moved = coordinates(self.augmented, self.free, whole, len(self.fitting.drives), self._known)
        fitted = self.kept.fit(self.fitting, moved, start, (iterations, turns, afresh, least))
        best = self.models.get(frozenset(added))
        if best is None or fitted.objective > best[1].objective:
            self.models[frozenset(added)] = added, fitted
        return fitted

    def joined(self, added: Added, h: Hypothesis) -> Added:
        """Return additions with a further one; an effect at some places and at all others is one everywhere."""
        places = {k for k in added if k.kind == h.kind and k.name != h.name and split(k.name)[0] == h.name}
        return (*(k for k in added if k not in places), self._effects[h.name]) if places else (*added, *h.single)

    def with_addition(self, h: Hypothesis) -> ParameterPoint | None:
        """Return where the likeliest of the models with a hypothesis was fitted; ``None`` if there is none."""
        fits = [fitted for key, (_, fitted) in self.models.items() if key.issuperset(h.single)]
        return max(fits, key=lambda fitted: fitted.objective).point if fits else None

    def forget(self, added: Added) -> None:
        """Leave a model that was fitted out of what is compared: another one stands for it."""
        del self.models[frozenset(added)]

    def refute(self, h: Hypothesis) -> None:
        """Try something no more, and leave all models with it out of what is compared."""
        self.refuted.add(h)
        self.models = {key: model for key, model in self.models.items() if h not in key}

    def without(self, point: ParameterPoint, gone: Added, rest: Added) -> ParameterPoint:
        """Return a point with what belongs to some additions, and to no other, as stated."""
        values, rows = point.values.copy(), [self.augmented.row(n) for n in own_of(gone, rest)]
        values[rows] = self.augmented.stated()[rows, None]
        return replace(point, values=values)

    def fit_all(
        self,
        models: Sequence[tuple[Added, Callable[[], ParameterPoint]]],
        least: float = -math.inf,
        base: float = math.inf,
        afresh: bool = True,
        needed: float = -math.inf,
    ) -> list[FittedHypothesis]:
        """Fit models at once, and to the end only those that come near the best of them.

        The first, on all threads, sets what the others have to promise within their first turn: to come so near that
        they are in question, or most of its gain, because of a large effect slopes promise too little.

        After one turn of a fit a model that is far behind stays there: by what counts as a lead, and with less than
        most of the gain of the best one, because a large effect may take more than a turn. One that has ended there
        already is not fitted on, and one that does not promise to come near enough to be in question is given up.

        Args:
            models: What is added, and what gives the point where its fit starts; the most promising first.
            least: Objective that is reached already; none by default.
            base: Objective of the model to which these add; none if they add to no common one.
            afresh: Whether their noise is sought from far away: it is that of a model that lacks what they add. What
                begins at the noise of a model with more in it begins low enough.
            needed: Objective without which they are of no use: what does not promise it is given up.
        """

        def first_turn(useful: float, model: tuple[Added, Callable[[], ParameterPoint]]) -> FittedHypothesis:
            return self.fit(model[0], model[1](), turns=1, afresh=afresh, least=useful)

        def further(added: Added, fitted: FittedHypothesis) -> FittedHypothesis:
            near = best - fitted.objective < far and not fitted.ended
            return self.fit(added, fitted.point, afresh=False, least=max(needed, best - self.doubt)) if near else fitted

        share = self.augmented.share
        fitted = [first_turn(needed, model) for model in models[:1]]
        useful = max([needed, *(f.objective - max(self.doubt, MOST * (f.objective - base)) for f in fitted)])
        fitted += share(partial(first_turn, useful), models[1:])
        best = max([least, *(f.objective for f in fitted)])
        far = max(BIC_NEEDED, MOST * (best - base))
        return share(lambda tried: further(tried[0][0], tried[1]), list(zip(models, fitted, strict=True)))

    def fit_near(self, added: Added, start: ParameterPoint, objective: float, needed: float) -> FittedHypothesis:
        """Fit on from a point, to the end only what comes near an objective; give up what does not promise another."""
        return self.fit_all([(added, lambda: start)], objective, afresh=False, needed=needed)[0]

    def judge(self, added: Added, point: ParameterPoint) -> Judgement:
        """Judge a model on the held-out drives; the same one once."""
        key = added, id(point)
        if key not in self._judged:  # with the point, whose id is its own as long as it is kept
            self._judged[key] = self.held_out.judge(added, point), point
        return self._judged[key][0]

    def scores_at(
        self, point: ParameterPoint, tried: Sequence[Hypothesis], score: Callable[[Sequence[Hypothesis]], list[Score]]
    ) -> list[Score]:
        """Return the scores of hypotheses at a fit that ended at a point; what was scored there is not scored again."""
        scored, scores, _ = self._scores.get(id(point), (set[Hypothesis](), [], point))
        if not scored.issuperset(tried):
            scored, scores = set(tried), score(tried)
            self._scores[id(point)] = scored, scores, point  # which is kept, so that its id stays its own
        return [s for s in scores if s.hypothesis in tried]

    def score_test(self, fitted: FittedHypothesis) -> ScoreTest:
        """Return the score test at a fit; the last one is kept."""
        if self._test is None or self._test[0] is not fitted:
            self._test = fitted, ScoreTest(self.fitting, fitted)
        return self._test[1]

    def bic(self, gain: float, freedom: float) -> float:
        """Return a gain in log-likelihood as gain in BIC."""
        return 2.0 * gain - freedom * self._log_samples

    def on_grids(self, point: ParameterPoint, names: Sequence[str]) -> list[ParameterPoint]:
        """Return a point, and others with one parameter each at a value of its grid."""
        points = [point]
        for name in names:
            for value in self.augmented.model.parameters[self.augmented.row(name)].grid:
                values = point.values.copy()
                values[self.augmented.row(name)] = value
                points.append(replace(point, values=values))
        return points

    def start(self, point: ParameterPoint, s: Score) -> ParameterPoint:
        """Return the best start for a joint fit: what the score predicts or less, or a value of the amplitudes' grids.

        Of a large effect, or in another model than the one it was predicted for, the best may be none of it yet.
        """
        h, row = s.hypothesis, self.augmented.row
        values = point.values.copy()
        for name, value in zip(h.shared, [*s.amplitudes, *s.shapes], strict=True):
            values[row(name)] = value
        for j, name in enumerate(h.change_times):
            values[row(name)] = s.change_times[:, j]
        starts = [replace(point, values=values)]
        rows = [row(n) for n in h.amplitudes]
        graded = any(self.augmented.model.parameters[r].grid for r in rows)  # there no slope leads away from none of it
        for share in (0.5, 0.25) if graded else (0.5, 0.25, 0.0):
            less = values.copy()
            less[rows] = point.values[rows] + share * (values[rows] - point.values[rows])
            starts.append(replace(point, values=less))
        return self.fitting.best([*starts[1:], *self.on_grids(starts[0], h.amplitudes)])
