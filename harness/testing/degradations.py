"""What holds for every degradation of sensors, on the readings of two sensors at rest."""

from __future__ import annotations

import types

import numpy as np

from harness.common.arrays import Floats
from harness.engine.simd.lanes import LANES
from harness.models.assembly.assemble import assemble
from harness.models.assembly.placement import OF_SIGNAL
from harness.models.contracts import Parameter
from harness.models.roles import DEGRADATIONS
from harness.runner.contract import Held
from harness.simulation.degraded_sensors import degrade
from harness.testing.dimensions import dimension_of
from harness.testing.parts import named, require

SAMPLES, STEP, OUTPUTS = 400, 0.01, "yaw_rate, lateral_acceleration"
_TRIED = 24
"""Points in the bounds of the parameters."""


def check_degradation(degradation: str | types.ModuleType) -> None:
    """Check a degradation of sensors.

    Units of its parameters; that readings are as they were at the neutral values and not everywhere else; and, at
    points in the bounds of the parameters, that each reading is a number or NaN, depends on no later one, and is the
    same whatever runs stand next to its own.

    Args:
        degradation: Its name, or a module that keeps the contract (``harness/models/contracts.py``).

    Raises:
        AssertionError: If something does not hold; the message says what.
    """
    with named(DEGRADATIONS, degradation) as name:
        file = DEGRADATIONS.load(name)
        require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        require(file.PARAMETERS, f"{name}: has no parameter, so that it cannot be absent")
        for p in file.PARAMETERS:
            if p.unit != OF_SIGNAL:
                dimension_of(p.unit)  # pint can read it
            require(p.neutral is not None, f"{name}: {p.name} has no neutral value, at which the degradation is absent")
            require(-np.inf < p.lower < p.upper < np.inf, f"{name}: {p.name}: the bounds are not two numbers that rise")
        rng = np.random.default_rng(1)
        noise = rng.standard_normal((SAMPLES, 4, LANES))
        same = _readings(name, {}, noise)
        require(np.array_equal(same, noise[:, 2:]), f"{name}: changes readings at the neutral values")
        points = [_point(rng, file.PARAMETERS) for _ in range(_TRIED)]
        degraded = [_readings(name, point, noise) for point in points]
        require(
            any(not np.array_equal(each, same, equal_nan=True) for each in degraded),
            f"{name}: changes no reading anywhere in the bounds of its parameters",
        )
        later = noise.copy()
        later[SAMPLES // 2 :, 2:] += 1.0
        for point, each in zip(points, degraded, strict=True):
            at = ", ".join(f"{n} = {v:g}" for n, v in point.items())
            require(not np.isinf(each).any(), f"{name}: gives an infinite reading at {at}; a missing one is NaN")
            ahead = _readings(name, point, later)[: SAMPLES // 2]
            require(np.array_equal(ahead, each[: SAMPLES // 2], equal_nan=True), f"{name}: reads ahead at {at}")
            turned = _readings(name, point, noise[..., ::-1])[..., ::-1]
            require(np.array_equal(turned, each, equal_nan=True), f"{name}: mixes runs side by side at {at}")


def _point(rng: np.random.Generator, parameters: tuple[Parameter, ...]) -> dict[str, float]:
    """Return values by the names in the file: near the neutral ones, near a bound, or a bound."""
    ends = {p.name: (p.neutral or 0.0, rng.choice([p.lower, p.upper])) for p in parameters}
    small = 10 ** rng.uniform(-4, 0)
    return {name: float(a + rng.choice([small, 1 - small, 1.0]) * (b - a)) for name, (a, b) in ends.items()}


def _readings(name: str, values: dict[str, float], noise: Floats) -> Floats:
    """Return readings ``(samples, 2, LANES)`` whose white noise is the last two rows of ``noise``."""
    model = assemble("car", "linear", [name], OUTPUTS)
    stated = [
        next((v for n, v in values.items() if p.name in (n, *(f"{n}_{o}" for o in model.outputs))), p.neutral or 0.0)
        for p in model.parameters
    ]
    measured, ones = noise[:, 2:].copy(), np.ones((2, LANES))
    held = Held(np.repeat(np.array(stated)[:, None], LANES, axis=1), ones, ones, np.zeros((2, LANES)))
    degrade(model, measured, held, noise, STEP)
    return measured
