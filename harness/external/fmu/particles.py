"""Particle filter whose model is an FMU for co-simulation that lets its state be got and set, in its worker process.

The bootstrap filter of Gordon, Salmond and Smith (1993): particles differ by the process noise that the map lets act on
inputs, weigh as the sensors' noise says, and are resampled systematically where fewer than half of them count. One
instance serves all of them and is initialised once a run: the state of each is set before its step and got behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.bodies import RunEstimates
from harness.external.description import Description, ExternalParameter, Port
from harness.external.fmu.instance import Failed, Instance, Library, status_word
from harness.external.fmu.model import read_model
from harness.external.fmu.plants import compiled, references, to_signals, to_variables

SETTINGS = {"process_noise", "measurement_noise", "particles"}
"""Settings: variances per sample of the inputs that take process noise, and of what is measured, by signal in SI."""

_STATE_SLOT = np.int64


class FmuParticles:
    """A particle filter that believes in an FMU (``harness.external.bodies.EstimatorBody``).

    Args:
        path: The FMU.
        described: Of the FMU as a plant.
        ports: ``inputs``, and ``measurements`` and ``estimates``, which are outputs of it.
        settings: Those of ``SETTINGS`` that are stated.
        parameters: That a run states, by the place of its value.
        noise: Names of what is measured, by the place of the value that is its variance.

    Raises:
        UserError: If its state cannot be got and set, or nothing of it takes process noise.
    """

    def __init__(
        self,
        path: Path,
        described: Description,
        ports: Mapping[str, Sequence[Port]],
        settings: Mapping[str, Any],
        parameters: Mapping[int, ExternalParameter],
        noise: Mapping[int, str],
    ) -> None:
        where, model = f"{path}: settings", read_model(path)
        if unknown := sorted(set(settings) - SETTINGS):
            raise UserError(f"{where}: unknown key '{unknown[0]}'; there are: {', '.join(sorted(SETTINGS))}")
        if "co-simulation" not in model.keeps_state:
            raise UserError(
                f"{path}: its state cannot be got and set, which a particle filter needs (canGetAndSetFMUstate); one "
                "for model exchange takes ukf and enkf"
            )
        variances = settings.get("process_noise", {})
        names = [p.signal for p in described.disturbances]
        if not names or set(variances) - set(names):
            raise UserError(f"{where}.process_noise: the map's [process_noise] has {', '.join(names) or 'no input'}")
        self._library = Library(model, "co-simulation")
        self._instance = Instance(self._library)
        self._inputs, self._disturbances = tuple(ports["inputs"]), described.disturbances
        self._measured, self._estimated = tuple(ports["measurements"]), tuple(ports["estimates"])
        self._refs_in = references(model, (*self._inputs, *self._disturbances))
        self._refs_next = references(model, self._inputs)
        self._refs_out = references(model, (*self._measured, *self._estimated))
        self._spread = np.sqrt([float(variances.get(name, 0.0)) for name in names])
        self._stated_noise = settings.get("measurement_noise", {})
        self._parameters, self._noise = parameters, noise
        self._count = int(settings.get("particles", 64))

    def declared(self) -> dict[str, Any]:
        """Return the signals that it is given and gives."""
        groups = {"inputs": self._inputs, "measurements": self._measured, "estimates": self._estimated}
        return {**{n: [p.signal for p in each] for n, each in groups.items()}, "variances": True, "nis": False}

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured; see ``harness.external.bodies.EstimatorBody``."""
        rng, given = np.random.default_rng(seed), to_variables(inputs, self._inputs)
        estimates, variances = np.full((2, len(inputs), len(self._estimated)), np.nan)
        states, spare = np.zeros((2, self._count), _STATE_SLOT)
        k = 0
        try:
            r = self._variances(values)
            self._begin(given[0], values, states)
            weights = np.full(self._count, 1.0 / self._count)
            for k in range(len(inputs)):
                seen = self._moved(states, given, k, step, rng)
                weights = _weighted(weights, seen[:, : len(self._measured)], measurements[k], r)
                published = seen[:, len(self._measured) :]
                estimates[k] = weights @ published
                variances[k] = weights @ (published - estimates[k]) ** 2
                if 1.0 / np.sum(weights**2) < 0.5 * self._count:
                    self._resample(states, spare, weights, rng)
                    states, spare, weights = spare, states, np.full(self._count, 1.0 / self._count)
        except Failed as error:
            return RunEstimates(estimates, variances, None, k, f"{error} at t = {k * step:g} s")
        finally:
            self._free(states)
            self._free(spare)
        return RunEstimates(estimates, variances, None, len(inputs))

    def _variances(self, values: Floats) -> Floats:
        believed = {name: float(values[i]) for i, name in self._noise.items()} | dict(self._stated_noise)
        for port in self._measured:
            if port.signal not in believed:
                raise Failed(f"no variance is known of '{port.signal}'; state it in measurement_noise")
        return np.array([float(believed[port.signal]) for port in self._measured])

    def _begin(self, first: Floats, values: Floats, states: Any) -> None:
        """Initialise the instance; all particles begin in its first state."""
        library = self._library
        stated = {
            library.model.variables[p.variable].reference: (float(values[i]) - p.offset) / p.scale
            for i, p in self._parameters.items()
        }
        self._instance.begin(stated, {}, self._refs_next.tolist(), first)
        self._done("getting its state", compiled().get_states(library.addresses, self._instance.address, states))

    def _moved(self, states: Any, given: Floats, k: int, step: float, rng: np.random.Generator) -> Floats:
        """Send particles to sample ``k`` and return what they measure and publish, SI ``(particles, n)``."""
        library, ends = self._library, (max(0, k - 1) * step, k * step)
        forces = self._spread * rng.standard_normal((self._count, len(self._spread)))
        before = np.tile(given[max(0, k - 1)], (self._count, 1))
        rows = np.column_stack([before, to_variables(forces, self._disturbances)])
        outputs = np.zeros((self._count, len(self._refs_out)))
        self._done(
            "its step",
            compiled().move_particles(
                library.model.version, library.addresses, self._instance.address, ends, states, rows, self._refs_in,
                given[k], self._refs_next, self._refs_out, outputs,
            ),
        )  # fmt: skip
        if not np.isfinite(outputs).all():
            raise Failed("an output is no number")
        return to_signals(outputs, (*self._measured, *self._estimated))

    def _resample(self, states: Any, spare: Any, weights: Floats, rng: np.random.Generator) -> None:
        """Write the states of particles that are drawn by their weights into the spare ones."""
        points = (rng.random() + np.arange(self._count)) / self._count
        chosen = np.minimum(np.searchsorted(np.cumsum(weights), points), self._count - 1)
        library = self._library
        self._done(
            "setting its state",
            compiled().copy_states(library.addresses, self._instance.address, states[chosen], spare),
        )

    def _free(self, states: Any) -> None:
        if self._instance.is_there:
            compiled().free_states(self._library.addresses, self._instance.address, states)

    def _done(self, what: str, status: int) -> None:
        if status > 1:
            self._instance.discard()
            raise Failed(self._library.words(f"{what} returned {status_word(int(status))}"))


def _weighted(weights: Floats, seen: Floats, measured: Floats, r: Floats) -> Floats:
    """Return the weights behind a measurement, NaN where missing, whose noise is normal with variances ``r``."""
    there = ~np.isnan(measured)
    if not there.any():
        return weights
    with np.errstate(divide="ignore"):
        logs = np.log(weights) - 0.5 * np.sum((seen[:, there] - measured[there]) ** 2 / r[there], axis=1)
    heavier = np.exp(logs - logs.max())
    return np.asarray(heavier / heavier.sum())
