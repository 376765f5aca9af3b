"""Dual numbers: the values are those of plain lanes, the tangents their exact derivatives."""

import numpy as np
from numba import njit

from harness.engine.compile import compile_model, over_duals
from harness.engine.simd import (
    dual,
    dual_functions,
    lanes,
)
from harness.engine.simd import (
    functions as lane_math,
)
from harness.testing.small_models import curved

N = lanes.LANES
FUNCTIONS = {
    "sin": (np.linspace(-7, 7, N), np.cos),
    "cos": (np.linspace(-7, 7, N), lambda x: -np.sin(x)),
    "tan": (np.linspace(-1.4, 1.4, N), lambda x: 1 / np.cos(x) ** 2),
    "atan": (np.linspace(-5, 5, N), lambda x: 1 / (1 + x * x)),
    "exp": (np.linspace(-5, 5, N), np.exp),
    "log": (np.linspace(0.1, 9, N), lambda x: 1 / x),
    "tanh": (np.linspace(-2, 2, N), lambda x: 1 / np.cosh(x) ** 2),
    "sqrt": (np.linspace(0.1, 9, N), lambda x: 0.5 / np.sqrt(x)),
    "absolute": (np.linspace(-3, 4, N), np.sign),
    "sign": (np.linspace(-3, 4, N), np.zeros_like),
    "floor": (np.linspace(-3.1, 4.2, N), np.zeros_like),
}


def apply_functions(numbers, functions):
    """Return the elementary functions over one kind of number, compiled at once: row in, row out."""
    get, put = numbers.get, numbers.put
    sin, cos, tan, atan = functions.sin, functions.cos, functions.tan, functions.atan
    exp, log, tanh, sign = functions.exp, functions.log, functions.tanh, functions.sign
    sqrt, absolute, floor = numbers.sqrt, numbers.absolute, numbers.floor

    @njit(error_model="numpy")
    def apply(x, out):
        put(sin(get(x, 0)), out, 0)
        put(cos(get(x, 1)), out, 1)
        put(tan(get(x, 2)), out, 2)
        put(atan(get(x, 3)), out, 3)
        put(exp(get(x, 4)), out, 4)
        put(log(get(x, 5)), out, 5)
        put(tanh(get(x, 6)), out, 6)
        put(sqrt(get(x, 7)), out, 7)
        put(absolute(get(x, 8)), out, 8)
        put(sign(get(x, 9)), out, 9)
        put(floor(get(x, 10)), out, 10)

    return apply


def apply_arithmetic(numbers):
    get, put = numbers.get, numbers.put

    @njit(error_model="numpy")
    def apply(x, out):
        a, b = get(x, 0), get(x, 1)
        put(a + b, out, 0)
        put(a - b, out, 1)
        put(a * b, out, 2)
        put(a / b, out, 3)
        put(-a * 2.0 + 3.0 / b - 1, out, 4)
        put((2.0 - a) * 3 + (b - 1.0) / 4.0 + 2 * b, out, 5)

    return apply


def test_functions_have_the_value_of_lanes_and_the_derivative_of_analysis():
    x = np.array([points for points, _ in FUNCTIONS.values()])
    slopes = np.array([slope(points) for points, slope in FUNCTIONS.values()])
    out, expected = np.empty((len(x), 2 * N)), np.empty((len(x), N))
    apply_functions(dual, dual_functions)(np.hstack([x, np.full_like(x, 3.0)]), out)
    apply_functions(lanes, lane_math)(x, expected)
    assert np.array_equal(out[:, :N], expected)
    assert np.allclose(out[:, N:], 3.0 * slopes, rtol=1e-14, atol=1e-14)


def test_arithmetic_follows_the_rules_of_differentiation():
    a, b, da, db = np.random.default_rng(1).uniform(0.5, 2.0, (4, N))
    out, expected = np.empty((6, 2 * N)), np.empty((6, N))
    apply_arithmetic(dual)(np.array([np.r_[a, da], np.r_[b, db]]), out)
    apply_arithmetic(lanes)(np.array([a, b]), expected)
    partials = [(1, 1), (1, -1), (b, a), (1 / b, -a / b**2), (-2, -3 / b**2), (-3, 2.25)]
    assert np.allclose(out[:, :N], expected, rtol=1e-15, atol=1e-15)
    assert np.allclose(out[:, N:], [p * da + q * db for p, q in partials], rtol=1e-13)


def test_a_choice_carries_the_derivative_of_what_was_chosen():
    larger, smaller, select, is_nan = dual_functions.maximum, dual_functions.minimum, dual.select, dual.is_nan
    get, put = dual.get, dual.put

    @njit(error_model="numpy")
    def choose(x, out):
        a, b = get(x, 0), get(x, 1)
        put(larger(a, b), out, 0)
        put(smaller(a, b), out, 1)
        put(select(is_nan(a) | (a >= 3.0), 1.0, b), out, 2)

    a, b = np.array([1.0, np.nan, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]), np.full(N, 4.5)
    out = np.empty((3, 2 * N))
    choose(np.array([np.r_[a, np.full(N, 10.0)], np.r_[b, np.full(N, 20.0)]]), out)
    assert np.array_equal(out[0, N:], np.where(a < b, 20.0, 10.0))
    assert np.array_equal(out[1, N:], np.where(a > b, 20.0, 10.0))
    assert np.array_equal(out[0, :N], np.where(a < b, b, a), equal_nan=True)
    assert np.array_equal(out[2, N:], np.where(a == 1.0, 20.0, 0.0))


def test_a_number_put_into_an_array_has_no_derivative():
    put, splat = dual.put, dual.splat

    @njit(error_model="numpy")
    def write(out):
        put(3.0, out, 0)
        put(splat(4.0), out, 1)

    out = np.ones((2, 2 * N))
    write(out)
    assert np.array_equal(out, np.outer([3.0, 4.0], np.r_[np.ones(N), np.zeros(N)]))


def test_the_model_over_duals_has_the_jacobian_that_sympy_derived():
    model = curved()
    plain, duals = compile_model(model, 0.05), compile_model(model, 0.05, duals=True)
    rng = np.random.default_rng(2)
    x, u, p = rng.normal(size=2), rng.normal(size=1), np.array([3.0])
    columns = [np.repeat(v[:, None], N, axis=1) for v in (x, u, p)]
    A, ahead, w = np.empty((2, 2, N)), np.empty((2, N)), np.empty((plain.nw, N))
    plain.kernels.next_jacobian(columns[0], columns[1], plain.constants(columns[2]), ahead, A, w)

    state, given, values = (np.concatenate([c, np.zeros_like(c)], axis=1) for c in columns)
    state[:, N : N + 2] = np.eye(2)
    ahead_dual, w_dual = np.empty((2, 2 * N)), np.empty((duals.nw, 2 * N))
    duals.kernels.next_state(state, given, duals.constants(values), ahead_dual, w_dual)
    assert np.allclose(ahead_dual[:, 0], ahead[:, 0], rtol=1e-14)
    assert np.allclose(ahead_dual[:, N : N + 2], A[:, :, 0], rtol=1e-13)


def test_exchanging_the_numbers_leaves_no_plain_lane_behind():
    text = over_duals(f"from {lanes.__name__} import get\nfrom {lane_math.__name__} import sin\n")
    assert text == f"from {dual.__name__} import get\nfrom {dual_functions.__name__} import sin\n"
