"""Find what a model lacks: forward selection over everything it may lack, checked backwards at the end.

In each round the score test ranks all hypotheses, the best few are fitted jointly with the nominal parameters, and the
best of these is added if it passes three judges: the Bayes information criterion on the fitted drives, the likelihood
and the free-running error of drives that were never fitted. A nominal fit that ended too early looks like an effect, so
it is repeated from the parameters of the best hypothesis before that one is judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.identify.methods.likelihood import white_noise
from harness.identify.recordings import Drive
from harness.loop.fit import TURNS, Fitted, Fitting, Point
from harness.loop.held_out import HeldOut, Judgement
from harness.loop.hypotheses import ALL_PARAMETERS, Hypothesis, coordinates, hypotheses
from harness.loop.judges import (
    BIC_NEEDED,
    Candidate,
    Round,
    decide,
    distinct,
    hardest,
    is_hopeful,
    lookalikes,
    objections,
    with_further,
)
from harness.loop.score import Score, ScoreTest
from harness.loop.whole import Whole

Floats = NDArray[np.float64]
Say = Callable[[str], None]

ROUNDS = 5
"""Largest number of additions."""

_FAVOUR = 2.0
"""Lead in BIC that a parameter of the model gets over an effect, which may be the same thing in other words."""

_OWN = 0.5
"""Share of the best hypothesis's gain from which, reached by the refitted model without it, a round starts again from
there: its ranking was that of a poor fit."""

_CLOSE = 500.0
"""Lead in log-likelihood from which on the model without the best hypothesis need not be fitted to the end."""

_REFITTED = 3
_HOPE = 1.5
"""A fit may gain this much more than the score promises, and more still where the best one so far did; what cannot
reach that one is not fitted."""

_NEAR = 0.5
"""Hypotheses are fitted that promise at least this share of what the best one does."""

_ITERATIONS = 8


@dataclass(frozen=True)
class Trace:
    """What was found.

    Attributes:
        fitting: The fitted drives.
        held_out: The held-out drives.
        free: Parameters of the nominal model that were fitted.
        nominal: The nominal model fitted; of its fits the one that strays least on the held-out drives.
        final: The model with everything added.
        added: In the order added, without what the checks at the end took away, and with what they put in its place.
        rounds: Of the selection.
        dropped: What the checks at the end took away.
        before: The nominal model on the held-out drives.
        after: The final one there.
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

    @property
    def effects(self) -> tuple[Hypothesis, ...]:
        """Effects among what was added."""
        return tuple(h for h in self.added if h.kind == "effect")


def trace(
    whole: Whole,
    train: Sequence[Drive],
    test: Sequence[Drive],
    free: Sequence[str],
    say: Say = lambda _: None,
    rounds: int = ROUNDS,
    stated_noise: bool = False,
) -> Trace:
    """Find what the model lacks.

    Args:
        whole: The nominal model with everything it may lack.
        train: Drives to fit.
        test: Drives to judge on.
        free: Parameters of the nominal model that are fitted in any case.
        say: Is told what is being tried.
        rounds: Largest number of additions.
        stated_noise: Whether the noise is the stated one, that of the sensors at least, and not refitted. A model of
            a real vehicle is never quite right, and process noise that is fitted to that takes up what is missing.
    """
    variances = first_variances(whole, [*train, *test], stated_noise)
    fitting = Fitting(whole, train, variances, stated_noise)
    search = _Search(fitting, HeldOut(whole, test, variances), tuple(free), say, rounds)
    return search.run()


def first_variances(whole: Whole, drives: Sequence[Drive], stated_noise: bool = False) -> Floats:
    """Return the white noise of every output ``(ny,)``; that of the model where a signal is too coarse to show it.

    With ``stated_noise`` it is that of the model where the signals have less.
    """
    stated = np.array([whole.spec.measurement_noise[n] for n in whole.model.outputs])
    found = np.array([white_noise(drives, a) for a in range(len(stated))])
    found = np.where(found > 1e-12 * stated, found, stated)
    return np.maximum(found, stated) if stated_noise else found


