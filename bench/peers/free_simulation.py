"""Simulation without noise by scipy and diffrax, and the multi-body model of commonroad-vehicle-models."""

from __future__ import annotations

import math
from collections.abc import Callable

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import odeint, solve_ivp
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from bench.peers.jax_filters import JAX
from bench.peers.problem import Problem, equations
from harness.engine.simd.lanes import LANES

STEP = 0.01


def diffrax_euler(given: Problem) -> Callable[[], object]:
    """Return explicit Euler at the sample time over the whole batch, compiled; inputs are held over a sample."""
    drift = equations(given, JAX).drift
    inputs = jnp.asarray(given.inputs)

    def slope(time: jax.Array, x: jax.Array, _: object) -> jax.Array:
        return jnp.stack(list(drift(x, inputs[jnp.asarray(jnp.round(time / STEP), int)])))

    def run(first: jax.Array) -> jax.Array:
        solved = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), diffrax.Euler(), 0.0, given.steps * STEP, STEP, first,
            saveat=diffrax.SaveAt(steps=True), max_steps=given.steps + 1,
        )  # fmt: skip
        return solved.ys

    first = jnp.zeros((given.batch, len(given.mean)))
    compiled = jax.jit(jax.vmap(run))
    return lambda: compiled(first).block_until_ready()


def scipy_lsoda(given: Problem) -> Callable[[], object]:
    """Return scipy's LSODA, implicit where the tyres are stiff, over one run, on the compiled equations."""
    compiled = given.compiled
    x, dx = np.zeros((compiled.nx, LANES)), np.zeros((compiled.nx, LANES))
    constants, inputs = np.repeat(given.constants, LANES, axis=1), np.repeat(given.inputs[:, :, None], LANES, axis=2)

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        x[:] = state[:, None]
        compiled.kernels.drift(x, inputs[min(int(time / STEP), given.steps)], constants, dx)
        return dx[:, 0].copy()

    end = given.steps * STEP
    return lambda: solve_ivp(slope, (0.0, end), given.mean, method="LSODA", t_eval=np.arange(0.0, end, STEP), rtol=1e-6)


def multi_body(steps: int) -> Callable[[], object]:
    """Return the multi-body car of commonroad-vehicle-models (29 states) in a slight turn, solved as its guide does."""
    vehicle = parameters_vehicle2()
    first = init_mb([0.0, 0.0, 0.0, 15.0, 0.0, 0.0, 0.0], vehicle)
    time = np.arange(steps + 1) * STEP

    def slope(x: list[float], t: float) -> list[float]:
        return list(vehicle_dynamics_mb(x, [0.1 * math.cos(t), 0.0], vehicle))

    return lambda: odeint(slope, first, time)
