"""Compiled models: derivatives against finite differences, integrators against closed forms, the cache."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import UserError
from harness.engine.codegen.derivatives import derive
from harness.engine.compile import compile_model, load_source
from harness.engine.simd.lanes import LANES
from harness.models.assembly.assemble import assemble, symbol
from harness.models.parameters import ziaukas_2023 as reference
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import curved, linear

SCALE = np.array([0.3, 0.1, 0.3, 0.1, 0.2, 5e3, 5e3, 5e3, 5e3, 5e3, 1.0])
CHOSEN = ("trailer_mass", "tractor_yaw_inertia", "friction", "relaxation_length_2", "trailer_cog_from_rear")
TARGETS = ("coupling_force", "lateral_acceleration_tractor", "articulation_angle")


@pytest.fixture(scope="module")
def semitrailer():
    model = assemble("semitrailer", "magic_formula", (), "test_vehicle").augment(["steering_wheel_angle"])
    return compile_model(model, signals=TARGETS, parameters=CHOSEN)


@pytest.fixture(scope="module")
def point(semitrailer):
    x = np.random.default_rng(0).normal(size=(semitrailer.nx, LANES)) * SCALE[:, None]
    u = np.stack([np.linspace(2.0, 22.0, LANES), np.linspace(-1.0, 1.0, LANES)])
    p = in_lanes(semitrailer.parameter_vector(reference.VALUES))
    return x, u, p


def call(kernel, shape, *arguments, work=None):
    out = np.full(shape, np.nan)
    kernel(*arguments, out, *([] if work is None else [work]))
    return out


def central(function, at, steps):
    """Return d function / d at by central differences; the last axis is the lane."""
    columns = []
    for j, h in enumerate(steps):
        ahead, behind = at.copy(), at.copy()
        ahead[j] += h
        behind[j] -= h
        columns.append((function(ahead) - function(behind)) / (2 * h))
    return np.stack(columns, axis=1)


def test_state_input_and_parameter_jacobians_match_finite_differences(semitrailer, point):
    m, (x, u, p) = semitrailer, point
    k, c, rows = m.kernels, m.constants(p), m.nx
    drift = lambda x_, u_, c_: call(k.drift, (rows, LANES), x_, u_, c_)  # noqa: E731
    output = lambda x_, c_: call(k.output, (m.ny, LANES), x_, u, c_)  # noqa: E731
    signal = lambda x_: call(k.signals, (len(TARGETS), LANES), x_, u, c)  # noqa: E731
    chosen = [m.model.parameter_names.index(n) for n in CHOSEN]

    def with_parameters(values):
        changed = p.copy()
        changed[chosen] = values
        return m.constants(changed)

    n, scale, base = len(CHOSEN), SCALE, p[chosen]

    def output_jacobian(J):
        k.output_jacobian(x, u, c, np.empty((m.ny, LANES)), J)
        return J

    cases = [
        (
            call(k.drift_jacobian, (rows, rows, LANES), x, u, c),
            central(lambda v: drift(v, u, c), x, 1e-6 * scale),
            scale,
        ),
        (
            call(k.drift_input_jacobian, (rows, 2, LANES), x, u, c),
            central(lambda v: drift(x, v, c), u, [1e-6] * 2),
            1.0,
        ),
        (
            call(k.drift_parameter_jacobian, (rows, n, LANES), x, u, c),
            central(lambda v: drift(x, u, with_parameters(v)), base, 1e-6 * base[:, 0]),
            base[:, 0],
        ),
        (output_jacobian(np.empty((m.ny, rows, LANES))), central(lambda v: output(v, c), x, 1e-6 * scale), scale),
        (call(k.signals_jacobian, (len(TARGETS), rows, LANES), x, u, c), central(signal, x, 1e-6 * scale), scale),
    ]
    for exact, differences, unit in cases:
        weight = np.reshape(unit, (1, -1, 1))
        size = np.abs(exact * weight).max(axis=(1, 2), keepdims=True) + 1e-12
        assert np.max(np.abs(exact - differences) * weight / size) < 1e-6


def test_output_parameter_jacobian_is_zero_for_direct_measurements(semitrailer, point):
    x, u, p = point
    J = call(semitrailer.kernels.output_parameter_jacobian, (4, len(CHOSEN), LANES), x, u, semitrailer.constants(p))
    assert np.array_equal(J, np.zeros_like(J))


def test_kernels_agree_with_an_independent_evaluation(semitrailer, point):
    """The lane kernels against SymPy's own numbers, lane by lane."""
    (x, u, p), model = point, semitrailer.model
    drift = call(semitrailer.kernels.drift, x.shape, x, u, semitrailer.constants(p))
    for lane in (0, LANES - 1):
        numbers = dict(zip(map(symbol, model.parameter_names), p[:, lane], strict=True))
        numbers |= dict(zip(map(symbol, model.states), x[:, lane], strict=True))
        numbers |= dict(zip(map(symbol, model.inputs), u[:, lane], strict=True))
        for name, expr in model.ports.items():
            numbers[symbol(name)] = sp.Float(expr.subs(numbers))
        expected = [float(e.subs(numbers)) for e in model.derivatives]
        np.testing.assert_allclose(drift[:, lane], expected, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("integrator", ["euler", "heun", "rk4"])
@pytest.mark.parametrize("substeps", [1, 2])
def test_steps_match_the_tableau_and_their_jacobian(integrator, substeps):
    compiled, T = compile_model(curved(), 0.1, integrator, substeps), 0.1
    x, u, c = np.random.default_rng(1).normal(size=(2, LANES)), np.full((1, LANES), 0.3), None
    c = compiled.constants(np.full((1, LANES), 2.0))
    f = lambda x_: np.stack([x_[1], -2.0 * np.sin(x_[0]) - 0.2 * x_[1] * np.abs(x_[1]) + 0.3])  # noqa: E731

    def step(x_, h):
        k1 = f(x_)
        if integrator == "euler":
            return x_ + h * k1
        if integrator == "heun":
            return x_ + h / 2 * (k1 + f(x_ + h * k1))
        k2 = f(x_ + h / 2 * k1)
        k3 = f(x_ + h / 2 * k2)
        return x_ + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x_ + h * k3))

    expected = x
    for _ in range(substeps):
        expected = step(expected, T / substeps)
    work, k = np.empty((compiled.nw, LANES)), compiled.kernels
    run = lambda x_: call(k.next_state, x.shape, x_, u, c, work=work)  # noqa: E731
    np.testing.assert_allclose(run(x), expected, rtol=1e-13, atol=1e-14)
    A, ahead = np.empty((2, 2, LANES)), np.empty_like(x)
    k.next_jacobian(x, u, c, ahead, A, work)
    np.testing.assert_allclose(ahead, expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(A, central(run, x, [1e-6, 1e-6]), rtol=1e-7, atol=1e-8)
    root = np.random.default_rng(2).normal(size=(2, 2, LANES))
    P, Pn = np.ascontiguousarray(np.einsum("ikl,jkl->ijl", root, root)), np.empty((2, 2, LANES))
    k.next_covariance(x, u, c, P, ahead, Pn, work)
    np.testing.assert_allclose(Pn, np.einsum("ijl,jkl,mkl->iml", A, P, A), rtol=1e-12, atol=1e-14)
    away, moved, again = np.random.default_rng(3).normal(size=x.shape), np.empty_like(x), np.empty_like(Pn)
    k.next_linear(x, u, c, away, P, moved, again, work)
    np.testing.assert_allclose(moved, expected + np.einsum("ijl,jl->il", A, away), rtol=1e-12, atol=1e-14)
    assert np.array_equal(again, Pn)


def test_rk4_is_of_fourth_order():
    """Halving the step divides the error by about 2^4, by 2 for Euler."""

    def error(integrator, step):
        compiled = compile_model(linear(), step, integrator)
        c, work = compiled.constants(np.full((1, LANES), 1.5)), np.empty((compiled.nw, LANES))
        x, u = in_lanes(np.array([1.0, -0.5, 0.3])), np.zeros((1, LANES))
        for _ in range(round(1.0 / step)):
            x = call(compiled.kernels.next_state, x.shape, x, u, c, work=work)
        A = np.array([[-0.45, 1, 0], [-4, -1.5, 0], [0.5, 0, -0.2]])
        exact = np.array(sp.Matrix(A).exp().evalf() @ sp.Matrix([1.0, -0.5, 0.3])).astype(float).ravel()
        return np.abs(x[:, 0] - exact).max()

    assert 14 < error("rk4", 0.1) / error("rk4", 0.05) < 18
    assert 1.8 < error("euler", 0.02) / error("euler", 0.01) < 2.2


def test_linear_outputs_are_recognised(semitrailer):
    assert semitrailer.kernels.OUTPUTS_ARE_LINEAR
    assert not compile_model(curved(), 0.1).kernels.OUTPUTS_ARE_LINEAR


def test_jacobian_is_sparse(semitrailer):
    entries = derive(semitrailer.model).state_jacobian
    assert len(entries) < 75  # of 121; a dense one would mean that zeros are carried along


def test_the_steered_axle_needs_no_tangent(semitrailer):
    """Its value is that of ``test_kernels_agree_with_an_independent_evaluation``, which evaluates the tangent."""
    eqs = derive(semitrailer.model)
    written = [*eqs.assignments.values(), *eqs.derivatives]
    assert any(port.has(sp.tan) for port in semitrailer.model.ports.values())
    assert not any(expr.has(sp.tan) for expr in written)
    assert sum(len(expr.atoms(sp.atan)) for expr in written) == 5  # one per axle, that of the tyre


def test_unknown_integrator_is_refused():
    with pytest.raises(UserError, match="euler, heun, rk4"):
        compile_model(linear(), 0.1, "leapfrog")


def test_missing_parameter_is_named(semitrailer):
    values = {k: v for k, v in reference.VALUES.items() if k != "friction"}
    with pytest.raises(UserError, match="friction"):
        semitrailer.parameter_vector(values)


def test_cache_reuses_equal_source_and_refuses_an_unwritable_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    first = load_source("probe", "VALUE = 1\n")
    assert load_source("probe", "VALUE = 1\n") is first
    assert load_source("probe", "VALUE = 2\n").VALUE == 2
    assert len(list((tmp_path / "cache").glob("probe_*.py"))) == 2
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "file"))
    with pytest.raises(UserError, match="HARNESS_CACHE"):
        load_source("probe", "VALUE = 3\n")


def test_threads_that_ask_for_the_same_source_get_it_whole(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    slow = "import time\ntime.sleep(0.2)\nVALUE = 1\n"
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda _: load_source("slow", slow).VALUE, range(2))) == [1, 1]