class _Search:
    def __init__(self, fitting: Fitting, held_out: HeldOut, free: tuple[str, ...], say: Say, rounds: int) -> None:
        self.fitting, self.held_out, self.free, self.say, self.rounds = fitting, held_out, free, say, rounds
        self.whole = fitting.whole
        self.log_samples = math.log(fitting.samples)

    def run(self) -> Trace:
        """Return what was found: round after round until nothing passes, then the checks of all additions."""
        self.say("fitting the nominal model")
        nominal = best = self._fit((), self.fitting.first(), 25)
        added: tuple[Hypothesis, ...] = ()
        rounds: list[Round] = []
        while len(rounds) <= self.rounds:
            without, found = self._round(added, [best], len(rounds) + 1)
            best = without[-1]
            if not added:
                nominal = min(without, key=lambda f: self._judge((), f.point).excess)
            passed = self._further(added, found, len(rounds) + 1)
            rounds += passed
            if passed[-1].added is None:
                break
            for r in passed:
                assert r.added is not None
                assert r.added.fitted is not None
                added, best = (*added, r.added.hypothesis), r.added.fitted
        kept, best = self._backward(added, best)
        kept, best = self._parameters_instead(kept, best, rounds)
        return Trace(
            self.fitting,
            self.held_out,
            self.free,
            nominal,
            best,
            kept,
            tuple(rounds),
            tuple(h for h in added if h not in kept),
            self._judge((), nominal.point),
            self._judge(kept, best.point),
        )

    def _further(self, added: tuple[Hypothesis, ...], found: Round, number: int) -> list[Round]:
        """Return a round; if what it found is hopeful, with the next one if that adds something to it.

        Of two effects one may make the error and the other most of the innovations: then neither passes alone.
        """
        if found.hopeful is None:
            return [found]
        assert found.hopeful.fitted is not None
        _, further = self._round((*added, found.hopeful.hypothesis), [found.hopeful.fitted], number + 1)
        return [found] if further.added is None else [with_further(found, further), further]

    def _fit(
        self, added: tuple[Hypothesis, ...], start: Point, iterations: int = _ITERATIONS, turns: int = TURNS
    ) -> Fitted:
        moved = coordinates(self.whole, self.free, added, len(self.fitting.drives))
        return self.fitting.fit(moved, start, iterations, turns)

    def _judge(self, added: tuple[Hypothesis, ...], point: Point) -> Judgement:
        return self.held_out.judge(added, point)

    def _round(self, added: tuple[Hypothesis, ...], without: list[Fitted], number: int) -> tuple[list[Fitted], Round]:
        """Try everything once; return fits of the model without addition, the likeliest last, and what was found."""
        best = without[-1]
        self.say(f"round {number}: score test of every effect and every fixed parameter")
        test = ScoreTest(self.fitting, best)
        scores = test.of(self._open(added))
        promised = sorted(
            scores, key=lambda s: self._promise(s) + _FAVOUR * (s.hypothesis.kind == "parameter"), reverse=True
        )
        # Many parameters at once promise much whatever is missing, so they keep nothing else from being fitted.
        alone = [self._promise(s) for s in promised if s.hypothesis.name != ALL_PARAMETERS]
        enough = max(0.5 * BIC_NEEDED, _NEAR * max(alone, default=0.0))
        worth = [s for s in distinct(promised) if self._promise(s) > enough]
        chosen = [s for s in worth if s.hypothesis.name != ALL_PARAMETERS][:_REFITTED]
        # Many at once are the longest fit and often spared by what the others reach.
        chosen += [s for s in worth if s.hypothesis.name == ALL_PARAMETERS]
        fits: dict[Hypothesis, Fitted] = {}
        reached, short = 0.0, 1.0
        for s in chosen:
            if _HOPE * short * self._promise(s) < reached:
                continue
            fits[s.hypothesis] = fitted = self._tried(added, best, s, number)
            gain = self._bic(s, fitted.objective - best.objective)
            if s.hypothesis.name != ALL_PARAMETERS and gain > reached:
                reached, short = gain, max(1.0, gain / self._promise(s))
        fits |= self._like_the_best(added, without, promised, fits, number)
        fits |= self._spared(added, without, worth, fits, number)
        if fits:
            again = self._again(added, best, fits)
            gain = max(f.objective for f in fits.values()) - best.objective
            if again.objective - best.objective > max(BIC_NEEDED, _OWN * gain):
                return self._round(added, [*without, again], number)
            if again is not best:
                without, best = [*without, again], again
        before = hardest([self._judge(added, f.point) for f in without])
        candidates = [self._candidate(added, s, fits.get(s.hypothesis), best) for s in promised]
        candidates.sort(key=lambda c: (c.fitted is not None, c.bic), reverse=True)
        return without, decide(tuple(candidates), before, number > self.rounds)

    def _tried(self, added: tuple[Hypothesis, ...], best: Fitted, s: Score, number: int) -> Fitted:
        self.say(f"round {number}: fitting {s.hypothesis.name.replace('_', ' ')}")
        return self._fit((*added, s.hypothesis), self._start(best.point, s))

    def _spared(
        self,
        added: tuple[Hypothesis, ...],
        without: list[Fitted],
        worth: Sequence[Score],
        fits: dict[Hypothesis, Fitted],
        number: int,
    ) -> dict[Hypothesis, Fitted]:
        """Fit what was spared for promising too little, where nothing passes or is hopeful, until something passes.

        Large effects bend, so that the right one may promise a part of what it reaches, and a wrong one that fits the
        fitted drives alone may reach more than that. Many parameters at once count for nothing here.
        """
        best, before = without[-1], hardest([self._judge(added, f.point) for f in without])

        alone = [s for s in worth if s.hypothesis.name != ALL_PARAMETERS]
        tried = [self._judged(added, s, fits[s.hypothesis], best) for s in alone if s.hypothesis in fits]
        if any(not objections(c, before) or is_hopeful(c, before) for c in tried):
            return {}
        found: dict[Hypothesis, Fitted] = {}
        for s in [s for s in alone if s.hypothesis not in fits][:_REFITTED]:
            found[s.hypothesis] = fitted = self._tried(added, best, s, number)
            if not objections(self._judged(added, s, fitted, best), before):
                break
        return found

    def _like_the_best(
        self,
        added: tuple[Hypothesis, ...],
        without: list[Fitted],
        promised: Sequence[Score],
        fits: dict[Hypothesis, Fitted],
        number: int,
    ) -> dict[Hypothesis, Fitted]:
        """Fit also what acts like the best of the fits, where another may be meant."""
        best = without[-1]
        tried = [self._candidate(added, s, fits[s.hypothesis], best) for s in promised if s.hypothesis in fits]
        alone = [c for c in tried if c.hypothesis.name != ALL_PARAMETERS]
        if not alone:
            return {}
        winner = max(alone, key=lambda c: c.bic)
        others = lookalikes(winner, hardest([self._judge(added, f.point) for f in without]), promised, fits)
        assert winner.fitted is not None
        start = self._taken_back(winner.hypothesis, winner.fitted, best)
        found = {}
        for s in others[:_REFITTED]:
            self.say(f"round {number}: fitting {s.hypothesis.name.replace('_', ' ')}, which acts alike")
            starts = [self._start(best.point, s), self._start(start, s)]
            found[s.hypothesis] = self._fit((*added, s.hypothesis), self.fitting.best(starts))
        return found

    def _candidate(self, added: tuple[Hypothesis, ...], s: Score, fitted: Fitted | None, best: Fitted) -> Candidate:
        if fitted is None:
            return Candidate(s, None, self._promise(s), None)
        return self._judged(added, s, fitted, best)

    def _judged(self, added: tuple[Hypothesis, ...], s: Score, fitted: Fitted, best: Fitted) -> Candidate:
        judged = self._judge((*added, s.hypothesis), fitted.point)
        return Candidate(s, fitted, self._bic(s, fitted.objective - best.objective), judged)

    def _taken_back(self, h: Hypothesis, fitted: Fitted, best: Fitted) -> Point:
        """Return where a hypothesis left the model's parameters and noise, without itself."""
        values, rows = fitted.point.values.copy(), [self.whole.row(n) for n in (*h.shared, *h.moments)]
        values[rows] = best.point.values[rows]
        return replace(fitted.point, values=values)

    def _open(self, added: tuple[Hypothesis, ...]) -> list[Hypothesis]:
        """Return what is not in force yet."""
        taken = {n for h in added for n in h.amplitudes} | set(self.free)
        found = []
        for h in hypotheses(self.whole, self.free):
            rest = tuple(a for a in h.amplitudes if a not in taken)
            if rest:
                found.append(replace(h, amplitudes=rest))
        return found

    def _promise(self, s: Score) -> float:
        return self._bic(s, s.gain)

    def _bic(self, s: Score, gain: float) -> float:
        """Return the gain in BIC."""
        return 2.0 * gain - s.freedom * self.log_samples

    def _start(self, point: Point, s: Score) -> Point:
        """Return the best start for a joint fit: what the score promises, or a value of the amplitudes' grids."""
        h = s.hypothesis
        values = point.values.copy()
        for name, value in zip(h.shared, [*s.amplitudes, *s.shapes], strict=True):
            values[self.whole.row(name)] = value
        for j, name in enumerate(h.moments):
            values[self.whole.row(name)] = s.moments[:, j]
        starts = [replace(point, values=values)]
        for share in (0.5, 0.25):
            less = values.copy()
            rows = [self.whole.row(n) for n in h.amplitudes]
            less[rows] = point.values[rows] + share * (values[rows] - point.values[rows])
            starts.append(replace(point, values=less))
        return self.fitting.best([*starts[1:], *self._on_grids(starts[0], h.amplitudes)])

    def _on_grids(self, point: Point, names: Sequence[str]) -> list[Point]:
        """Return a point, and others with one parameter each at a value of its grid."""
        found = [point]
        for name in names:
            for value in self.whole.model.parameters[self.whole.row(name)].grid:
                values = point.values.copy()
                values[self.whole.row(name)] = value
                found.append(replace(point, values=values))
        return found

    def _again(self, added: tuple[Hypothesis, ...], best: Fitted, fits: dict[Hypothesis, Fitted]) -> Fitted:
        """Refit the model without addition from where the best hypothesis left its parameters and noise."""
        h, winner = max(fits.items(), key=lambda item: item[1].objective)
        self.say("fitting the model without it again")
        again = self._fit(added, self._taken_back(h, winner, best), turns=1)
        if winner.objective - again.objective < _CLOSE:
            again = self._fit(added, again.point)
        return again if again.objective > best.objective else best

    def _backward(self, added: tuple[Hypothesis, ...], best: Fitted) -> tuple[tuple[Hypothesis, ...], Fitted]:
        """Take away what the later additions made superfluous: all but one of them, or one after the other.

        What is missing may have been taken for something else at first, and for the rest of it thereafter.
        """
        for h in added[1:]:
            self.say(f"is {h.name.replace('_', ' ')} enough?")
            alone, lost = self._without(added, (h,), best)
            if lost < BIC_NEEDED:
                return (h,), alone
        for h in added[:-1]:
            rest = tuple(k for k in added if k != h)
            self.say(f"is {h.name.replace('_', ' ')} still needed?")
            without, lost = self._without(added, rest, best)
            if lost < BIC_NEEDED:
                added, best = rest, without
        return added, best

    def _parameters_instead(
        self, added: tuple[Hypothesis, ...], best: Fitted, rounds: Sequence[Round]
    ) -> tuple[tuple[Hypothesis, ...], Fitted]:
        """Put a wrong parameter in place of an effect if it explains as much together with those added thereafter.

        Of several wrong parameters none alone reaches an effect that resembles their sum; what that leaves is then
        taken for one of them.
        """
        for i, h in enumerate(added):
            rest = tuple(k for k in added if k != h)
            if h.kind != "effect" or all(k.kind != "parameter" for k in added[i + 1 :]):
                continue
            fits = {}
            for p in _stand_ins(rounds, added)[:_REFITTED]:
                self.say(f"may {p.name.replace('_', ' ')} stand for {h.name.replace('_', ' ')}?")
                fits[p] = self._without(added, (*rest, p), best)
            if not fits:
                continue
            p, (fitted, lost) = min(fits.items(), key=lambda item: item[1][1])
            if lost < BIC_NEEDED:
                return (*rest, p), fitted
        return added, best

    def _without(
        self, added: tuple[Hypothesis, ...], rest: tuple[Hypothesis, ...], best: Fitted
    ) -> tuple[Fitted, float]:
        """Return the model with some of its additions only, and what it loses in BIC."""
        kept = {n for k in rest for n in (*k.shared, *k.moments)}
        gone = {n for h in added for n in (*h.shared, *h.moments)} - kept
        values, rows = best.point.values.copy(), [self.whole.row(n) for n in gone]
        values[rows] = self.whole.neutral()[rows, None]
        starts = self._on_grids(replace(best.point, values=values), [n for h in rest for n in h.amplitudes])
        fitted = self._fit(rest, self.fitting.best(starts))
        freed = len(best.coordinates) - len(fitted.coordinates)
        return fitted, 2 * (best.objective - fitted.objective) - freed * self.log_samples


def _stand_ins(rounds: Sequence[Round], added: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return parameters that the drives could hardly tell from those that were added, the best of each round first."""
    found: dict[Hypothesis, None] = {}
    for r in rounds:
        if r.added is not None and r.added.hypothesis in added and r.added.hypothesis.kind == "parameter":
            alike = [c.hypothesis for c in r.candidates if c.hypothesis.name in r.confusable]
            found |= {h: None for h in alike if h.kind == "parameter" and h.name != ALL_PARAMETERS and h not in added}
    return list(found)
