"""Small vehicles through the contract of ``models/vehicles``, and the textbook's Kalman filter on the linear one."""

from types import ModuleType

import numpy as np
import sympy as sp

from harness.engine.compile import CompiledModel, compile_model
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


STEP = 0.05

Q, R, P0 = np.array([1e-3, 2e-3, 5e-4]), np.array([1e-2, 4e-2]), np.array([0.5, 1.0, 2.0])


def compiled_linear() -> CompiledModel:
    """Return the small linear model: one for all, so that an estimator is compiled on it once."""
    return compile_model(linear(), STEP, signals=("beta_test",))


def drive_linear(samples=80, seed=3):
    """Return inputs, measurements and the matrices of the sampled linear model."""
    rng = np.random.default_rng(seed)
    A = np.eye(3) + STEP * np.array([[-0.3 * 1.5, 1, 0], [-4, -1.5, 0], [0.5, 0, -0.2]])
    B = STEP * np.array([[0.0], [1.0], [0.0]])
    C = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    u = rng.normal(size=(samples, 1))
    x, y = np.zeros(3), np.empty((samples, 2))
    for k in range(samples):
        y[k] = C @ x + rng.normal(size=2) * np.sqrt(R)
        x = A @ x + B @ u[k] + rng.normal(size=3) * np.sqrt(Q)
    return u, y, A, B, C


def textbook(u, y, A, B, C):
    """The Kalman filter with full matrices; a NaN measurement is left out."""
    x, P, log_likelihood = np.zeros(3), np.diag(P0), 0.0
    means, covariances = [x], [P]
    likelihoods: list[float] = []
    for k in range(1, len(y)):
        x, P = A @ x + B @ u[k - 1], A @ P @ A.T + np.diag(Q)
        seen = ~np.isnan(y[k])
        H = C[seen]
        S = H @ P @ H.T + np.diag(R[seen])
        innovation = y[k, seen] - H @ x
        K = P @ H.T @ np.linalg.inv(S)
        log_likelihood = -0.5 * (
            innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(2 * np.pi * S)[1] if seen.any() else 0.0
        )
        x, P = x + K @ innovation, P - K @ S @ K.T
        means.append(x)
        covariances.append(P)
        likelihoods.append(log_likelihood)
    return np.array(means), np.array(covariances), np.array(likelihoods)
