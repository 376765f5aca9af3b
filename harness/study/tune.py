"""One tuning rule for all: each estimator's noise by the likelihood of its innovations, within one budget.

In the ideal case every estimator believes the plant's noise (Ziaukas 2023, 5.1). Where a study asks for tuning
instead, three factors multiply what it would believe: one for the process noise, one for the random walk of the
unknown inputs and one for the measurement noise. They maximise the likelihood of the innovations on stated
training drives, simulated at the study's nominal plant with noise of their own. Every estimator gets the same
drives, the same noise, the same first candidates and the same number of them (differential evolution; eight
candidates run at a time, one per lane).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import toml_text, write_files
from harness.common.registry import closest
from harness.config import NOISE_GROUPS, DesignSpec, EstimatorSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import load_estimator
from harness.study.compiled_study import scale_noise
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

DECADES = 4.0
"""Factors are searched between 10 to the power of minus and plus this: a variance in another unit is far off."""

_EDGE = 0.05
"""Decades from an end of the search within which a factor counts as at it."""

TRAINING_REPEAT = 1_000_000
"""Repeats of training runs are counted from here, so that no scored run shares their noise."""


@dataclasses.dataclass(frozen=True)
class Tuning:
    """What tuning found for one estimator.

    Attributes:
        factors: By group, what the variances are multiplied with.
        before: Log-likelihood of the training drives with the noise as it was.
        after: The same with the tuned noise.
    """

    factors: dict[str, float]
    before: float
    after: float

    @property
    def at_the_edge(self) -> list[str]:
        """Groups whose factor lies at an end of the search, so that the best one may lie beyond."""
        return [g for g, factor in self.factors.items() if abs(np.log10(factor)) > DECADES - _EDGE]


def tune(
    study: StudySpec,
    budget: int,
    repeats: int = 1,
    progress: Callable[[str], None] = lambda _: None,
    only: Sequence[str] = (),
) -> dict[str, Tuning]:
    """Tune the estimators of a study that state a covariance.

    Args:
        study: The study; its drives are the training drives.
        budget: Candidates per estimator.
        repeats: Runs of each drive with different noise.
        progress: Called with the name of each estimator before its turn.
        only: Names of the estimators that are tuned; all by default.

    Raises:
        UserError: If the budget is too small, or an estimator named is not there or has no likelihood, or none has.
    """
    population = 3 * LANES
    if budget < 2 * population:
        raise UserError(f"a budget of {budget} candidates is too small to search three factors; give {2 * population}")
    chosen = chosen_estimators(study, only)
    study = dataclasses.replace(study, estimators=chosen)
    nominal = DesignSpec("tuning", (), repeats=repeats)
    bare = tuple(dataclasses.replace(e, noise={}) for e in chosen)
    evaluator = StudyEvaluator(dataclasses.replace(study, designs=(nominal,), history=(), estimators=bare))
    tunable = [load_estimator(s.kind).HAS_COVARIANCE for s in chosen]
    without = [s.name for s, states_likelihood in zip(chosen, tunable, strict=True) if not states_likelihood]
    if only and without:
        raise UserError(f"{study.path}: {', '.join(without)} states no likelihood, so there is nothing to tune")
    if len(without) == len(chosen):
        raise UserError(f"{study.path}: no estimator of this study states a likelihood, so there is nothing to tune")
    runs = [
        (drive, evaluator.simulate(Unit(0, 0, drive, 0, 1), [Case(0, TRAINING_REPEAT + r)]))
        for drive in range(len(study.drives))
        for r in range(repeats)
    ]
    tunings = {}
    for index, spec in enumerate(chosen):
        if not tunable[index]:
            continue
        progress(spec.name)

        def loss(exponents: Floats, index: int = index) -> Floats:
            return np.array(_losses(evaluator, index, runs, np.atleast_2d(exponents.T)))

        before = -float(loss(np.zeros((len(NOISE_GROUPS), 1)))[0])
        best, lowest = evolve(loss, np.zeros(len(NOISE_GROUPS)), population, budget, study.seed)
        factors = {g: float(10.0**e) for g, e in zip(NOISE_GROUPS, best, strict=True)}
        tunings[spec.name] = Tuning(factors, before, -lowest)
    return tunings


def evolve(
    loss: Callable[[Floats], Floats], first: Floats, population: int, budget: int, seed: int
) -> tuple[Floats, float]:
    """Return the exponents of the smallest loss, and that loss, by differential evolution.

    Args:
        loss: Takes exponents ``(groups, candidates)`` to losses ``(candidates,)``.
        first: Exponents that are among the first candidates ``(groups,)``.
        population: Candidates of a generation.
        budget: Candidates of all generations.
        seed: Of the candidates.
    """
    answer = optimize.differential_evolution(
        loss,
        [(-DECADES, DECADES)] * len(first),
        popsize=population // len(first),
        maxiter=budget // population - 1,
        x0=first,
        rng=np.random.default_rng(seed),
        tol=0.0,  # of the size of the losses, which says nothing of a likelihood: all candidates are tried
        polish=False,
        updating="deferred",
        vectorized=True,
        init="sobol",
    )
    return answer.x, float(answer.fun)


def chosen_estimators(study: StudySpec, only: Sequence[str]) -> tuple[EstimatorSpec, ...]:
    """Return the estimators of these names, all without any name, in the order of the study."""
    names = [e.name for e in study.estimators]
    for name in only:
        if name not in names:
            raise UserError(f"{study.path}: there is no estimator '{name}'{closest(name, names)}")
    return tuple(e for e in study.estimators if not only or e.name in only)


def _losses(evaluator: StudyEvaluator, index: int, runs: list[tuple[int, Any]], exponents: Floats) -> list[float]:
    """Return minus the log-likelihood of each candidate ``(candidates, groups)``; a diverged one is worst."""
    total = np.zeros(len(exponents))
    for start in range(0, len(exponents), LANES):
        group = exponents[start : start + LANES]
        filled = np.vstack([group, np.repeat(group[-1:], LANES - len(group), axis=0)])
        for drive, batch in runs:
            unit, case = Unit(0, 0, drive, 0, 1), [Case(0, 0)]
            believed, spec = evaluator.held(unit, case, "belief"), evaluator.study.belief
            rows = [scale_noise(believed, spec, dict(zip(NOISE_GROUPS, 10.0**row, strict=True))) for row in filled]
            candidates = dataclasses.replace(
                believed,
                process_noise=np.stack([r.process_noise[:, k] for k, r in enumerate(rows)], axis=-1),
                measurement_noise=np.stack([r.measurement_noise[:, k] for k, r in enumerate(rows)], axis=-1),
            )
            scores = evaluator.estimate(index, unit, case, batch, candidates)
            lost = ~np.isfinite(scores.log_likelihood) | (scores.diverged_at < len(batch.truth))
            total[start : start + len(group)] -= np.where(lost, -1e12, scores.log_likelihood)[: len(group)]
    return [float(t) for t in total]


def write_tuning(
    path: Path, study: StudySpec, budget: int, repeats: int, tunings: dict[str, Tuning], command: str
) -> None:
    """Write what was found, with how, as a file that a study names by ``tuning``.

    Args:
        path: The file.
        study: What was tuned; its drives are the training drives.
        budget: Candidates per estimator.
        repeats: Runs of each drive with different noise.
        tunings: By estimator.
        command: That found it.

    Raises:
        UserError: If it cannot be written.
    """
    rule = "largest likelihood of the innovations on the training drives"
    how = {"budget": budget, "repeats": repeats}
    factors = {name: tuning.factors for name, tuning in tunings.items()}
    gains = {
        name: f"log-likelihood {tuning.before:.1f} before, {tuning.after:.1f} after" for name, tuning in tunings.items()
    }
    write_files(path.parent, {path.name: tuning_text(study, rule, how, factors, gains, command)})


def tuning_text(
    study: StudySpec,
    rule: str,
    how: Mapping[str, Any],
    factors: Mapping[str, Mapping[str, float]],
    gains: Mapping[str, str],
    command: str,
) -> str:
    """Return the text of a tuning file.

    Args:
        study: What was tuned; its drives are the training drives.
        rule: By which, in words.
        how: What else decides the result.
        factors: Of every estimator by group; one that is absent is 1.
        gains: What came of it by estimator, in words.
        command: That found it.
    """
    content = {
        "rule": rule,
        "drives": [d.name for d in study.drives],
        **how,
        "seed": study.seed,
        "estimator": {name: {g: given.get(g, 1.0) for g in NOISE_GROUPS} for name, given in factors.items()},
    }
    return toml_text(content, f"Written by: {command}", {("estimator", name): said for name, said in gains.items()})
