"""Effect of a remedy on the errors of a study, and the choice of the remedy that is worth it.

Bounds say beforehand what can be known of the parameters that drive the error, and of the targets with these unknown.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common import statistics
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import DesignSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.estimation.information import parameter_information
from harness.models.quantities import Quantity, quantity
from harness.remedy import choices
from harness.remedy.choices import Equipment, Remedy
from harness.simulation.drives import profile_of
from harness.study.bound import smallest_rmse
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.report.ranking import tolerances
from harness.study.results import Design, StudyResults
from harness.study.tolerance import Tolerance

HELPS = 0.8
"""A remedy helps if it leaves at most this share of the error at the worst level."""

ALIKE = 1.1
"""Up to this ratio two remedies are worth the same, and the one that needs less is chosen."""


_NO_ROOM = 1e-6
"""Size that boxes together have at least, so that what makes one from nothing is put in order by how large it is."""


@dataclass(frozen=True)
class RemedyOutcome:
    """What came of a remedy.

    Attributes:
        remedy: What was done.
        study: The study that did it.
        targets: Those of the study as it is.
        levels: Labels of the levels or bands.
        medians: Median RMSE in report units ``(target, level)``; a lost run counts as infinitely wrong. Runs in which
            the vehicle itself left the range of its model count here as nowhere but in the boxes, being nobody's.
        home: Level at which the vehicle is as believed; ``None`` if there is none.
        nominal: Median RMSE there, or at the nominal point of a tolerance design ``(target,)``; NaN if there is none.
        worst: Largest RMSE of any run ``(target,)``, infinite if one was lost.
        lost: Share of the runs that the estimator lost.
        nees: Median over the runs of the average NEES over its expectation; NaN without one.
        consistent: Share of the runs whose average NEES is below the upper 95 % bound of a single run.
        boxes: What it tolerates by target, where the study asks for it.
        states: Number of states.
        step_time: s that a step of a run takes in lanes.
    """

    remedy: Remedy
    study: StudySpec
    targets: list[Quantity]
    levels: list[str]
    medians: Floats
    home: int | None
    nominal: Floats
    worst: Floats
    lost: float
    nees: float
    consistent: float
    boxes: dict[int, Tolerance]
    states: int
    step_time: float


def judged(remedy: Remedy, study: StudySpec, results: StudyResults, step_time: float) -> RemedyOutcome:
    """Return what came of a remedy by the results of its study."""
    design = results.designs[0]
    wanted = [t for t, q in enumerate(design.targets) if q.name not in study.belief.estimated_parameters]
    compared = design.compared()
    errors = design.errors[wanted, :, 0]
    medians = _median(errors.reshape(*errors.shape[:2], -1))
    nested = next((d for d in results.designs if d.sampling == "tolerance"), None)
    nominal = np.full(len(wanted), np.nan) if design.matched is None else medians[:, design.matched]
    boxes: dict[int, Tolerance] = {}
    if nested is not None:
        boxes = {t: tolerance for (t, _), tolerance in tolerances(nested, study.limits).items() if t in wanted}
        if design.matched is None:
            nominal = _median(nested.errors[wanted, 0, 0, :, 0].reshape(len(wanted), -1))
    nees, consistent = _consistency(design)
    return RemedyOutcome(
        remedy=remedy,
        study=study,
        targets=[design.targets[t] for t in wanted],
        levels=[design.whole] if design.whole else design.bands,
        medians=medians,
        home=design.matched,
        nominal=nominal,
        worst=np.nanmax(errors, axis=(1, 2, 3, 4)) if compared else np.full(len(wanted), np.inf),
        lost=design.diverged(0) / compared if compared else 1.0,
        nees=nees,
        consistent=consistent,
        boxes=boxes,
        states=len(study.belief.model().states),
        step_time=step_time,
    )


def _median(errors: Floats) -> Floats:
    """Return the median over the last axis of what is there; infinite where nothing is."""
    nothing = np.isnan(errors).all(axis=-1, keepdims=True)
    medians: Floats = np.nanmedian(np.where(nothing, np.inf, errors), axis=-1)
    return medians


def _consistency(design: Design) -> tuple[float, float]:
    averages = design.per_run("nees")
    finite = averages[np.isfinite(averages)]
    if not finite.size or design.state_dimension < 1:
        return float("nan"), float("nan")
    highest = statistics.average_bounds(design.state_dimension, 1.0)[1]
    return float(np.median(finite)) / design.state_dimension, float(np.mean(finite <= highest))


def harm(outcome: RemedyOutcome, first: RemedyOutcome) -> float:
    """Return how bad a remedy leaves things, one number to put remedies in order by: 1 for the study as it is.

    Where the study asks for tolerance boxes, the sum of their sizes as it is over that with the remedy. Else the error
    at the worst level over that as it is, of the target for which this is largest.
    """
    if outcome.boxes and first.boxes:
        return max(_room(first), _NO_ROOM) / max(_room(outcome), _NO_ROOM)
    return float(np.max(outcome.medians.max(axis=1) / first.medians.max(axis=1)))


def _room(outcome: RemedyOutcome) -> float:
    """Return the sizes of the boxes together; the median reach decides between boxes that are zero."""
    return sum(b.box + 1e-3 * b.typical for b in outcome.boxes.values())


def best(outcomes: Sequence[RemedyOutcome], first: RemedyOutcome) -> RemedyOutcome:
    """Return the remedy to take: the least harm; of those about as good, the one that needs least."""
    harms = [harm(o, first) for o in outcomes]
    good = [o for o, h in zip(outcomes, harms, strict=True) if h <= ALIKE * min(harms)]
    return min(good, key=lambda o: (len(o.remedy.added), len(o.remedy.estimated + o.remedy.banked), harm(o, first)))


def helps(outcome: RemedyOutcome, first: RemedyOutcome) -> bool:
    """Whether a remedy makes things better."""
    return outcome is not first and harm(outcome, first) <= HELPS


def without_sensor(outcomes: Sequence[RemedyOutcome]) -> list[RemedyOutcome]:
    """Return the outcomes of what needs no further sensor."""
    return [o for o in outcomes if not o.remedy.added]


def nominal_cost(outcome: RemedyOutcome, first: RemedyOutcome) -> float:
    """Return the error where the vehicle is as believed over that as it is, of the target for which it is largest."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = outcome.nominal / first.nominal
    return float(np.max(ratios)) if np.isfinite(ratios).any() else float("nan")


