"""Probability of each model of a trace: its prediction of drives that were never fitted, and the odds beforehand.

The odds are one table by kind of hypothesis, with how far a stated value may be off.

The criterion is the log predictive density of the held-out drives, a strictly proper score (Gneiting and Raftery 2007,
section 4.1), at horizons from one sample to the whole drive, each with the model's own covariance. One step alone
chooses by what shows from sample to sample, where a filter hides what is missing; the free run alone does not see
what is quick. All horizons count alike. Samples near each other are not independent, so densities are summed over
blocks, and the blocks are weighted anew again and again: with ``z_ij`` the density of model ``i`` in block ``j`` of
``B``, weights ``w`` from the Dirichlet distribution with all parameters 1 and priors ``pi``, the probability is the
mean over the draws of ``pi_i exp(B sum_j w_j z_ij) / sum_k pi_k exp(B sum_j w_j z_kj)``, which is pseudo-BMA+ (Yao,
Vehtari, Simpson and Gelman 2018, section 3.4) over blocks, with priors. Where all blocks say the same, these are Bayes
factors; where they disagree, it says how often a model would be the best of drives like these.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logsumexp, softmax
from scipy.stats import chi2

from harness.common.arrays import Floats
from harness.common.statistics import Interval
from harness.diagnosis.criteria import BLOCK, MASS, PRIORS
from harness.diagnosis.fitting import FittedHypothesis, block_sums
from harness.diagnosis.innovations.prediction import Ahead
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.identification.data import DriveData
from harness.identification.uncertainty import marginal
from harness.models.assembly.placement import split


def kind_of(h: Hypothesis) -> str:
    """Return the kind of a hypothesis in the table of odds."""
    if h.kind == "parameter":
        return "many" if h.name == ALL_PARAMETERS else "parameter"
    return "effect" if h.output is None else "sensor"


def log_odds(tried: Sequence[Hypothesis]) -> dict[tuple[str, str], float]:
    """Return the logarithm of the odds of every hypothesis by kind and name.

    Args:
        tried: All of them.
    """
    tried = [h for h in tried if not h.parts]
    files = {(kind_of(h), split(h.name)[0]) for h in tried}
    of_kind = Counter(kind for kind, _ in files)
    of_file = Counter((kind_of(h), split(h.name)[0]) for h in tried)

    def odds(h: Hypothesis) -> float:
        kind = kind_of(h)
        return PRIORS.odds[kind] / of_kind[kind] / of_file[kind, split(h.name)[0]]

    return {(h.kind, h.name): math.log(odds(h)) for h in tried}


def log_size(fitted: FittedHypothesis, added: Sequence[Hypothesis]) -> float:
    """Return the logarithm of how plausible the errors of stated values are, over no error.

    A parameter is off by what its set states, in its coordinate. Where that says nothing, a positive one is off by a
    factor whose logarithm is normal with the standard deviation ``PRIORS.stated``, so that a factor of 1.8 costs four
    units and one of ten more than sixty; that of a length on the vehicle has ``PRIORS.length``. A parameter that is
    fitted in any case has the prior of the fit. So has the intensity of a random process that earlier drives showed:
    one that takes a change up grows as it does on no other day.
    """
    stated = {n for h in added if h.kind == "parameter" for n in h.amplitudes}
    moved = [(c, c.stated_std if c.name in stated else c.prior) for c in fitted.coordinates]
    return -0.5 * sum(((c.coordinate(fitted.point.value(c)) - c.centre) / std) ** 2 for c, std in moved)


def log_stand_in(fitted: FittedHypothesis, added: Sequence[Hypothesis], information: Floats) -> float:
    """Return the log odds by which values of many parameters at once rather stand for something unlisted.

    Values that are only stated wrongly scatter as they are known to. Some of many that a fit moves may take up what no
    hypothesis holds, and those scatter ``PRIORS.implausible`` times as widely, the width at which a single one is not
    believed. Both are normal, and the likelihood too (Laplace's approximation about the fit), each value with all
    others open. A single one that is added alone is free to be off by any factor; with many it is one of them.

    Args:
        fitted: A fit.
        added: What it holds, all parameters at once among it.
        information: Fisher information, with that of the priors, on what the fit moved ``(n, n)``.
    """
    many = {n for h in added if h.name == ALL_PARAMETERS for n in h.amplitudes}
    gains = []
    for i, c in enumerate(fitted.coordinates):
        if c.name in many:
            held = (c.stated_std / c.prior) ** 2  # by its prior; not at all where it is free
            seen = max(0.0, float(marginal(information, [i])[0, 0]) * c.stated_std**2 - held)  # by the drives
            pull = (seen + held) * (c.coordinate(fitted.point.value(c)) - c.centre) / c.stated_std
            wide, narrow = (_log_evidence(seen, pull, width) for width in (PRIORS.implausible, 1.0))
            gains.append(wide - narrow)
    return log_some_of(np.array(gains))


def _log_evidence(seen: float, pull: float, width: float) -> float:
    """Return the logarithm of the integral of ``exp(pull x - seen x^2 / 2)`` over a normal prior."""
    total = seen + width**-2.0
    return 0.5 * (pull**2 / total - math.log(width**2 * total))


def log_some_of(gains: Floats) -> float:
    """Return the log likelihood ratio of all choices of some of several changes, each choice as likely as any other.

    Args:
        gains: In log-likelihood of each change ``(n,)``.
    """
    together = float(np.logaddexp(0.0, gains).sum())  # with the choice of none
    some = together + math.log(-math.expm1(-together)) if together > 1e-6 else float(logsumexp(gains))
    return some - math.log(2.0 ** len(gains) - 1.0)


_DRAWS = 1000

_ORDINATES = 100
"""Ordinates of the periodogram in the lowest octave: their mean is uncertain by a tenth."""


@dataclass(frozen=True)
class Alike:
    """Hypotheses that the drives cannot tell apart at all.

    Attributes:
        hypotheses: The one that was fitted first.
        shares: Of each in the probability of all, by the priors.
        ratios: Of the step of each amplitude to that of the first, with which it does the same; NaN without one.
    """

    hypotheses: tuple[Hypothesis, ...]
    shares: tuple[float, ...]
    ratios: tuple[float, ...] = ()


@dataclass(frozen=True)
class ComparedModel:
    """A model that was fitted and judged.

    Attributes:
        added: What it has beyond the nominal model.
        fitted: Its fit.
        log_prior: Logarithm of its prior, up to what all have in common.
        densities: Log predictive density of the held-out drives ``(horizons,)``.
        difference: Mean of these less that of the likeliest model, with a 90 % interval by blocks.
        share: Its probability if one of the models is right.
        probability: Its probability.
    """

    added: tuple[Alike, ...]
    fitted: FittedHypothesis
    log_prior: float
    densities: Floats
    difference: Interval
    share: float
    probability: float

    def share_of(self, hypothesis: Hypothesis) -> float:
        """Return the probability of a hypothesis in it, by the priors among what is alike; 0 if it has none of it."""
        pairs = (pair for a in self.added for pair in zip(a.hypotheses, a.shares, strict=True))
        return next((share for h, share in pairs if h == hypothesis), 0.0)


@dataclass(frozen=True)
class Posterior:
    """All models of a trace.

    Attributes:
        models: The likeliest first.
        none: Probability that none of them is right.
        coverage: Share of the held-out samples within the 95 % region that the likeliest predicts ``(horizons,)``.
    """

    models: tuple[ComparedModel, ...]
    none: float
    coverage: Floats

    def confusable(self, mass: float = MASS) -> tuple[ComparedModel, ...]:
        """Return the smallest set of models that holds the right one with a probability, if one of them is right."""
        before = np.cumsum([0.0, *(m.share for m in self.models)])
        return tuple(m for m, b in zip(self.models, before, strict=False) if b < mass)

    def model_with(self, added: Iterable[Hypothesis]) -> ComparedModel | None:
        """Return the model that has certain additions and no others; ``None`` if it is not among them."""
        wanted = frozenset(added)
        return next((m for m in self.models if frozenset(a.hypotheses[0] for a in m.added) == wanted), None)

    def probability_of(self, hypotheses: Iterable[Hypothesis]) -> float:
        """Return the probability that all of some hypotheses are right: that of the models with all of them."""
        wanted = tuple(hypotheses)
        return sum(m.probability * math.prod(m.share_of(h) for h in wanted) for m in self.models)

    def inclusion(self) -> dict[Hypothesis, float]:
        """Return the probability of each hypothesis: that of all models with it, by the priors among what is alike."""
        inclusion: dict[Hypothesis, float] = {}
        for m in self.models:
            for alike in m.added:
                for h, share in zip(alike.hypotheses, alike.shares, strict=True):
                    inclusion[h] = inclusion.get(h, 0.0) + m.probability * share
        return dict(sorted(inclusion.items(), key=lambda item: -item[1]))

    def refusing(self, refused: Callable[[ComparedModel], bool]) -> Posterior:
        """Return the probabilities where some models are no answer: theirs is that of none of these.

        Args:
            refused: Whether a model is none; the nominal one is never asked for.
        """
        nominal = [m for m in self.models if not m.added]
        gone = [m for m in self.models if m.added and m.share > 0.0 and refused(m)]
        kept = [m for m in self.models if all(m is not g for g in gone)]
        total = sum(m.share for m in kept)
        if total > 0.0:
            kept = [replace(m, share=m.share / total) for m in kept]
        elif nominal:
            kept = [replace(m, share=float(m is nominal[0])) for m in sorted(kept, key=lambda m: m is not nominal[0])]
        models = (*kept, *(replace(m, share=0.0, probability=0.0) for m in gone))
        return replace(self, models=models, none=self.none + sum(m.probability for m in gone))

    def with_unlisted(self, fitted: FittedHypothesis, gain: float) -> Posterior:
        """Return the probabilities where something unlisted acts in addition to a model.

        Its odds are those of "none of these" there, times the factor by which it makes the held-out drives likelier.

        Args:
            fitted: The model with which it was found. Nothing changes if that is none of these.
            gain: In log-likelihood of the held-out drives.
        """
        first, own = self.models[0], next((m for m in self.models if m.fitted is fitted), None)
        if own is None or first.probability == 0.0:
            return self
        log_odds = own.difference.value + own.log_prior - first.log_prior + math.log(PRIORS.odds["none"]) + gain
        taken = float(expit(math.log(first.probability) + log_odds))
        models = tuple(replace(m, probability=m.probability * (1.0 - taken)) for m in self.models)
        return replace(self, models=models, none=self.none + (1.0 - self.none) * taken)


def weights(blocks: int, seed: int = 0) -> Floats:
    """Return weights of the blocks, of mean 1, for every draw of the Bayesian bootstrap ``(draws, blocks)``."""
    return blocks * np.random.default_rng(seed).dirichlet(np.ones(blocks), _DRAWS)


def probabilities(log_priors: Floats, densities: Floats) -> Floats:
    """Return the probability of each model ``(models,)``.

    Args:
        log_priors: Up to a constant ``(models,)``.
        densities: Log predictive density of each block ``(models, blocks)``; minus infinity where a model cannot
            be driven, of which there must be one that can.
    """
    usable = np.isfinite(densities).all(axis=1)
    mean = np.zeros(len(densities))
    drawn = weights(densities.shape[1]) @ densities[usable].T + log_priors[usable]
    mean[usable] = softmax(drawn, axis=1).mean(axis=0)
    return mean


def shared_horizons(blocks: Floats, shares: Floats) -> Floats:
    """Return the weighted mean of the log density over the horizons that count ``(models, blocks)``.

    They are those at which the model that can be driven at most of them can: a horizon at which none can says nothing.

    Args:
        blocks: Log density by block and horizon ``(models, blocks, horizons)``, not finite where a model cannot be
            driven.
        shares: Weight of each horizon ``(horizons,)``.
    """
    driven = np.asarray(np.isfinite(blocks).all(axis=1))
    most = np.asarray(driven[np.argmax(driven.sum(axis=1))])
    if not most.any():
        return np.zeros(blocks.shape[:2])
    return np.asarray(np.average(blocks[:, :, most], axis=2, weights=shares[most]))


def interval(differences: Floats) -> Interval:
    """Return the sum of differences in log density by block ``(blocks,)`` with its 90 % interval."""
    if not np.isfinite(differences).all():
        return Interval(-math.inf, -math.inf, -math.inf)
    low, high = np.quantile(weights(len(differences)) @ differences, (0.05, 0.95))
    return Interval(float(differences.sum()), float(low), float(high))


def ordinates(series: Floats) -> Floats:
    """Return the periodogram of a series at the frequencies ``2 pi k / n`` between zero and the Nyquist frequency.

    Of white noise of variance 1 the ordinates are independent and exponential with mean 1. Samples are joined across
    gaps, so that a slow sensor has the ordinates of what it measured.

    Args:
        series: Samples ``(samples,)``, NaN where nothing was measured.
    """
    seen = series[np.isfinite(series)]
    n = max(1, len(seen))
    return np.asarray(np.abs(np.fft.rfft(seen, n)[1 : (n + 1) // 2]) ** 2 / n)


def octaves(series: Sequence[Floats], lowest: int) -> tuple[Floats, Floats]:
    """Return mean and number of the ordinates of some series in each octave below the Nyquist frequency.

    Args:
        series: Samples of each drive ``(samples,)``.
        lowest: Number of the octave that holds all that is below it as well; the first is 0.
    """
    spectra = [ordinates(s) for s in series]
    shares = np.concatenate([np.arange(1, len(s) + 1) / (len(s) + 1) for s in spectra])
    place = np.minimum(np.floor(-np.log2(shares)).astype(int), lowest)
    count = np.bincount(place, minlength=lowest + 1).astype(float)
    return np.bincount(place, np.concatenate(spectra), lowest + 1) / np.maximum(count, 1.0), count


def coloured(fitted: Sequence[Floats], held_out: Sequence[Floats]) -> float:
    """Return how much likelier the held-out drives are if the innovations do not have the spectrum that they should.

    What is unmodelled adds to it where it acts, and the noise that was fitted to that is too large elsewhere. What the
    fitted drives show in an octave, where that differs by the factor ``PRIORS.misfit`` or more, the held-out ones
    show in some of these octaves, each choice as likely as any other: a vibration moves with the speed. Where the
    fitted drives show nothing it is that factor in the octave that shows most, because else nothing would be claimed.
    The likelihood is that of Whittle (1953): ordinates of the periodogram are exponential.

    Args:
        fitted: Whitened innovations of the fitted drives ``(samples, ny)``.
        held_out: The same of the held-out ones.
    """
    shown: list[Floats] = []
    mean: list[Floats] = []
    count: list[Floats] = []
    for a in range(fitted[0].shape[1]):
        here, there = ([w[:, a] for w in drives] for drives in (fitted, held_out))
        fewest = min(sum(np.isfinite(s).sum() for s in series) / 2 for series in (here, there))
        lowest = int(math.log2(max(1.0, fewest / _ORDINATES)))
        shown.append(octaves(here, lowest)[0])
        for spectra, new in zip((mean, count), octaves(there, lowest), strict=True):
            spectra.append(new)
    factors = np.concatenate(shown)
    differ = (factors >= PRIORS.misfit) | ((factors > 0.0) & (factors <= 1.0 / PRIORS.misfit))
    if not differ.any():
        differ[np.argmax(factors)] = True
        factors[differ] = PRIORS.misfit
    factors, means, counts = (v[differ] for v in (factors, np.concatenate(mean), np.concatenate(count)))
    return log_some_of(counts * (means * (1.0 - 1.0 / factors) - np.log(factors)))


def farther(fitted: Floats, held_out: Floats) -> Floats:
    """Return by block how much likelier the held-out drives are if something unmodelled adds to what is to come.

    It multiplies the covariance of a prediction by what the fitted drives show at that horizon, where that is the
    factor ``PRIORS.misfit`` or more. The mean is over all horizons, but the first one says nothing: there the
    spectrum of the innovations is looked at (``coloured``).

    Args:
        fitted: Squared distances of the fitted drives from the prediction over its covariance, by block and horizon,
            and how many numbers were measured ``(blocks, horizons + 1)``.
        held_out: The same of the held-out ones.

    Returns:
        Log densities ``(blocks,)``.
    """
    factors = fitted[:, 1:-1].sum(axis=0) / fitted[:, -1].sum()
    shown = np.flatnonzero(
        np.isfinite(factors) & np.isfinite(held_out[:, 1:-1]).all(axis=0) & (factors >= PRIORS.misfit)
    )
    squares, seen, factors = held_out[:, 1 + shown], held_out[:, -1:], factors[shown]
    gain = 0.5 * (squares * (1.0 - 1.0 / factors) - seen * np.log(factors))
    return np.asarray(gain.sum(axis=1) / (held_out.shape[1] - 1))


def coverage(held_out: Sequence[Ahead]) -> Floats:
    """Return the share of the samples within the 95 % region that a model predicts ``(horizons,)``."""
    within = [a.squares <= chi2.ppf(0.95, np.maximum(a.seen, 1))[:, None] for a in held_out]
    return np.asarray(np.concatenate([w[a.seen > 0] for w, a in zip(within, held_out, strict=True)]).mean(axis=0))


def by_block(densities: Sequence[Floats], drives: Sequence[DriveData], penalty: float = 0.0) -> Floats:
    """Return log densities of several drives by block ``(blocks, horizons)``, less what was fitted to them there.

    The first block of a drive, unless it is the only one, is left out: far ahead, what it shows is how soon a model
    forgets a first state that nobody knows.
    """
    each = [block_sums(d, drive.time[1:]) for d, drive in zip(densities, drives, strict=True)]
    stacked = np.concatenate([blocks[1:] if len(blocks) > 1 else blocks for blocks in each])
    return stacked - penalty / len(stacked)


def judging(seconds: float) -> float:
    """Return how long of a held-out drive counts, in s; its first block does not unless it is the only one."""
    return seconds - BLOCK if seconds >= 2.0 * BLOCK else seconds
