"""Judge a model on drives that were never fitted: how likely they are, and how large the simulation error is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval
from harness.diagnosis.criteria import ERROR_NEEDED, EXCESS, FARTHER, LITTLE, WHITE
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint, moved_to
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis, coordinates
from harness.diagnosis.selection.posterior import by_block, weights
from harness.diagnosis.selection.score_test import ScoreTest
from harness.identification.data import DriveData
from harness.identification.result import DriveJudgement, judged_on, stays


@dataclass(frozen=True)
class Judgement:
    """A model on the held-out drives.

    Attributes:
        log_likelihood: Of all of them; half the logarithm of the samples less for each change time fitted there.
        error: Root mean square of measurement less free run ``(ny,)``.
        normalised_excess_mses: Mean square of that over its floor, less one, not negative ``(ny,)``. The floor is the
            variance of the sensor's noise, of its drift, and of what the errors of the inputs do to a free run.
        drives: The same drive by drive; empty for what is no model of its own.
        point: Values with which it was judged; change times are those of the held-out drives.
        log_density: Logarithm of the predictive density of the free run, but for a constant: of all outputs, in the
            mean of the samples. Who allows for a larger error, as a random process does, pays for that by its floor.
        wander: Share of the floor that the random processes of the model add ``(ny,)``.
        plain_excess: ``normalised_excess_mse`` over the floor of sensors and inputs alone.
        discrepancy: Whether the model allows for its discrepancy.
    """

    log_likelihood: float
    error: Floats
    normalised_excess_mses: Floats
    drives: tuple[DriveJudgement, ...]
    point: ParameterPoint
    log_density: float = math.nan
    wander: Floats | float = 0.0
    plain_excess: float = math.nan
    discrepancy: bool = False

    @property
    def normalised_excess_mse(self) -> float:
        """Excess of all outputs together."""
        return float(np.sum(self.normalised_excess_mses))

    @property
    def unexplained(self) -> float:
        """The part of that for which no random process stands that strays as far as one may in a drive."""
        beyond = self.normalised_excess_mses - (FARTHER - 1.0) * self.wander
        return float(np.sum(np.maximum(beyond, 0.0)))


def leaves_nothing(after: Judgement, before: Judgement) -> bool:
    """Whether a model leaves no more unexplained than its floor is uncertain, or a hundredth of another one's excess.

    Where the free run of the other model leaves its range, only the floor counts.
    """
    little = LITTLE * before.normalised_excess_mse if np.isfinite(before.normalised_excess_mse) else 0.0
    return after.unexplained <= max(EXCESS, little)


def predicts_better(after: Judgement, before: Judgement) -> bool:
    """Whether the simulation error of a model is less than another's by enough of what can be explained.

    Models that allow for their discrepancy differ in their floors. Of those the error over the floor of sensors and
    inputs must not grow, and the likelihood decides.

    That is what exceeds the floor by more than the floor itself is uncertain. Where nothing does, no fall can be asked
    of an error that is that of a perfect model as far as anybody knows: it must stay so, and the likelihood decides.
    """
    if after.discrepancy:
        return bool(after.plain_excess <= EXCESS + before.plain_excess)
    explicable = max(before.normalised_excess_mse - EXCESS, 0.0)
    return after.normalised_excess_mse <= EXCESS + (1 - ERROR_NEEDED) * explicable


@dataclass(frozen=True)
class ErrorGrowth:
    """Simulation error of a model on the held-out drives over that of another one.

    Attributes:
        ratio: Of the roots of the mean squares over the floor, all outputs together, with its 90 % interval.
        beyond_noise: Whether the error grows by more than its own noise and that of the floor.
    """

    ratio: Interval
    beyond_noise: bool


def error_growth(held_out: HeldOut, before: Judgement, after: Judgement) -> ErrorGrowth:
    """Return how the free run of a model over the held-out drives compares with that of another one.

    Both have the same floor, the noise of sensors and inputs: what the random processes of a model allow for is no
    excuse for a larger error. The noise of the mean squares is that of the blocks of 5 s, weighted by the Bayesian
    bootstrap (Rubin 1981). A process that is there strays in the errors of both models. Its product with the rest of
    an error has a longer memory than a block, so with a process a fifth of the excess is no growth yet.

    Args:
        held_out: The drives, with their floor.
        before: The model without additions on them.
        after: The other one.
    """
    if not (math.isfinite(before.normalised_excess_mse) and math.isfinite(after.normalised_excess_mse)):
        lost = math.isfinite(before.normalised_excess_mse)
        growth = math.inf if lost else math.nan
        return ErrorGrowth(Interval(growth, growth, growth), lost)
    (earlier, value_before), (later, value) = (_mean_squares(held_out, judged) for judged in (before, after))
    ratio = np.sqrt(later / earlier)
    low, high = np.quantile(ratio, (0.05, 0.95))
    room = EXCESS + (ERROR_NEEDED * before.normalised_excess_mse if np.any(after.wander) else 0.0)
    grows = bool(np.quantile(later - earlier, 0.05) > room)
    return ErrorGrowth(Interval(math.sqrt(value / value_before), float(low), float(high)), grows)


def _mean_squares(held_out: HeldOut, judged: Judgement) -> tuple[Floats, float]:
    """Return the mean square of the simulation error over its floor, summed over the outputs: drawn, and as it is."""
    variances = [held_out.variances + drive.spread for drive in held_out.drives]
    errors = [d.drive.measurements - d.simulated for d in judged.drives]
    squares = [e[1:] ** 2 / v[1:] for e, v in zip(errors, variances, strict=True)]
    seen = by_block([np.isfinite(s).astype(float) for s in squares], held_out.drives)
    sums = by_block([np.nan_to_num(s) for s in squares], held_out.drives)
    each = np.vstack([np.ones(len(sums)), weights(len(sums))])
    drawn = ((each @ sums) / np.maximum(each @ seen, 1e-300)).sum(axis=1)
    return drawn[1:], float(drawn[0])


def colour_left(before: Sequence[DriveJudgement], after: Sequence[DriveJudgement]) -> float:
    """Return which share of their squared correlations innovations keep at most; those that are white keep nothing.

    A series that is too short, or missing, is not tested (NaN) and is no evidence against the second model.

    Args:
        before: A model on some recordings.
        after: Another one there.
    """
    earlier, later = ([w for d in drives for w in d.whiteness] for drives in (before, after))
    coloured = [(b, a) for b, a in zip(earlier, later, strict=True) if a.p_value < WHITE]
    return max((a.correlation / b.correlation for b, a in coloured), default=0.0)


class HeldOut:
    """Held-out drives.

    Args:
        augmented: The model.
        drives: The recordings.
        variances: Variance of the white noise of each output ``(ny,)``.

    Attributes:
        floor: Root mean square of the simulation error of a perfect model ``(ny,)``.
    """

    def __init__(self, augmented: AugmentedModel, drives: Sequence[DriveData], variances: Floats) -> None:
        self.augmented, self.drives, self.variances = augmented, tuple(drives), variances
        self.fitting = Fitting(augmented, drives, variances)
        self.floor = np.sqrt(floors(self.drives, variances).mean(axis=0))

    def judge(self, added: Sequence[Hypothesis], point: ParameterPoint) -> Judgement:
        """Return how a model does; only the change times are fitted to these drives."""
        here, change_times = self._own_change_times(added, moved_to(point, len(self.drives)))
        judged = judged_on(self.augmented, self.drives, self.fitting.candidates([here]))
        likelihood = sum(d.log_likelihood for d in judged) - 0.5 * change_times * np.log(self.fitting.samples)
        free = [d.simulated for d in judged]
        wander = self._wander(here)
        plain = floors(self.drives, self.variances)
        floor = plain + wander
        error, normalised_excess_mses = simulation_error(self.drives, free, floor)
        plain_excess = float(np.sum(simulation_error(self.drives, free, plain)[1]))
        density = _log_density(self.drives, free, floor)
        share = np.mean(wander / floor, axis=0)
        discrepancy = self.augmented.is_disturbed(here.values)
        return Judgement(
            likelihood, error, normalised_excess_mses, judged, here, density, share, plain_excess, discrepancy
        )

    def floors(self, point: ParameterPoint) -> Floats:
        """Return the variances of the simulation error of a perfect model ``(samples of all drives, ny)``.

        Sensors that drift leave more, as far as the model at the point says.
        """
        return floors(self.drives, self.variances) + self._wander(point)

    def _wander(self, point: ParameterPoint) -> Floats:
        """Return the variances that random processes add to that."""
        return np.concatenate([self.augmented.wander(d, point.values[:, i]) for i, d in enumerate(self.drives)])

    def _own_change_times(self, added: Sequence[Hypothesis], point: ParameterPoint) -> tuple[ParameterPoint, int]:
        """Return the point with the change times of these drives: the best of a grid, then of their neighbourhood."""
        names = tuple(dict.fromkeys(n for h in added for n in h.change_times))
        if not names:
            return point, 0
        never = point.values.copy()
        for name in names:
            never[self.augmented.row(name)] = self.augmented.model.parameters[self.augmented.row(name)].upper
        without = replace(point, values=never)
        test = ScoreTest(self.fitting, FittedHypothesis((), without, 0.0, 0.0))
        values = point.values.copy()
        for h in added:
            if h.change_times:
                values[[self.augmented.row(n) for n in h.change_times]] = test.moments_of(h).T
        point = replace(point, values=values)
        moved = tuple(c for c in coordinates(self.augmented, (), added, len(self.drives)) if c.name in names)
        return self.fitting.only(moved, point, 10).point, len(moved)


def simulation_error(drives: Sequence[DriveData], free: Sequence[Floats], floor: Floats) -> tuple[Floats, Floats]:
    """Return error and excesses of a free run, as ``Judgement`` has them.

    Every sample counts by its own floor, because the errors of inputs matter more while they change.

    Args:
        drives: The recordings.
        free: Outputs of the free run, by drive ``(samples, ny)``.
        floor: Its variances if the model is perfect ``(samples of all drives, ny)``.
    """
    errors = np.concatenate([d.measurements - f for d, f in zip(drives, free, strict=True)])
    square, normalised = _mean(errors**2), _mean(errors**2 / floor)
    strays = not all(stays(f) for f in free)
    return np.sqrt(square), np.full(len(square), np.inf) if strays else np.maximum(normalised - 1.0, 0.0)


def _log_density(drives: Sequence[DriveData], free: Sequence[Floats], floor: Floats) -> float:
    errors = np.concatenate([d.measurements - f for d, f in zip(drives, free, strict=True)])
    density = float(np.nansum(_mean(-0.5 * (np.log(floor) + errors**2 / floor))))
    return density if all(stays(f) for f in free) else -math.inf


def _mean(values: Floats) -> Floats:
    """Return the mean of the known values of every column; NaN, in silence, where a free run left its range before."""
    count = (~np.isnan(values)).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)


def floors(drives: Sequence[DriveData], variances: Floats) -> Floats:
    """Return what is left of the simulation error of a perfect model: its variances ``(samples of all drives, ny)``."""
    return np.concatenate([variances + d.spread for d in drives])