@dataclass(frozen=True)
class Promise:
    """What an equipment promises, the parameters being as unknown as a study varies them.

    Attributes:
        remaining: Share of the first deviation that is left of each parameter at best after each drive
            ``(drive, parameter)``.
        smallest: Smallest RMSE of each target along each drive, in report units ``(drive, target)``.
    """

    remaining: Floats
    smallest: Floats

    @property
    def share(self) -> float:
        """What is left of the parameters: the geometric mean over them, in the median over drives."""
        return float(np.median(np.exp(np.mean(np.log(np.maximum(self.remaining, 1e-12)), axis=1))))


def promises(
    study: StudySpec, estimator: str, drivers: Sequence[str], equipments: Iterable[Equipment]
) -> tuple[dict[Equipment | None, Promise], dict[str, str]]:
    """Return what could be known at best, by equipment, and which of these are not possible, with the reason.

    Args:
        study: The study as it is.
        estimator: Name of its estimator.
        drivers: Parameters that drive the error.
        equipments: Larger ones; ``None``, the study's own, is always asked about.
    """
    promised: dict[Equipment | None, Promise] = {}
    impossible: dict[str, str] = {}
    for equipment in (None, *equipments):
        remedy = Remedy(estimated=tuple(drivers), equipment=equipment)
        try:
            changed = choices.applied(study, remedy, estimator)
        except UserError as error:
            impossible[remedy.words] = str(error)
            continue
        promised[equipment] = Promise(remaining_shares(changed, drivers), _smallest(changed))
    return promised, impossible


def remaining_shares(study: StudySpec, drivers: Sequence[str]) -> Floats:
    """Return the share of the first deviation that is left of each parameter at best after each drive.

    Args:
        study: Its belief has the parameters among its states.
        drivers: The parameters.

    Returns:
        ``(drive, parameter)``.
    """
    first = {s.name: s.prior for s in study.belief.parameter_states}
    rows = []
    for drive in study.drives:
        std = parameter_information(study.belief, profile_of(study.plant, drive))["std"]
        rows.append([float(std.sel(parameter=n)[-1]) / first[n] for n in drivers])
    return np.array(rows)


def _smallest(study: StudySpec) -> Floats:
    """Return the posterior Cramer-Rao bound along the drives of the vehicle as it is before anything is varied."""
    nominal = replace(study, designs=(DesignSpec("nominal", (), repeats=LANES),), history=(), over_time=None)
    evaluator = StudyEvaluator(nominal)
    wanted = [i for i, t in enumerate(study.targets) if t not in study.belief.estimated_parameters]
    scale = np.array([quantity(study.targets[i]).scale for i in wanted])
    rows = [smallest_rmse(evaluator, Unit(0, 0, d, 0, 1))[wanted] * scale for d in range(len(study.drives))]
    return np.array(rows)
