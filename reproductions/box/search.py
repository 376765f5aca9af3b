"""The point nearest to the dissertation: the best of the sequence, improved by differential evolution."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.common.arrays import Floats
from reproductions.box.evidence import IN_BOX, PointEvidence, evidence_of
from reproductions.box.factors import FACTORS
from reproductions.box.plausibility import plausibility
from reproductions.box.points import SEED, Folder, Point

POPULATION = 24
"""Points that candidates are bred from."""

GENERATION = 16
"""Candidates per generation."""

WEIGHT = 0.6
CROSSOVER = 0.7


def score(point: Point, evidence: PointEvidence) -> float:
    """Return what the search makes small.

    The distance of the numbers, the share of findings that do not hold, and 1 where the vehicle is not plausible.
    """
    implausible = not plausibility(point.at).plausible
    return evidence.off() + 1.0 - sum(evidence.holds()) / len(IN_BOX) + float(implausible)


def candidates(places: Floats, scores: Floats, generation: int) -> Floats:
    """Return the candidates of a generation, ``(GENERATION, factors)``.

    Differential evolution (Storn and Price 1997), from a random point towards the best, binomial crossover; places
    beyond an edge are reflected.

    Args:
        places: Of all points so far, ``(points, factors)``.
        scores: Theirs, ``(points,)``.
        generation: From 0; with it all random choices are fixed.
    """
    rng = np.random.default_rng([SEED, generation])
    parents = places[np.argsort(scores, kind="stable")[:POPULATION]]
    trials = []
    for k in range(GENERATION):
        target, best = parents[k % len(parents)], parents[0]
        a, b = parents[rng.choice(len(parents), 2, replace=False)]
        mutant = target + WEIGHT * (best - target) + WEIGHT * (a - b)
        taken = rng.random(len(FACTORS)) < CROSSOVER
        taken[rng.integers(len(FACTORS))] = True
        trial = np.abs(np.where(taken, mutant, target))
        trials.append(np.clip(np.where(trial > 1.0, 2.0 - trial, trial), 0.0, 1.0))
    return np.array(trials)


def refine(
    folder: Folder,
    points: Sequence[Point],
    evidence: Sequence[PointEvidence],
    generations: int,
    jobs: int,
    tell: Callable[[str], None],
) -> tuple[list[Point], list[PointEvidence]]:
    """Return the points of some generations after a sequence, with what they say; those kept are not computed again."""
    everyone, all_evidence = list(points), list(evidence)
    for generation in range(generations):
        places = np.array([p.place for p in everyone])
        scores = np.array([score(p, s) for p, s in zip(everyone, all_evidence, strict=True)])
        tell(f"generation {generation + 1} of {generations}, best so far {scores.min():.2f}")
        for point in folder.points(candidates(places, scores, generation), len(everyone), jobs, tell):
            everyone.append(point)
            all_evidence.append(evidence_of(point))
    return everyone[len(points) :], all_evidence[len(points) :]
