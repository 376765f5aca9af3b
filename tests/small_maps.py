"""Small discrete vehicles for tests, built through the same contract as the files in ``models/vehicles``."""

from collections.abc import Callable, Mapping

import sympy as sp
from small_vehicles import module

from models.assemble import Builder, Model, assemble

STATES = ("alpha_test", "beta_test", "gamma_test")


def discrete(
    states: int,
    ahead: Callable[[Builder, list[sp.Symbol], sp.Symbol], list[sp.Expr]],
    outputs: Callable[[list[sp.Symbol]], Mapping[str, sp.Expr]] = lambda x: {},
) -> Model:
    """Return a model of up to three states with ``x(n+1) = ahead(v, x, u)`` and outputs (ports) of the state.

    Args:
        states: Number of states.
        ahead: Next values from builder, states and the input ``push_test``.
        outputs: Expressions by port; a port named as a state measures that state.
    """
    names = STATES[:states]

    def equations(v: Builder) -> None:
        x = [v.state(s) for s in names]
        for name, value in zip(names, ahead(v, x, v.input("push_test")), strict=True):
            v.next_value(name, value)
        for port, value in outputs(x).items():
            if port not in names:
                v.port(port, value)

    vehicle = module(
        "discrete_test", STATES=names, INPUTS=("push_test",), PARAMETERS=(), AXLES={}, VALID={}, equations=equations
    )
    wanted = outputs([sp.Symbol(n) for n in names])
    return assemble(vehicle, sensors=module("sensors_test", OUTPUTS={o: o for o in wanted}))
