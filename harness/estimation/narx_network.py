"""The network: its equations, its parameters as one vector, its first weights, its file.

A NARX network computes the outputs of a sample from delayed inputs and its own delayed outputs (Ziaukas 2023, 3.1 to
3.4). Inside everything is scaled to [-1, 1] by smallest and largest value of the training data.

The layers are matrices ``(to, from + 1)`` whose last column is the bias; the parameter vector is their
concatenation, row by row. The regressor is ordered ``i(k-1), i(k-2), ..., t(k-1), t(k-2), ...`` with all inputs (then
all outputs) of one delay side by side.
"""

from __future__ import annotations

import itertools
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import locations, places
from harness.common.arrays import Floats
from harness.common.errors import MissingFileError, UserError
from harness.common.files import refuse_damaged

_KEYS = ("inputs", "outputs", "input_delays", "output_delays", "step")


@dataclass(frozen=True)
class Network:
    """A NARX network.

    Attributes:
        inputs: Signals it reads.
        outputs: Signals it gives.
        input_delays: How many past samples of the inputs it sees.
        output_delays: How many past samples of its outputs are fed back.
        step: Sample time in s.
        layers: Matrices ``(to, from + 1)``, the last column the bias; ``tanh`` in all but the last, which is linear.
        input_range: Smallest and largest value of each input in the training data, ``(inputs, 2)``.
        output_range: The same of each output, ``(outputs, 2)``.
        made: How it was made: command, seed, errors; any keys.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_delays: int
    output_delays: int
    step: float
    layers: tuple[Floats, ...]
    input_range: Floats
    output_range: Floats
    made: Mapping[str, Any] = field(default_factory=dict)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Lengths of regressor, hidden layers and output."""
        return (self.layers[0].shape[1] - 1, *(len(w) for w in self.layers))

    @property
    def delay(self) -> int:
        """Samples that must be known before the first output."""
        return max(self.input_delays, self.output_delays)

    @property
    def parameters(self) -> Floats:
        """All weights and biases as one vector."""
        return np.concatenate([w.ravel() for w in self.layers])

    def with_parameters(self, parameters: Floats) -> Network:
        """Return the same network with other weights and biases."""
        return replace(self, layers=unpack(parameters, self.sizes))

    def regressors(self, inputs: Floats, outputs: Floats) -> Floats:
        """Return the regressors of all samples from ``delay`` on, ``(samples - delay, regressor)``, all scaled.

        Args:
            inputs: Scaled, ``(samples, inputs)``.
            outputs: Scaled, ``(samples, outputs)``.

        Raises:
            UserError: If there are too few samples for the delays.
        """
        n, d = len(inputs), self.delay
        if n <= d:
            raise UserError(f"{n} samples are too few for a network with delays of {d} samples; give more than {d}")
        past = [inputs[d - m : n - m] for m in range(1, self.input_delays + 1)]
        past += [outputs[d - m : n - m] for m in range(1, self.output_delays + 1)]
        return np.concatenate(past, axis=1)

    def free_run(self, inputs: Floats, first: Floats | None = None) -> Floats:
        """Let the network run on its own outputs.

        Args:
            inputs: Physical, ``(samples, inputs)``.
            first: Outputs held until the delays are filled, ``(outputs,)``; by default 0.

        Returns:
            Outputs, physical, ``(samples, outputs)``.

        Raises:
            UserError: If there are too few samples for the delays.
        """
        z, d = scaled(inputs, self.input_range), self.delay
        if len(z) <= d:
            raise UserError(f"{len(z)} samples are too few for a network with delays of {d} samples")
        y = np.empty((len(z), len(self.outputs)))
        y[:d] = scaled(np.zeros(len(self.outputs)) if first is None else first, self.output_range)
        for k in range(d, len(z)):
            past = [z[k - m] for m in range(1, self.input_delays + 1)]
            past += [y[k - m] for m in range(1, self.output_delays + 1)]
            y[k] = forward(self.layers, np.concatenate(past)[None])[-1][0]
        return unscaled(y, self.output_range)


