"""A driven oscillator whose push and mass may be uncertain, data of it, and a way to step estimators over them."""

import numpy as np

from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.models.assembly.parameter_states import ParameterState, is_logarithmic, with_parameters
from harness.models.contracts import Parameter
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import RATE, module

STEP, SAMPLES = 0.05, 300
PUSH = Parameter("push", "d", "m", -50.0, 50.0, "a constant push")
MASS = Parameter("mass", "m", "kg", 0.5, 40.0, "a mass")
Q, R, P0 = np.array([1e-3, 2e-3]), np.array([1e-2]), np.array([0.5, 1.0])


def vehicle():
    """A driven oscillator with a constant push, into which the push enters linearly and the mass does not."""

    def equations(v):
        a, b = v.state("alpha_test"), v.state("beta_test")
        v.derivative("alpha_test", b)
        force = v.port("push_test", v.p("push") + v.input("gamma_test"))
        v.derivative("beta_test", (-4 * a - v.p("rate") * b + force) / v.p("mass"))

    return module(
        "driven_test",
        STATES=("alpha_test", "beta_test"),
        INPUTS=("gamma_test",),
        PARAMETERS=(RATE, PUSH, MASS),
        AXLES={},
        VALID={},
        equations=equations,
    )


VALUES = {"rate": 1.5, "push": 0.3, "mass": 1.0}


def compiled(*states):
    made = vehicle()
    model = assemble(made, sensors=module("sensors_test", OUTPUTS={"alpha_test": "alpha_test"}))
    return compile_model(with_parameters(model, states, made), STEP, signals=tuple(s.name for s in states))


def push(prior=2.0, walk=0.0, considered=False, believed=0.3):
    return ParameterState("push", believed, prior, walk, considered, is_logarithmic(PUSH))


def mass(prior=0.4, walk=0.0, considered=False):
    return ParameterState("mass", 1.0, prior, walk, considered, is_logarithmic(MASS))


def drive(true, seed=5, samples=SAMPLES, excitation=1.0, q=Q):
    """Return inputs and measurements of the oscillator with true parameters and process noise."""
    rng = np.random.default_rng(seed)
    u = excitation * np.sin(0.7 * STEP * np.arange(samples))[:, None]
    x, y = np.zeros(2), np.empty((samples, 1))
    for k in range(samples):
        y[k] = x[0] + rng.normal() * R[0] ** 0.5
        slope = np.array([x[1], (-4 * x[0] - true["rate"] * x[1] + true["push"] + u[k, 0]) / true["mass"]])
        x = x + STEP * slope + rng.normal(size=2) * np.sqrt(q)
    return u, y


def run(kind, model, u, y, walks, settings=None, constants=None, infos=None):
    """Step through; return means ``(samples, nx)`` and covariances of lane 0, and append what was said to ``infos``."""
    estimator = CompiledEstimator(kind, model, settings)
    values = {**VALUES, **(constants or {})}
    belief = estimator.belief(
        model.constants(in_lanes(model.parameter_vector(values))), in_lanes(np.array([*Q, *walks])), in_lanes(R)
    )
    first = np.array([*P0, *(model.model.start_variance[s] for s in model.model.within)])
    state = estimator.init(np.zeros(model.nx), first)
    means, covariances = [state.mean[:, 0]], [state.covariance[:, :, 0]]
    for k in range(1, len(y)):
        state, info = estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), belief)
        if infos is not None:
            infos.append(info)
        means.append(state.mean[:, 0])
        covariances.append(state.covariance[:, :, 0])
    return np.array(means), np.array(covariances)
