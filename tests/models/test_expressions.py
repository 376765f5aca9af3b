"""The larger and the smaller of two expressions: values, derivatives, code, LaTeX; the shape of a timed change."""

import numpy as np
import pytest
import sympy as sp

from harness.models.assembly.expressions import larger, smaller
from harness.models.effects._timing import progress

A, B = sp.symbols("a b", real=True)


@pytest.mark.parametrize(("function", "reference"), [(larger, max), (smaller, min)])
@pytest.mark.parametrize("modules", ["numpy", "math"])
def test_values_are_those_of_python(function, reference, modules):
    compiled = sp.lambdify((A, B), function(A**2, B + 1), modules)
    for a, b in [(0.5, -2.0), (2.0, 0.3), (-1.0, 0.0), (-3.0, 5.0)]:
        assert compiled(a, b) == reference(a**2, b + 1)
        assert float(function(A**2, B + 1).subs({A: a, B: b})) == reference(a**2, b + 1)


@pytest.mark.parametrize("function", [larger, smaller])
def test_derivatives_match_differences(function):
    expr = function(A**2, sp.sin(B) + A)
    slopes = [
        sp.lambdify((A, B), expr.diff(v), [{"Heaviside": lambda x, h=0.5: np.heaviside(x, h)}, "numpy"]) for v in (A, B)
    ]
    value = sp.lambdify((A, B), expr, "numpy")
    for a, b in [(0.5, -2.0), (2.0, 0.3), (-1.5, 1.0)]:
        assert slopes[0](a, b) == pytest.approx((value(a + 1e-6, b) - value(a - 1e-6, b)) / 2e-6, abs=1e-8)
        assert slopes[1](a, b) == pytest.approx((value(a, b + 1e-6) - value(a, b - 1e-6)) / 2e-6, abs=1e-8)


def test_arguments_are_left_alone_and_print_as_formulas():
    expr = larger((A + B) * (A - B) / (A + B + 1) ** 3, 0)
    assert expr.args[0] == (A + B) * (A - B) / (A + B + 1) ** 3
    assert sp.latex(larger(A, 0)) == r"\max\left(a, 0\right)"
    assert sp.latex(smaller(A, B)) == r"\min\left(a, b\right)"


@pytest.mark.parametrize(("begin", "duration"), [(3.0, 2.0), (0.0, 0.5)])
def test_a_timed_change_follows_the_integral_of_a_raised_cosine(begin, duration):
    time = sp.Symbol("time", real=True)
    change = sp.lambdify(time, progress(time, begin, duration), "math")
    share = np.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 3.0])
    done = [0.0, 0.0, 0.25 - 0.5 / np.pi, 0.5, 0.75 + 0.5 / np.pi, 1.0, 1.0]
    assert [change(begin + duration * s) for s in share] == pytest.approx(done, abs=1e-15)
    rate = [(change(begin + duration * (s + 1e-5)) - change(begin + duration * (s - 1e-5))) / 2e-5 for s in share]
    assert rate == pytest.approx([0.0, 0.0, 1.0, 2.0, 1.0, 0.0, 0.0], abs=1e-8)
