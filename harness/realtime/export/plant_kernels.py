"""The kernels behind the functions of an exported plant, pasted behind those of its model."""

from __future__ import annotations

from harness.engine.kernel_names import NX, StandIn, get, next_state, put, signals
from harness.runner.simulation_loop import outside

constants = StandIn("constants")


def begin_plant(p, first, c, x):
    """Begin a run.

    Args:
        p: Parameters ``(1, np, LANES)``.
        first: First state ``(nx, LANES)``.
        c: Constants of the model, written ``(1, nc, LANES)``.
        x: State, written ``(nx, LANES)``.
    """
    constants(p, c)
    for i in range(NX):
        put(get(first, i), x, i)


def move_plant(x, u, c, ahead, w):
    """Take a step.

    Args:
        x: State, overwritten ``(nx, LANES)``.
        u: Inputs, held ``(nu, LANES)``.
        c: Constants ``(nc, LANES)``.
        ahead: Scratch ``(nx, LANES)``.
        w: Scratch ``(nw, LANES)``.
    """
    next_state(x, u, c, ahead, w)
    for i in range(NX):
        put(get(ahead, i), x, i)


def tell_plant(x, u, c, limits, s, beyond):
    """Write the signals of a sample, and whether they are to be trusted at all.

    Args:
        x: State ``(nx, LANES)``.
        u: Inputs ``(nu, LANES)``.
        c: Constants ``(nc, LANES)``.
        limits: Largest magnitude of each state ``(nx,)``.
        s: Written ``(ns, LANES)``.
        beyond: Written 1 where the state is beyond its limits or no number, else 0 ``(1, LANES)``.
    """
    signals(x, u, c, s)
    put(outside(x, limits), beyond, 0)
