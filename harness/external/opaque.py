"""A plant without equations as a model: names, units and bounds, for all that asks a plant what it has."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from harness.external.description import Description
from harness.models.assembly.model import StateSpaceModel, symbol
from harness.models.contracts import Parameter


def opaque_model(description: Description, sensors: Mapping[str, str]) -> StateSpaceModel:
    """Return what a plant publishes, as a model that cannot be compiled.

    Args:
        description: Of the plant.
        sensors: Signals that are measured, by output.

    Returns:
        Its states are the disturbances, which take process noise; its ports are the outputs.
    """
    inputs = tuple(p.signal for p in description.inputs)
    states = tuple(p.signal for p in description.disturbances)
    return StateSpaceModel(
        name=description.file,
        states=states,
        inputs=inputs,
        parameters=tuple(
            Parameter(p.name, p.name, p.unit, p.lower, p.upper, p.meaning or p.variable) for p in description.parameters
        ),
        ports={p.signal: symbol(p.signal) for p in description.outputs if p.signal not in inputs},
        derivatives=(sp.Integer(0),) * len(states),
        outputs={output: symbol(signal) for output, signal in sensors.items()},
        valid={},
        rates={name: name.removesuffix("_rate") for name in inputs if name.endswith("_rate")},
        opaque=True,
    )
