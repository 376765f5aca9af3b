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


Shares = dict[tuple[str, Equipment | None], float]
"""Share of its deviation that an equipment leaves of a parameter: of a study, the same for all of its estimators."""


def parameter_information(study: StudySpec, estimator: str, computed: Shares) -> list[ParameterInformation]:
    """Return what measurements tell of each parameter that the first design varies, from the Fisher information.

    No statistic of the innovations tells more of it: they are a function of the same measurements.

    Args:
        study: The study.
        estimator: Name of one that has to be able to estimate the parameter.
        computed: Shares of this study that are there already; those that are not are added.
    """
    results = []
    for factor in choices.parameters(study):
        shares: dict[str, float] = {}
        own = None
        larger = [e for e in choices.equipments(study) if not set(e.added) & set(study.targets)]
        for equipment in (None, *larger):
            share = _share(study, estimator, factor.parameter, equipment, computed)
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


def _share(
    study: StudySpec, estimator: str, parameter: str, equipment: Equipment | None, computed: Shares
) -> float | None:
    """Return the share that an equipment leaves; ``None`` where it is not possible."""
    try:
        changed = choices.applied(study, Remedy(estimated=(parameter,), equipment=equipment), estimator)
        if (parameter, equipment) not in computed:
            computed[parameter, equipment] = float(np.median(remaining_shares(changed, [parameter])))
        return computed[parameter, equipment]
    except (UserError, ModelError):
        return None
