"""NARX network: trained on drives, runs on its own outputs, uses no equations (Ziaukas 2023, ch. 3 and 5.2).

From past samples of the measured and known inputs and of its own outputs it computes the outputs of this sample
(3.1 to 3.4). It takes nothing from the belief but the places of its signals: parameters and noise are what it was
trained on. It states no covariance. Until its delays are filled the estimate stays at the first mean; a missing
measurement is replaced by the last one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.common.errors import UserError
from harness.common.registry import closest
from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import LANES, NX, NY, get, is_nan, put, select, splat, tanh
from harness.estimation.narx_network import Network, find, load


class Settings(BaseModel):
    """Which network runs."""

    model_config = ConfigDict(extra="forbid")

    network: str = Field(
        "semitrailer_24t", min_length=1, description="name in harness/estimation/networks, or path of an .npz file"
    )


HAS_COVARIANCE = False
DEVICES = ("cuda",)

MEMORY = 64
"""Longest regressor the estimator has memory for."""

WIDTH = 128
"""Widest layer the estimator has room for (as in its ``workspace``)."""


def fit(settings: Settings, compiled: CompiledModel, folder: Path) -> list[float]:
    """Return the network as numbers for the kernel, and where the model has its signals."""
    path = find(settings.network, folder)
    return placed(load(path), compiled, path)


def placed(network: Network, compiled: CompiledModel, path: Path) -> list[float]:
    """Return a network as the numbers that the kernel reads, which find its signals in a model.

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
        measured, given = list(model.outputs), list(model.inputs)
        if name not in measured and name not in given:
            raise UserError(
                f"{path}: the network reads '{name}', which the belief neither measures nor knows"
                f"{closest(name, [*measured, *given])}; choose other sensors, or train a network for these"
            )
        place = measured.index(name) if name in measured else given.index(name)
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


def estimates(settings: Settings, folder: Path) -> tuple[str, ...]:
    """Return the signals that the network gives."""
    return load(find(settings.network, folder)).outputs


def files(settings: Settings, folder: Path) -> tuple[Path, ...]:
    """Return the network's file."""
    return (find(settings.network, folder),)


def memory_size(settings: BaseModel, compiled: CompiledModel) -> int:
    """Return the rows of memory: how many samples the delays hold, then the regressor."""
    return 1 + MEMORY


def workspace():
    """Return the scratch arrays of a run: activations of the layer below and of this one."""
    return np.empty((128, LANES)), np.empty((128, LANES))


def weighted_sums(t, w, inputs, neurons, below, above):
    """Write what enters the neurons of a layer, bias included, from the outputs of the layer below.

    Four neurons at once: the terms of one sum wait for each other. Behind the last neuron it is computed again.

    Args:
        t: Numbers of the network; the matrix of the layer begins at ``w``, row by row with the bias last.
        w: Where it begins.
        inputs: Neurons of the layer below.
        neurons: Of this one.
        below: Their outputs, at least ``(inputs, LANES)``.
        above: Written, at least ``(neurons, LANES)``.
    """
    for j in range(0, neurons, 4):
        k, m, n = min(j + 1, neurons - 1), min(j + 2, neurons - 1), min(j + 3, neurons - 1)
        row_j, row_k, row_m, row_n = (
            w + j * (inputs + 1), w + k * (inputs + 1), w + m * (inputs + 1), w + n * (inputs + 1)
        )  # fmt: skip
        a, b, c, d = (
            splat(t[row_j + inputs]),
            splat(t[row_k + inputs]),
            splat(t[row_m + inputs]),
            splat(t[row_n + inputs]),
        )
        for i in range(inputs):
            x = get(below, i)
            a, b, c, d = a + t[row_j + i] * x, b + t[row_k + i] * x, c + t[row_m + i] * x, d + t[row_n + i] * x
        put(a, above, j)
        put(b, above, k)
        put(c, above, m)
        put(d, above, n)


def activate(t, start, layers, below, above):
    """Write the outputs for the regressor in ``below`` over it (3.2 to 3.4).

    ``t[start:]`` holds the lengths of all layers and then their matrices row by row, the bias last in each row.
    """
    w = start + layers + 1
    for layer in range(layers):
        n_from, n_to = int(t[start + layer]), int(t[start + layer + 1])
        weighted_sums(t, w, n_from, n_to, below, above)
        w += n_to * (n_from + 1)
        for j in range(n_to):
            put(tanh(get(above, j)) if layer < layers - 1 else get(above, j), below, j)


def step(before, u_before, u, y, belief, work, after, info):
    """Compute the outputs of this sample from the delays, then put this sample into them.

    Tuning: delays and numbers of inputs and outputs, layers; per input whether it is measured, its place, offset and
    gain of its scaling; per output its state, offset and gain; lengths and matrices of the layers. Memory: samples
    seen (held back until the first measurement), then the regressor of the next sample, newest first.
    """
    below, above = work
    t = belief.tuning
    n_id, n_fd, n_in, n_out, layers = int(t[0]), int(t[1]), int(t[2]), int(t[3]), int(t[4])
    seen, first_out = get(before.memory, 0), 1 + n_id * n_in
    regressor = n_id * n_in + n_fd * n_out
    for i in range(regressor):
        put(get(before.memory, 1 + i), below, i)
    activate(t, 5 + 4 * n_in + 3 * n_out, layers, below, above)
    for i in range(NX):
        put(splat(0.0), after.mean, i)
    filled = seen >= 1.0 * max(n_id, n_fd)
    for m in range(n_id - 1, 0, -1):
        for i in range(n_in):
            put(get(before.memory, 1 + (m - 1) * n_in + i), after.memory, 1 + m * n_in + i)
    for m in range(n_fd - 1, 0, -1):
        for o in range(n_out):
            put(get(before.memory, first_out + (m - 1) * n_out + o), after.memory, first_out + m * n_out + o)
    for o in range(n_out):
        at = 5 + 4 * n_in + 3 * o
        state, offset, gain = int(t[at]), t[at + 1], t[at + 2]
        held = (get(before.mean, state) - offset) / gain
        value = select(filled, get(below, o), held)
        put(value, after.memory, first_out + o)
        put(select(filled, offset + gain * value, get(before.mean, state)), after.mean, state)
    measured = splat(1.0)
    for i in range(n_in):
        at = 5 + 4 * i
        place, offset, gain = int(t[at + 1]), t[at + 2], t[at + 3]
        raw = get(y, place) if t[at] > 0.5 else get(u, place)
        missing = is_nan(raw)
        measured = select(missing & (seen == 0.0), 0.0, measured)
        put(select(missing, get(before.memory, 1 + i), (raw - offset) / gain), after.memory, 1 + i)
    put(seen + measured, after.memory, 0)
    used = splat(0.0)
    for i in range(NY):
        used = used + select(is_nan(get(y, i)), 0.0, 1.0)
        put(splat(np.nan), info.innovation, i)
        for j in range(NY):
            put(splat(np.nan), info.innovation_covariance, i, j)
    put(used, info.seen, 0)
    put(splat(np.nan), info.nis, 0)
    put(splat(0.0), info.log_likelihood, 0)
    put(splat(0.0), info.repairs, 0)


def write_covariance(state, work):
    """State no covariance."""
    for i in range(NX):
        for j in range(NX):
            put(splat(np.nan), state.covariance, i, j)
