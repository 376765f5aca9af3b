"""The kernels behind the functions of an exported estimator, pasted behind those of a model and of an estimator."""

from __future__ import annotations

from harness.engine.kernel_names import NU, NX, StandIn, get, put, splat
from harness.runner.filter_loop import advance, write_covariance
from harness.runner.scores import keep_targets
from harness.runner.simulation_loop import outside

constants = StandIn("constants")


def begin_exported(p, mean, variance, c, state):
    """Begin a run.

    Args:
        p: Parameters ``(1, np, LANES)``.
        mean: First state ``(nx, LANES)``.
        variance: Of each first state ``(nx, LANES)``.
        c: Constants of the model, written ``(1, nc, LANES)``.
        state: ``harness.engine.kernel_names.State``, written.
    """
    constants(p, c)
    for i in range(NX):
        put(get(mean, i), state.mean, i)
        for j in range(NX):
            put(get(variance, i) if i == j else splat(0.0), state.covariance, i, j)
    for i in range(state.memory.shape[0]):
        put(splat(0.0), state.memory, i)


def step_exported(state, u_before, u, y, belief, work, after, info):
    """Take one sample: what is held of the one before is overwritten.

    Args:
        state: ``harness.engine.kernel_names.State``, overwritten.
        u_before: Inputs at the sample before ``(nu, LANES)``, overwritten by those of this one.
        u: Inputs ``(nu, LANES)``.
        y: Measurements ``(ny, LANES)``, NaN where missing.
        belief: ``harness.engine.kernel_names.Belief``.
        work: From ``workspace``.
        after: Room for another ``State``.
        info: Written.
    """
    advance(state, u_before, u, y, belief, work, after, info)
    write_covariance(after, work)
    for i in range(NX):
        put(get(after.mean, i), state.mean, i)
        for j in range(NX):
            put(get(after.covariance, i, j), state.covariance, i, j)
    for i in range(state.memory.shape[0]):
        put(get(after.memory, i), state.memory, i)
    for i in range(NU):
        put(get(u, i), u_before, i)


def tell_of_exported(state, u, belief, limits, room, estimates, beyond):
    """Write the estimated signals and their standard deviations, and whether they are to be trusted at all.

    Args:
        state: ``harness.engine.kernel_names.State``.
        u: Inputs ``(nu, LANES)``.
        belief: ``harness.engine.kernel_names.Belief``.
        limits: Largest magnitude of each state ``(nx,)``.
        room: Scratch ``(ns, LANES)`` and ``(ns, nx, LANES)``.
        estimates: Written ``(2, ns, LANES)``.
        beyond: Written 1 where the state is beyond its limits or no number, else 0 ``(1, LANES)``.
    """
    s, slopes = room
    keep_targets(state, u, belief, s, slopes, estimates)
    put(outside(state.mean, limits), beyond, 0)
