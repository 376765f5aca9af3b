"""What is true of parameters that the estimators of a study are not sure of."""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import ModelError
from harness.config import ModelSpec
from harness.config.bounds import loading
from harness.models.assembly.parameter_states import true_states
from harness.study.design import RunParameters


def truth_names(belief: ModelSpec) -> tuple[str, ...]:
    """Return what ``parameter_truth`` gives: states of parameters, then parameters and what follows from them."""
    model = belief.model()
    return (*model.within, *model.estimated)


def parameter_truth(plant: ModelSpec, belief: ModelSpec, driven: RunParameters, believed: RunParameters) -> Floats:
    """Return the plant's parameters as the belief has them among its states, ``(len(truth_names), runs)``.

    NaN where the plant has no such parameter.
    """
    names, model = truth_names(belief), belief.model()
    found = np.full((len(names), len(driven.values)), np.nan)
    for run, (true, held) in enumerate(zip(driven.values, believed.values, strict=True)):
        of_plant, of_belief = _all(plant, true), _all(belief, held)
        known = of_plant | true_states(belief.parameter_states, of_plant, of_belief)
        found[:, run] = [known.get(name, np.nan) for name in (*model.within, *model.estimated)]
    return found


def _all(spec: ModelSpec, row: Floats) -> dict[str, float]:
    """Return parameters and, where there is one, the load that belongs to them."""
    values = dict(zip(spec.model().parameter_names, map(float, row), strict=True))
    try:
        return values | loading(spec.vehicle, values)
    except ModelError:  # lighter than without a load
        return values