def scaled(values: Floats, limits: Floats) -> Floats:
    """Map the range of each signal onto [-1, 1]; signals in the last axis."""
    return (values - limits.mean(axis=1)) / (0.5 * np.ptp(limits, axis=1))


def unscaled(values: Floats, limits: Floats) -> Floats:
    """Undo ``scaled``."""
    return limits.mean(axis=1) + 0.5 * np.ptp(limits, axis=1) * values


def forward(layers: Sequence[Floats], x: Floats) -> list[Floats]:
    """Return the activations of every layer, the outputs last, each ``(samples, to)`` (3.2 to 3.4)."""
    activations, a = [], x
    for index, w in enumerate(layers):
        a = a @ w[:, :-1].T + w[:, -1]
        if index < len(layers) - 1:
            a = np.tanh(a)
        activations.append(a)
    return activations


def unpack(parameters: Floats, sizes: Sequence[int]) -> tuple[Floats, ...]:
    """Split a parameter vector into the layers' matrices."""
    layers, start = [], 0
    for n_from, n_to in itertools.pairwise(sizes):
        stop = start + n_to * (n_from + 1)
        layers.append(parameters[start:stop].reshape(n_to, n_from + 1).copy())
        start = stop
    return tuple(layers)


def nguyen_widrow(sizes: Sequence[int], rng: np.random.Generator) -> Floats:
    """Return first parameters after Nguyen and Widrow (1990): the neurons' active regions cover [-1, 1] evenly.

    Each hidden neuron gets a random direction of length ``0.7 to^(1/from)`` and the biases are spread evenly over
    plus and minus that length, with the sign of the neuron's first weight. The linear output begins small and random.

    Args:
        sizes: Lengths of regressor, hidden layers and output.
        rng: Source of randomness.
    """
    layers = []
    for n_from, n_to in itertools.pairwise(sizes[:-1]):
        beta = 0.7 * n_to ** (1.0 / n_from)
        directions = rng.uniform(-1, 1, (n_to, n_from))
        directions *= beta / np.linalg.norm(directions, axis=1, keepdims=True)
        spread = beta * np.linspace(-1, 1, n_to) if n_to > 1 else np.zeros(1)
        layers.append(np.column_stack([directions, spread * np.sign(directions[:, 0])]))
    layers.append(rng.uniform(-0.5, 0.5, (sizes[-1], sizes[-2] + 1)))
    return np.concatenate([w.ravel() for w in layers])


def save(network: Network, path: Path) -> Path:
    """Write a network as ``.npz`` of plain arrays and one JSON text, and return the path."""
    described = {
        "inputs": network.inputs,
        "outputs": network.outputs,
        "input_delays": network.input_delays,
        "output_delays": network.output_delays,
        "step": network.step,
        "made": network.made,
    }
    arrays: dict[str, Any] = {f"layer_{i}": w for i, w in enumerate(network.layers)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with places.unfinished(path) as stream:
            np.savez(
                stream,
                allow_pickle=False,
                description=np.array(json.dumps(described, indent=1)),
                input_range=network.input_range,
                output_range=network.output_range,
                **arrays,
            )
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror}") from None
    return path


def find(name: str, folder: Path = Path()) -> Path:
    """Return the file of a network: a name (``harness.common.locations``), or a path, tried in ``folder`` first.

    Raises:
        UserError: If there is none.
    """
    if not name.endswith(".npz"):
        try:
            return locations.find(locations.NETWORKS, name)
        except UserError as error:
            raise UserError(f"{error}; or give the path of an .npz file") from None
    candidates = (folder / name, Path(name))
    network = next((path for path in candidates if path.is_file()), None)
    if network is None:
        raise MissingFileError(f"there is no network file {' or '.join(dict.fromkeys(str(p) for p in candidates))}")
    return network


