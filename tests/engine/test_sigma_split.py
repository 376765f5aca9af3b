"""A step in two parts: what depends on the leading states only, and the rest."""

import numpy as np
import pytest
import sympy as sp

from harness.engine.codegen.derivatives import Lift, derive
from harness.engine.codegen.integrators import sigma_split
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.models.assembly.assemble import assemble
from harness.models.parameters import ziaukas_2023
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import module

SCALE = np.array([0.3, 0.1, 0.3, 0.1, 0.2, 5e3, 5e3, 5e3, 5e3, 5e3, 1.0])


def semitrailer():
    return assemble("semitrailer", "magic_formula").augment(["steering_wheel_angle"])


@pytest.fixture(scope="module")
def compiled():
    return compile_model(semitrailer())


def test_the_semitrailer_is_split_behind_its_motion(compiled):
    """The five states of motion decide the slip angles of all axles but the steered one."""
    assert compiled.kernels.LEADING == 5
    assert compiled.model.states[:5][-1] == "articulation_angle"


def test_points_with_the_same_leading_states_get_the_same_next_state(compiled):
    rng = np.random.default_rng(3)
    k, leading = compiled.kernels, compiled.kernels.LEADING
    mean = rng.normal(size=(compiled.nx, LANES)) * SCALE[:, None]
    u = np.stack([np.linspace(0.1, 22.0, LANES), np.linspace(-1.0, 1.0, LANES)])
    values = compiled.parameter_vector(ziaukas_2023.VALUES)
    c = compiled.constants(in_lanes(values) * rng.uniform(0.9, 1.1, (len(values), LANES)))
    shared, scratch = np.full((compiled.nw, LANES), np.nan), np.empty((compiled.nw, LANES))
    k.leading_part(mean, u, c, shared)
    for _ in range(5):
        point, ahead, whole = mean.copy(), np.empty_like(mean), np.empty_like(mean)
        point[leading:] += rng.normal(size=(compiled.nx - leading, LANES)) * SCALE[leading:, None]
        k.next_state_behind(point, u, c, ahead, shared)
        k.next_state(point, u, c, whole, scratch)
        assert np.isfinite(whole).all()
        np.testing.assert_allclose(ahead, whole, rtol=1e-12, atol=1e-12)


def test_only_what_costs_less_in_two_parts_is_split():
    """A function of the first state is shared by the points along the second; one of the second by none."""

    def bent_by(name):
        def equations(v):
            a, b = v.state("alpha_test"), v.state("beta_test")
            v.derivative("alpha_test", -a)
            v.derivative("beta_test", sp.sin(sp.atan({"alpha_test": a, "beta_test": b}[name])) - b)

        states = ("alpha_test", "beta_test")
        vehicle = module(
            f"bent_by_{name}",
            STATES=states,
            INPUTS=("push_test",),
            PARAMETERS=(),
            AXLES={},
            VALID={},
            equations=equations,
        )
        return assemble(vehicle, sensors=module("sensors_test", OUTPUTS={s: s for s in states}))

    assert compile_model(bent_by("alpha_test"), 0.1).kernels.LEADING == 1
    assert compile_model(bent_by("beta_test"), 0.1).kernels.LEADING == 2


@pytest.mark.parametrize(("integrator", "substeps"), [("heun", 1), ("rk4", 1), ("euler", 2)])
def test_steps_of_several_stages_are_not_split(integrator, substeps):
    compiled = compile_model(semitrailer(), 0.01, integrator, substeps)
    assert compiled.nx == compiled.kernels.LEADING


def test_no_elementary_function_is_left_behind_that_the_leading_states_decide():
    eqs = derive(semitrailer())
    split = sigma_split(eqs, eqs.derivatives)
    first, then = split.sources
    assert then.count("atan(") == 1  # of the steered axle
    assert first.count("atan(") == 4
    assert "put(" in first
    assert f"get(w, {split.shared - 1})" in then
    assert f"get(w, {split.shared})" not in then


def test_lifting_names_each_subexpression_once():
    a, b, x = sp.symbols("a b x", real=True)
    lift = Lift({a, b}, "k", atoms=False)
    first = lift(x * sp.sin(a + b) * b + a)
    k = {str(n): n for n in lift.named}
    assert lift.named == {k["k_0"]: b * sp.sin(a + b)}
    assert first == x * k["k_0"] + a
    assert lift(sp.cos(x) + b * sp.sin(a + b)) == sp.cos(x) + k["k_0"]
    assert Lift({a}, "c", atoms=True)(a * x) == sp.Symbol("c_0", real=True) * x
