"""Readings of degraded sensors: what the degradations of a plant make of the measurements of simulated runs.

The random numbers of a run follow from its noise alone: they are the same however runs are grouped and whatever else
degrades its sensors, and with other values of a parameter.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr

from harness.common.arrays import Floats
from harness.common.components import place_of
from harness.common.errors import UserError, closest
from harness.engine.standard_normal import seed_words, standard_normal
from harness.models.assembly.degradation import parameter_of
from harness.models.assembly.model import StateSpaceModel
from harness.models.assembly.placement import load_effect
from harness.models.contracts import Readings
from harness.runner.contract import Held


def degrade(model: StateSpaceModel, measurements: Floats, held: Held, noise: Floats, step: float) -> None:
    """Change measurements of simulated runs in place to what degraded sensors read.

    Args:
        model: The plant, ``degradations`` of which act.
        measurements: ``(..., samples, ny, LANES)``, with their noise.
        held: What the plant holds.
        noise: Standard normal numbers of the runs, those of the outputs last ``(..., samples, n, LANES)``.
        step: Sample time in s.
    """
    if not model.degradations:
        return
    keys = np.ascontiguousarray(noise[..., 0, -1, :]).reshape(-1, 1).view(np.uint64)
    for name, output in model.degradations:
        row = list(model.outputs).index(output)
        deviation = np.sqrt(held.measurement_noise[..., row, None, :])
        white = deviation * noise[..., row - len(model.outputs), :]
        readings = _SimulatedReadings(
            measurements[..., row, :].copy(), white, deviation, step, model, held.values, name, output, keys
        )
        measurements[..., row, :] = _degraded(load_effect(name), readings)


def _degraded(file: ModuleType, readings: Readings) -> Floats:
    """Return what a degradation makes of readings.

    Raises:
        UserError: If it is not one number for each.
    """
    degraded = file.degrade(readings)
    if not isinstance(degraded, np.ndarray) or degraded.shape != readings.values.shape:
        got = f"the shape {degraded.shape}" if isinstance(degraded, np.ndarray) else type(degraded).__name__
        raise UserError(
            f"{place_of(file)}: degrade(readings) returns {got} in place of an array of the shape of readings.values, "
            f"{readings.values.shape}"
        )
    return degraded


@dataclass(frozen=True)
class _SimulatedReadings(Readings):
    """Readings of an output with what is held of a degradation, and a key of random numbers for each run."""

    model: StateSpaceModel
    held: Floats
    name: str
    output: str
    keys: NDArray[np.uint64]

    def p(self, name: str) -> Floats:
        own = {p.name: p for p in load_effect(self.name).PARAMETERS}
        if name not in own:
            raise UserError(
                f"{place_of(load_effect(self.name))}: reads undeclared parameter '{name}'{closest(name, [*own])}"
            )
        declared = own[name]
        row = self.model.parameter_names.index(parameter_of(declared, self.name, self.output).name)
        numbers: Floats = self.held[..., row, None, :]
        return numbers

    def normal(self, stream: str, shared: bool = False) -> Floats:
        words = seed_words(zlib.crc32(f"{self.name} {'' if shared else self.output} {stream}".encode()), self.keys)
        return standard_normal(words, self.values.shape[-2], 1).reshape(self.values.shape)

    def uniform(self, stream: str) -> Floats:
        return np.asarray(ndtr(self.normal(stream)))

    def gamma(self, stream: str, shape: Floats) -> Floats:
        return np.asarray(gammaincinv(shape, self.uniform(stream)))
