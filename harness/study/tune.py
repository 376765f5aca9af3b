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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import toml_text, write_files
from harness.config import NOISE_GROUPS, DesignSpec, Study
from harness.engine.simd.lanes import LANES
from harness.study.design import RunParameters, Unit, scale_noise
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

DECADES = 2.0
"""Factors are searched between 10 to the power of minus and plus this."""

_TRAINING_REPEAT = 1_000_000
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


def tune(
    study: Study, budget: int, repeats: int = 1, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Tuning]:
    """Tune every estimator of a study that states a covariance.

    Args:
        study: The study; its drives are the training drives.
        budget: Candidates per estimator.
        repeats: Runs of each drive with different noise.
        progress: Called with the name of each estimator before its turn.

    Raises:
        UserError: If the budget is too small, or no estimator has a likelihood.
    """
    population = 3 * LANES
    if budget < 2 * population:
        raise UserError(f"a budget of {budget} candidates is too small to search three factors; give {2 * population}")
    nominal = DesignSpec("tuning", (), repeats=repeats)
    bare = tuple(dataclasses.replace(e, noise={}) for e in study.estimators)
    evaluator = StudyEvaluator(dataclasses.replace(study, designs=(nominal,), history=(), estimators=bare))
    if not any(e.has_covariance for e in evaluator.compiled.estimators):
        raise UserError(f"{study.path}: no estimator of this study states a likelihood, so there is nothing to tune")
    runs = [
        (drive, evaluator.simulate(Unit(0, 0, drive, 0, 1), [Case(0, _TRAINING_REPEAT + r)]))
        for drive in range(len(study.drives))
        for r in range(repeats)
    ]
    found = {}
    for index, spec in enumerate(study.estimators):
        if not evaluator.compiled.estimators[index].has_covariance:
            continue
        progress(spec.name)

        def loss(exponents: Floats, index: int = index) -> Floats:
            return np.array(_losses(evaluator, index, runs, np.atleast_2d(exponents.T)))

        before = -float(loss(np.zeros((len(NOISE_GROUPS), 1)))[0])
        answer = optimize.differential_evolution(
            loss,
            [(-DECADES, DECADES)] * len(NOISE_GROUPS),
            popsize=population // len(NOISE_GROUPS),
            maxiter=budget // population - 1,
            x0=np.zeros(len(NOISE_GROUPS)),
            rng=np.random.default_rng(study.seed),
            polish=False,
            updating="deferred",
            vectorized=True,
            init="sobol",
        )
        factors = {g: float(10.0**e) for g, e in zip(NOISE_GROUPS, answer.x, strict=True)}
        found[spec.name] = Tuning(factors, before, -float(answer.fun))
    return found


def _losses(evaluator: StudyEvaluator, index: int, runs: list[tuple[int, Any]], exponents: Floats) -> list[float]:
    """Return minus the log-likelihood of each candidate ``(candidates, groups)``; a diverged one is worst."""
    total = np.zeros(len(exponents))
    for start in range(0, len(exponents), LANES):
        group = exponents[start : start + LANES]
        filled = np.vstack([group, np.repeat(group[-1:], LANES - len(group), axis=0)])
        for drive, batch in runs:
            unit, case = Unit(0, 0, drive, 0, 1), [Case(0, 0)]
            believed, spec = evaluator.parameters(unit, case, "belief"), evaluator.study.belief
            rows = [scale_noise(believed, spec, dict(zip(NOISE_GROUPS, 10.0**row, strict=True))) for row in filled]
            candidates = RunParameters(
                believed.values,
                np.stack([r.process_noise[k] for k, r in enumerate(rows)]),
                np.stack([r.measurement_noise[k] for k, r in enumerate(rows)]),
            )
            scores = evaluator.estimate(index, unit, case, batch, candidates)
            lost = ~np.isfinite(scores.log_likelihood) | (scores.diverged_at < len(batch.truth))
            total[start : start + len(group)] -= np.where(lost, -1e12, scores.log_likelihood)[: len(group)]
    return [float(t) for t in total]


def write_tuning(path: Path, study: Study, budget: int, repeats: int, found: dict[str, Tuning]) -> None:
    """Write what was found, with how, as a file that a study names by ``tuning``.

    Raises:
        UserError: If it cannot be written.
    """
    content = {
        "rule": "largest likelihood of the innovations on the training drives",
        "drives": [d.name for d in study.drives],
        "budget": budget,
        "repeats": repeats,
        "seed": study.seed,
        "estimator": {name: {g: tuning.factors[g] for g in NOISE_GROUPS} for name, tuning in found.items()},
    }
    heading = f"Written by: harness tune {study.path.name} --budget {budget} --repeats {repeats}"
    gains: dict[tuple[str, ...], str] = {
        ("estimator", name): f"log-likelihood {tuning.before:.1f} before, {tuning.after:.1f} after"
        for name, tuning in found.items()
    }
    write_files(path.parent, {path.name: toml_text(content, heading, gains)})
