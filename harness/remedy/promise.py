"""Bounds on what can be known: of the parameters that drive the error, and of the targets with these unknown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import DesignSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.estimation.information import parameter_information
from harness.models.quantities import quantity
from harness.remedy import choices
from harness.remedy.choices import Equipment, Remedy
from harness.simulation.drives import profile_of
from harness.study.bound import smallest_rmse
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator


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
        promised[equipment] = Promise(_remaining(changed, drivers), _smallest(changed))
    return promised, impossible


def _remaining(study: StudySpec, drivers: Sequence[str]) -> Floats:
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