def load(path: Path) -> Network:
    """Read a network.

    Raises:
        UserError: If the file is no ``.npz``, holds pickled objects, lacks an array, or its arrays do not belong
            together.
    """
    again = "write it with python -m reproductions.narx_training"
    if not path.is_file():
        raise MissingFileError(f"{path}: there is no such file")
    not_plain = UserError(f"{path}: not an .npz file of plain arrays; pickled objects are refused; {again}")
    if not zipfile.is_zipfile(path):
        raise not_plain
    with refuse_damaged(path, "network", again), np.load(path, allow_pickle=False) as file:
        try:
            arrays = {name: np.asarray(file[name]) for name in file.files}
        except ValueError as error:
            if "pickle" in str(error):  # NumPy goes on to say how to run what is in there
                raise not_plain from None
            raise
    count = sum(name.startswith("layer_") for name in arrays)
    expected = ["description", "input_range", "output_range", *(f"layer_{i}" for i in range(max(count, 1)))]
    missing = [name for name in expected if name not in arrays]
    if missing:
        raise UserError(f"{path}: array '{missing[0]}' is missing; {again}")
    described = _described(arrays["description"], path, again)
    network = Network(
        tuple(described["inputs"]),
        tuple(described["outputs"]),
        described["input_delays"],
        described["output_delays"],
        float(described["step"]),
        tuple(arrays[f"layer_{i}"] for i in range(count)),
        arrays["input_range"],
        arrays["output_range"],
        described.get("made", {}),
    )
    wrong = _misfit(network)
    if wrong:
        raise UserError(f"{path}: {wrong}; {again}")
    return network


def _described(array: np.ndarray[Any, Any], path: Path, again: str) -> dict[str, Any]:
    """Return what a network says of itself, its entries of the types that they must have.

    Raises:
        UserError: If it is no JSON, lacks an entry, or one is of another type.
    """
    try:
        described = json.loads(str(array))
    except (json.JSONDecodeError, RecursionError, ValueError) as error:
        raise UserError(f"{path}: 'description' is not JSON ({error}); {again}") from None
    if not isinstance(described, dict):
        raise UserError(f"{path}: 'description' is no table; {again}")
    for key in _KEYS:
        value = described.get(key)
        names = isinstance(value, list) and all(isinstance(name, str) for name in value)
        whole = isinstance(value, int) and not isinstance(value, bool)
        if key not in described:
            raise UserError(f"{path}: 'description' lacks '{key}'; {again}")
        if not (names if key in ("inputs", "outputs") else whole or (key == "step" and isinstance(value, float))):
            raise UserError(f"{path}: '{key}' of 'description' is {value!r}; {again}")
    return described


def _misfit(network: Network) -> str:
    """Return what does not belong together in a network, or nothing."""
    if min(network.input_delays, network.output_delays) < 1 or not network.step > 0:
        return "delays and step must be positive"
    for name, limits, signals in (
        ("input_range", network.input_range, network.inputs),
        ("output_range", network.output_range, network.outputs),
    ):
        if limits.dtype != np.float64 or limits.shape != (len(signals), 2):
            return f"'{name}' has shape {limits.shape}, not {(len(signals), 2)} for {', '.join(signals)}"
        if not (np.ptp(limits, axis=1) > 0).all():
            return f"'{name}' is empty or not a number"
    width = network.input_delays * len(network.inputs) + network.output_delays * len(network.outputs)
    for i, w in enumerate(network.layers):
        if w.dtype != np.float64 or w.ndim != 2 or w.shape[1] != width + 1:
            return f"'layer_{i}' has shape {w.shape}, but {width + 1} columns are needed"
        if not np.isfinite(w).all():
            return f"'layer_{i}' holds numbers that are not finite"
        width = len(w)
    if width != len(network.outputs):
        return f"the last layer gives {width} outputs, not {len(network.outputs)}"
    return ""
