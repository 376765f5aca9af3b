"""Put a network to work on a model: find its signals there, and write it as the numbers its kernel reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.common.errors import UserError
from harness.common.registry import closest
from harness.engine.compile import CompiledModel
from harness.estimation.narx.network import Network

MEMORY = 64
"""Longest regressor the estimator has memory for."""

WIDTH = 128
"""Widest layer the estimator has room for (as in its ``workspace``)."""


def placed(network: Network, compiled: CompiledModel, path: Path) -> list[float]:
    """Return the numbers for the kernel of ``harness/estimation/methods/narx.py``, which says their order.

    Args:
        network: The network.
        compiled: What the estimator believes.
        path: Named in errors.

    Raises:
        UserError: If the model lacks a signal of the network or has another step, or the network is too large.
    """
    model = compiled.model
    numbers: list[float] = [
        network.input_delays,
        network.output_delays,
        len(network.inputs),
        len(network.outputs),
        len(network.layers),
    ]
    for name, (lower, upper) in zip(network.inputs, network.input_range, strict=True):
        measured, known = list(model.outputs), list(model.inputs)
        if name not in measured and name not in known:
            raise UserError(
                f"{path}: the network reads '{name}', which the belief neither measures nor knows"
                f"{closest(name, [*measured, *known])}; choose other sensors, or train a network for these"
            )
        place = measured.index(name) if name in measured else known.index(name)
        numbers += [float(name in measured), place, 0.5 * (lower + upper), 0.5 * (upper - lower)]
    for name, (lower, upper) in zip(network.outputs, network.output_range, strict=True):
        if name not in model.states:
            raise UserError(
                f"{path}: the network gives '{name}', which is no state of '{model.name}'"
                f"{closest(name, list(model.states))}; choose a network trained for this vehicle"
            )
        numbers += [list(model.states).index(name), 0.5 * (lower + upper), 0.5 * (upper - lower)]
    if abs(network.step - compiled.step_size) > 1e-9 * network.step:
        raise UserError(
            f"{path}: the network was trained for samples every {network.step:g} s, the study has "
            f"{compiled.step_size:g} s; train one for this step"
        )
    if network.sizes[0] > MEMORY or max(network.sizes) > WIDTH:
        raise UserError(
            f"{path}: {network.sizes[0]} delayed values and {max(network.sizes[1:])} neurons in a layer are too many; "
            f"the estimator has room for {MEMORY} and {WIDTH}"
        )
    return [*numbers, *network.sizes, *np.asarray(network.parameters)]
