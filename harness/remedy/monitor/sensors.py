"""Which sensors could show an error that the innovations do not: what measurements tell of the parameter behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.errors import ModelError, UserError
from harness.config import StudySpec
from harness.remedy import choices
from harness.remedy.choices import Equipment, Remedy
from harness.remedy.judge import remaining_shares

LITTLE = 0.5
"""Share of the deviation that may remain at the end of a drive where measurements tell of a parameter."""


@dataclass(frozen=True)
class ParameterInformation:
    """What a drive tells of a parameter at best, in the median over drives.

    Attributes:
        parameter: The parameter.
        own: Share of its deviation that the study's own sensors leave.
        others: Share that others leave, by what these measure, the least first.
    """

    parameter: str
    own: float
    others: dict[str, float]


def parameter_information(study: StudySpec, estimator: str) -> list[ParameterInformation]:
    """Return what measurements tell of each parameter that the first design varies, from the Fisher information.

    No statistic of the innovations tells more of it: they are a function of the same measurements.
    """
    results = []
    for factor in choices.parameters(study):
        shares: dict[str, float] = {}
        own = None
        larger = [e for e in choices.equipments(study) if not set(e.added) & set(study.targets)]
        for equipment in (None, *larger):
            share = _share(study, estimator, factor.parameter, equipment)
            if share is None:
                continue
            if equipment is None:
                own = share
            else:
                shares[Remedy(equipment=equipment).measures] = share
        if own is not None:
            better = {k: v for k, v in sorted(shares.items(), key=lambda item: item[1]) if v < min(LITTLE, 0.9 * own)}
            results.append(ParameterInformation(factor.parameter, own, better))
    return results


def _share(study: StudySpec, estimator: str, parameter: str, equipment: Equipment | None) -> float | None:
    """Return the share that an equipment leaves; ``None`` where it is not possible."""
    try:
        changed = choices.applied(study, Remedy(estimated=(parameter,), equipment=equipment), estimator)
        return float(np.median(remaining_shares(changed, [parameter])))
    except (UserError, ModelError):
        return None
