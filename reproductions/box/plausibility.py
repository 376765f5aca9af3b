"""Plausibility of the vehicle of a point: loads, understeer, stability."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec, resolve_single
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.simd.lanes import LANES
from reproductions.box import studies

SPEED = 80 / 3.6
"""m/s at which stability is judged."""

AXLES = ("11", "12", "21", "22", "23")
GRAVITY = 9.81


@dataclass(frozen=True)
class Plausibility:
    """What a vehicle driven straight ahead tells.

    Attributes:
        loads: Of the axles in N, front first.
        stiffness: Cornering stiffness of the axles in N/rad.
        understeer: Of the tractor in rad per m/s²: positive understeers (ISO 8855).
        slowest: Largest real part of the eigenvalues at 80 km/h in 1/s, the tie's own left out; negative is stable.
    """

    loads: Floats
    stiffness: Floats
    understeer: float
    slowest: float

    @property
    def plausible(self) -> bool:
        """Whether all axles carry load, the tractor understeers and the straight run is stable."""
        return bool((self.loads > 0).all() and self.understeer > 0 and self.slowest < 0)


@functools.cache
def _vehicle() -> tuple[ModelSpec, CompiledModel]:
    spec = resolve_single(
        {"vehicle": "semitrailer", "parameters": studies.SET, "tyre": "magic_formula", "sensors": "series"}, "the box"
    )
    signals = (*(f"vertical_load_axle_{a}" for a in AXLES), *(f"cornering_stiffness_axle_{a}" for a in AXLES))
    return spec, compile_model(spec.model(), spec.step, "euler", 1, signals)


def plausibility(at: Mapping[str, float]) -> Plausibility:
    """Judge the vehicle of a point, given by its values by factor."""
    spec, compiled = _vehicle()
    values = compiled.parameter_vector(spec.values | studies.parameters(at))
    constants = compiled.constants(np.repeat(values[:, None], LANES, axis=1))
    x, u = np.zeros((compiled.nx, LANES)), np.zeros((compiled.nu, LANES))
    u[list(compiled.model.inputs).index("speed")] = SPEED
    signals = np.empty((2 * len(AXLES), LANES))
    compiled.kernels.signals(x, u, constants, signals)
    jacobian = np.empty((compiled.nx, compiled.nx, LANES))
    compiled.kernels.drift_jacobian(x, u, constants, jacobian)
    eigenvalues = np.linalg.eigvals(jacobian[:, :, 0])
    if at["constraint_rate"] == 0.0:  # as printed, a violated tie stays as it is
        eigenvalues = np.delete(eigenvalues, np.argmin(np.abs(eigenvalues)))
    loads, stiffness = signals[: len(AXLES), 0], signals[len(AXLES) :, 0]
    understeer = (loads[0] / stiffness[0] - loads[1] / stiffness[1]) / GRAVITY
    return Plausibility(loads, stiffness, float(understeer), float(eigenvalues.real.max()))
