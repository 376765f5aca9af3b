"""Small discrete vehicles for tests, built through the same contract as the files in ``models/vehicles``."""

from collections.abc import Callable, Sequence

import numpy as np
import sympy as sp

from harness.models.assembly.assemble import Builder, StateSpaceModel, assemble
from harness.testing.small_models import module

STATES = ("alpha_test", "beta_test", "gamma_test")


def discrete(
    states: int,
    ahead: Callable[[Builder, list[sp.Symbol], sp.Symbol], list[sp.Expr]],
    measured: Sequence[str] = (),
) -> StateSpaceModel:
    """Return a model of up to three states with ``x(n+1) = ahead(v, x, u)``.

    Args:
        states: Number of states.
        ahead: Next values from builder, states and the input ``push_test``; it may publish ports.
        measured: States and ports that are outputs.
    """
    names = STATES[:states]

    def equations(v: Builder) -> None:
        x = [v.state(s) for s in names]
        for name, value in zip(names, ahead(v, x, v.input("push_test")), strict=True):
            v.next_value(name, value)

    vehicle = module(
        "discrete_test", STATES=names, INPUTS=("push_test",), PARAMETERS=(), AXLES={}, VALID={}, equations=equations
    )
    return assemble(vehicle, sensors=module("sensors_test", OUTPUTS={o: o for o in measured}))


def quadratic(states: int = 1) -> StateSpaceModel:
    """Return ``x_i(n+1) = 2 x_i + 0.7 x_i^2``, without outputs but the first state."""
    return discrete(states, lambda v, x, u: [2 * s + sp.Rational(7, 10) * s**2 for s in x], ["alpha_test"])


def squared_output() -> StateSpaceModel:
    """Return a constant that is measured through its square."""

    def ahead(v, x, u):
        v.port("product_test", x[0] ** 2)
        return [x[0]]

    return discrete(1, ahead, ["product_test"])


def linear_in_disguise(scale: float = 1.0) -> StateSpaceModel:
    """Return a linear model whose outputs are linear wherever it is used, but not to the compiler: |x + 50|.

    Outputs are ``50 + alpha + beta`` and ``scale (50 + beta)``; the inputs enter both states.
    """

    def ahead(v, x, u):
        v.port("product_test", sp.Abs(x[0] + x[1] + 50))
        v.port("second_product_test", scale * sp.Abs(x[1] + 50))
        return [sp.Rational(9, 10) * x[0] + sp.Rational(1, 5) * x[1] + u, sp.Rational(4, 5) * x[1] - x[0] / 5]

    return discrete(2, ahead, ["product_test", "second_product_test"])


def disguised(u):
    """Return ``A, B u, C`` of ``linear_in_disguise`` without its constant outputs."""
    return np.array([[0.9, 0.2], [-0.2, 0.8]]), np.array([u[0], 0.0]), np.array([[1.0, 1.0], [0.0, 1.0]])
