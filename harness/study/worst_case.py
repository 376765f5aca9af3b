"""Tune for the worst case: noise that keeps the error small all over the box of a design, not at its middle alone.

The factors are those of ``harness.study.tune``. What they minimise is the conditional value at risk of the error at
95 %, which is its mean over the worst twentieth of the runs (Rockafellar and Uryasev 2002), over points of a Sobol
sequence in the box of a design, on the training drives. The error of a run is its RMSE over the mean one of the nominal
vehicle with the noise as it is, in the mean over the targets, so that 1 is what the estimator does where all is as
believed. A run without a score counts as ``LOST``.

Errors at the nominal point are computed with it, for every candidate. A third of the candidates each seek the smallest
nominal error, the smallest product of both, and the smallest worst case, so that the front between the two is known.
The candidate to take is judged on further points of the sequence and other noise, too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import joblib
import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.common.statistics import tail_mean
from harness.config import NOISE_GROUPS, DesignSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import load_estimator
from harness.models.quantities import Quantity, quantity
from harness.runner.contract import Batch, Held
from harness.study.compiled_study import scale_noise
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case
from harness.study.tune import TRAINING_REPEAT, chosen_estimators, evolve, tuning_text

TAIL = 0.05
"""Share of the runs that the worst case is the mean of."""

LOST = 1e6
"""Error that a run without a score counts as, over the nominal one."""

POINTS = 32
"""Points of the box where nothing else is said."""

POPULATION = 16
"""Candidates of a generation."""

FRONT = (0.0, 0.5, 1.0)
"""Exponents of the worst case in what is minimised, one search each; that of the nominal error is the rest to 1."""


@dataclasses.dataclass(frozen=True)
class NoiseCandidate:
    """Noise that was tried.

    Attributes:
        factors: By group, what the variances are multiplied with.
        nominal: Mean error of the nominal vehicle, over that with the noise as it is.
        worst: Mean error of the worst twentieth of the runs in the box, over the same.
        nominal_rmse: Mean RMSE of the nominal vehicle, SI ``(target,)``.
        worst_rmse: Mean of the largest twentieth of the RMSE in the box, SI ``(target,)``; infinite if a run was lost.
    """

    factors: dict[str, float]
    nominal: float
    worst: float
    nominal_rmse: Floats
    worst_rmse: Floats


@dataclasses.dataclass(frozen=True)
class WorstCase:
    """What was found for one estimator.

    Attributes:
        targets: Whose errors count.
        before: The noise as it is.
        after: The candidate of the smallest worst case.
        tried: All candidates.
        checked: Worst case as it is and after, on points and noise that no candidate was chosen by.
    """

    targets: list[Quantity]
    before: NoiseCandidate
    after: NoiseCandidate
    tried: list[NoiseCandidate]
    checked: tuple[float, float]

    @property
    def front(self) -> list[NoiseCandidate]:
        """The candidates of which none other is better in both, by their nominal error."""
        front: list[NoiseCandidate] = []
        for candidate in sorted(self.tried, key=lambda c: (c.nominal, c.worst)):
            if not front or candidate.worst < front[-1].worst:
                front.append(candidate)
        return front


@dataclasses.dataclass(frozen=True)
class _Runs:
    """Simulated runs of up to ``LANES`` cases, and what is believed in them."""

    unit: Unit
    cases: list[Case]
    batch: Batch
    believed: Held


@dataclasses.dataclass(frozen=True)
class _Training:
    """Runs of the nominal vehicle, of points in the box, and of further points to judge the answer by."""

    nominal: list[_Runs]
    box: list[_Runs]
    check: list[_Runs]


def tune_for_worst_case(
    study: StudySpec,
    design: DesignSpec,
    budget: int,
    points: int = POINTS,
    only: Sequence[str] = (),
    weights: Sequence[float] = FRONT,
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> dict[str, WorstCase]:
    """Tune the estimators of a study that state a covariance for the worst case.

    Args:
        study: The study; its drives are the training drives.
        design: Of the study; its bands together are the box.
        budget: Candidates per estimator.
        points: Points of the box.
        only: Names of the estimators that are tuned; all by default.
        weights: Exponents of the worst case, one search each, as ``FRONT``; the last should be 1.
        jobs: Threads; by default one per core.
        progress: Called with the name of each estimator before its turn.

    Raises:
        UserError: If the budget is too small, the design varies nothing, an estimator named is not there or states no
            covariance, or every nominal run of it is lost.
    """
    least = 2 * POPULATION * len(weights)
    if budget < least:
        raise UserError(f"a budget of {budget} candidates is too small to tune for the worst case; give {least}")
    chosen = chosen_estimators(study, only)
    bare = tuple(dataclasses.replace(e, noise={}) for e in chosen)
    designs = (DesignSpec("nominal", (), repeats=LANES), box_of(study, design, 2 * points))
    evaluator = StudyEvaluator(dataclasses.replace(study, designs=designs, history=(), estimators=bare, over_time=None))
    tuned = [i for i, spec in enumerate(chosen) if load_estimator(spec.kind).HAS_COVARIANCE]
    if not tuned or (only and len(tuned) < len(chosen)):
        raise UserError(f"{study.path}: an estimator that believes no noise has nothing to tune: {chosen[0].name}")
    training = _simulated(evaluator, points)
    tunings = {}
    for index in tuned:
        progress(chosen[index].name)
        tunings[chosen[index].name] = _Search(evaluator, index, training, jobs).run(budget, weights)
    return tunings


def box_of(study: StudySpec, design: DesignSpec, points: int) -> DesignSpec:
    """Return a design of points over all bands of a design together.

    Raises:
        UserError: If the design varies nothing, and nothing is believed wrongly either.
    """
    ends = [(min(f.lower), max(f.upper)) for f in design.factors]
    mistaken = study.plant.effects != study.belief.effects or study.plant.values != study.belief.values
    if not (mistaken or any(low < high for low, high in ends)):
        raise UserError(f"{study.path}: design '{design.name}' varies nothing, so there is no worst case in it")
    factors = tuple(
        dataclasses.replace(f, levels=(low,), lower=(low,), upper=(high,), labels=("box",))
        for f, (low, high) in zip(design.factors, ends, strict=True)
    )
    return DesignSpec("box", factors, base_samples=points)


def _simulated(evaluator: StudyEvaluator, points: int) -> _Training:
    """Simulate the training runs; those to judge by are the points behind, with noise of their own."""
    parts: tuple[list[_Runs], list[_Runs], list[_Runs]] = ([], [], [])
    for drive in range(len(evaluator.study.drives)):
        every = (
            (0, [Case(0, TRAINING_REPEAT + r) for r in range(LANES)]),
            (1, [Case(s, TRAINING_REPEAT) for s in range(points)]),
            (1, [Case(s, TRAINING_REPEAT) for s in range(points, 2 * points)]),
        )
        for part, (design, cases) in zip(parts, every, strict=True):
            unit = Unit(design, 0, drive, cases[0].sample, cases[-1].sample + 1)
            for group in (cases[k : k + LANES] for k in range(0, len(cases), LANES)):
                believed = evaluator.held(unit, group, "belief")
                part.append(_Runs(unit, group, evaluator.simulate(unit, group), believed))
    return _Training(*parts)


class _Search:
    """The search for one estimator."""

    def __init__(self, evaluator: StudyEvaluator, index: int, training: _Training, jobs: int | None) -> None:
        self.evaluator, self.index, self.training, self.jobs = evaluator, index, training, jobs
        study = evaluator.study
        unknown = bool(study.belief.unknown_inputs)
        self.groups = [g for g in NOISE_GROUPS if g != "unknown_inputs" or unknown]
        self.targets = [i for i, t in enumerate(study.targets) if t not in study.belief.estimated_parameters]
        self.tried: list[NoiseCandidate] = []
        at_first = self._errors(training.nominal, {})
        if not np.isfinite(at_first).any(axis=1).all():
            name = study.estimators[index].name
            raise UserError(f"{study.path}: every nominal run of '{name}' is lost; state its noise anew before tuning")
        self.scale = np.array([np.mean(row[np.isfinite(row)]) for row in at_first])

    def run(self, budget: int, weights: Sequence[float]) -> WorstCase:
        """Return what all candidates of the budget come to."""
        before = self.candidate({})
        self.tried.append(before)
        for weight in weights:
            loss = self._loss_of(weight)
            first = min(self.tried, key=lambda c: _traded(c, weight))
            exponents = np.log10([first.factors.get(g, 1.0) for g in self.groups])
            evolve(loss, exponents, POPULATION, budget // len(weights), self.evaluator.study.seed)
        after = min(self.tried, key=lambda c: c.worst)
        targets = [quantity(self.evaluator.study.targets[i]) for i in self.targets]
        checked = tuple(self._worst(self._errors(self.training.check, c.factors)) for c in (before, after))
        return WorstCase(targets, before, after, self.tried, (checked[0], checked[1]))

    def _loss_of(self, weight: float) -> Callable[[Floats], Floats]:
        def loss(exponents: Floats) -> Floats:
            rows = [dict(zip(self.groups, 10.0**row, strict=True)) for row in np.atleast_2d(exponents.T)]
            parallel = joblib.Parallel(n_jobs=min(self.jobs or joblib.cpu_count(), len(rows)), backend="threading")
            candidates = parallel(joblib.delayed(self.candidate)({g: float(f) for g, f in row.items()}) for row in rows)
            self.tried.extend(candidates)
            return np.array([_traded(c, weight) for c in candidates])

        return loss

    def candidate(self, factors: dict[str, float]) -> NoiseCandidate:
        """Return what the estimator does with some noise."""
        nominal, box = (self._errors(runs, factors) for runs in (self.training.nominal, self.training.box))
        return NoiseCandidate(
            factors,
            float(np.mean(self._relative(nominal))),
            self._worst(box),
            np.mean(nominal, axis=1),
            np.array([tail_mean(row, TAIL) for row in box]),
        )

    def _worst(self, errors: Floats) -> float:
        return tail_mean(self._relative(errors), TAIL)

    def _relative(self, errors: Floats) -> Floats:
        """Return the error of each run over the nominal one, in the mean over the targets."""
        relative = np.mean(errors / self.scale[:, None], axis=0)
        return np.where(np.isfinite(relative), relative, LOST)

    def _errors(self, every: Sequence[_Runs], factors: dict[str, float]) -> Floats:
        """Return the RMSE of all runs ``(target, run)``, infinite where the estimator diverges."""
        parts = []
        for runs in every:
            believed = scale_noise(runs.believed, self.evaluator.study.belief, factors)
            scores = self.evaluator.estimate(self.index, runs.unit, runs.cases, runs.batch, believed)
            lost = scores.diverged_at < len(runs.batch.truth)
            parts.append(np.where(lost, np.inf, scores.rmse[self.targets])[:, : len(runs.cases)])
        return np.concatenate(parts, axis=1)


def _traded(candidate: NoiseCandidate, weight: float) -> float:
    return float((1 - weight) * np.log(candidate.nominal) + weight * np.log(candidate.worst))


def write_worst_case(
    path: Path,
    study: StudySpec,
    design: DesignSpec,
    budget: int,
    points: int,
    tunings: dict[str, WorstCase],
    command: str,
) -> None:
    """Write what was found, with how, as a file that a study names by ``tuning``.

    Raises:
        UserError: If it cannot be written.
    """
    rule = f"smallest conditional value at risk of the error at 95 % over the box of design '{design.name}'"
    gains = {
        name: f"worst case {tuned.before.worst:.3g} before, {tuned.after.worst:.3g} after, "
        f"nominal error {tuned.after.nominal:.3g}"
        for name, tuned in tunings.items()
    }
    factors = {name: tuned.after.factors for name, tuned in tunings.items()}
    how = {"budget": budget, "points": points}
    write_files(path.parent, {path.name: tuning_text(study, rule, how, factors, gains, command)})
