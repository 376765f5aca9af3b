"""Small vehicles for tests, built through the same contract as the files in ``models/vehicles``."""

from types import ModuleType

import sympy as sp

from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.contracts import Parameter
from harness.models.signals import Signal

QUANTITIES = tuple(
    Signal(name, name, "1", "1", "", "a quantity of a test")
    for name in ("alpha_test", "beta_test", "gamma_test", "push_test", "product_test", "second_product_test")
)

RATE = Parameter("rate", "k", "1/s", 0.0, 100.0, "decay rate")


def module(name: str, **members: object) -> ModuleType:
    """Return a module with these members, and the signals of the tests."""
    made = ModuleType(name)
    made.__dict__.update({"SIGNALS": QUANTITIES} | members)
    return made


def linear(outputs: tuple[str, ...] = ("alpha_test", "gamma_test")) -> StateSpaceModel:
    """Return a stable linear model of three states, one input and one parameter."""
    states = ("alpha_test", "beta_test", "gamma_test")

    def equations(v):
        a, b, c = (v.state(s) for s in states)
        k, u = v.p("rate"), v.input("push_test")
        v.derivative("alpha_test", b - 0.3 * k * a)
        v.derivative("beta_test", -4 * a - k * b + u)
        v.derivative("gamma_test", 0.5 * a - 0.2 * c)

    vehicle = module(
        "linear_test",
        STATES=states,
        INPUTS=("push_test",),
        PARAMETERS=(RATE,),
        AXLES={},
        VALID={},
        equations=equations,
    )
    return assemble(vehicle, sensors=module("sensors_test", OUTPUTS={o: o for o in outputs}))


def curved() -> StateSpaceModel:
    """Return a non-linear model whose output is non-linear in the state as well."""

    def equations(v):
        a, b = v.state("alpha_test"), v.state("beta_test")
        v.derivative("alpha_test", b)
        v.derivative("beta_test", -v.p("rate") * sp.sin(a) - 0.2 * b * sp.Abs(b) + v.input("push_test"))
        v.port("product_test", sp.exp(0.3 * a) + a * b)

    vehicle = module(
        "curved_test",
        STATES=("alpha_test", "beta_test"),
        INPUTS=("push_test",),
        PARAMETERS=(RATE,),
        AXLES={},
        VALID={"alpha_test": 20.0},
        equations=equations,
    )
    return assemble(vehicle, sensors=module("sensors_test", OUTPUTS={"product_test": "product_test"}))
