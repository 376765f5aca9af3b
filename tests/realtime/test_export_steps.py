"""The C of every estimator takes the steps of its kernel in Python, and compiles without a warning."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.engine.compile import compile_model
from harness.estimation.contract import kernel_kinds, load_estimator
from harness.realtime.export import source, steps
from harness.testing.small_models import compiled_linear, curved
from support.exports import COMPILER, of_small, region_of_small
from support.observers import needs_compiler
from support.oscillator import compiled as uncertain
from support.oscillator import mass, push

ELSEWHERE = {"imm": "needs unknown parameters", "narx": "needs the semitrailer"}
"""Estimators that other tests export."""

DRAWS = {kind for kind in kernel_kinds() if hasattr(load_estimator(kind), "first_memory")}
PRINTED = sorted({*kernel_kinds()} - {*ELSEWHERE, *DRAWS, "moving_horizon"})
CHECKED = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Wdouble-promotion")


def compared(folder, kind, compiled, count=128, parameter=0.7, **settings):
    """Return the largest difference of each quantity over the steps."""
    export, estimator = of_small(kind, compiled, **settings)
    program = steps.built(export, folder, COMPILER, CHECKED)
    region = replace(region_of_small(compiled), parameters=np.full(len(compiled.model.parameters), parameter))
    points = steps.points(region, 0, count)
    python, measured = steps.in_python(estimator, points)
    c, _ = steps.in_c(program, points, measured, python.memory.shape[2])
    assert np.isfinite(python.mean).all()
    assert np.isnan(measured).any()
    return {name: each.max() for name, each in steps.differences(c, python, region.mean_spread).items()}


@needs_compiler
@pytest.mark.parametrize("kind", PRINTED)
def test_c_takes_the_steps_of_the_kernel(kind, tmp_path):
    off = compared(tmp_path, kind, compiled_linear())
    assert off["used"] == 0
    assert max(off.values()) < 1e-12, off


@needs_compiler
@pytest.mark.parametrize("kind", [kind for kind in PRINTED if not load_estimator(kind).LINEAR])
def test_where_outputs_are_not_linear(kind, tmp_path):
    compiled = compile_model(curved(), 0.05, signals=("product_test",))
    fades = kind == "st_cdkf"  # it fades at these points, and diverges from some that come later
    off = compared(tmp_path, kind, compiled, 16 if fades else 128, **({"softening": 10.0} if fades else {}))
    assert max(off.values()) < 1e-12, off


@needs_compiler
@pytest.mark.parametrize(
    ("kind", "states"),
    [
        ("ekf", [mass()]),
        ("ukf", [push(), mass(considered=True)]),
        ("sr_ekf", [push(walk=0.1)]),
        ("huber_ekf", [mass()]),
    ],
)
def test_parameters_that_are_states(kind, states, tmp_path):
    assert max(compared(tmp_path, kind, uncertain(*states), parameter=1.5).values()) < 1e-12


@needs_compiler
@pytest.mark.parametrize("estimated", [True, False])
def test_a_bank_over_a_parameter(estimated, tmp_path):
    settings = {"hypotheses": {"mass": [0.8, 1.5, 2.5]}, "estimated": estimated}
    off = compared(tmp_path, "imm", uncertain(mass()), parameter=1.5, **settings)
    assert max(off.values()) < 1e-12, off


@needs_compiler
def test_settings_are_in_the_code(tmp_path):
    bold, timid = (of_small("h_infinity", compiled_linear(), bound=b)[0] for b in (0.5, 0.0))
    assert source.source(bold) != source.source(timid)
    assert max(compared(tmp_path, "h_infinity", compiled_linear(), bound=0.5).values()) < 1e-12


@needs_compiler
def test_a_wrong_sign_is_noticed(tmp_path, monkeypatch):
    kept = source.source

    def wrong(export):
        text = kept(export)
        assert "pivot - v * v" in text
        return text.replace("pivot - v * v", "pivot + v * v", 1)

    monkeypatch.setattr(steps, "source", wrong)
    assert max(compared(tmp_path, "ukf", compiled_linear()).values()) > 1e-3


@needs_compiler
def test_single_precision_compiles_and_is_near(tmp_path):
    export, estimator = of_small("ukf", compiled_linear(), precision="float")
    program = steps.built(export, tmp_path, COMPILER, ("-O2", "-Wdouble-promotion"))
    text = (tmp_path / "of_ukf.c").read_text()
    assert "double" not in text.split("typedef")[1]
    points = steps.points(region_of_small(compiled_linear()), 0, 64)
    python, measured = steps.in_python(estimator, points)
    off = steps.differences(steps.in_c(program, points, measured, 0)[0], python, np.ones(3))
    assert 1e-9 < max(each.max() for each in off.values()) < 1e-3


@pytest.mark.skipif(shutil.which("clang") is None, reason="there is no clang")
@pytest.mark.parametrize("kind", PRINTED)
def test_clang_has_no_word_either(kind, tmp_path):
    steps.built(of_small(kind, compiled_linear())[0], tmp_path, "clang")


@pytest.mark.parametrize("kind", PRINTED)
def test_nothing_is_allocated_and_no_library_computes_a_function(kind):
    text = source.source(of_small(kind, compiled_linear())[0])
    called = set(re.findall(r"\b([a-z_0-9]+)\(", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)))
    own = {name for name in called if name.startswith(("k_", "of_", "real_"))}
    assert called - own <= {"for", "if", "power_of_two", "exponent_of", "memset", "memcpy"}
    arithmetic = set(re.findall(r"#define (?:real_\w+) (\w+)", text))
    assert arithmetic == {"fabs", "copysign", "floor", "fma", "sqrt"}


@pytest.mark.parametrize("kind", sorted(DRAWS))
def test_what_draws_random_numbers_is_refused(kind):
    with pytest.raises(UserError, match=rf"'{kind}'.*random numbers"):
        of_small(kind, compiled_linear())


def test_what_has_sizes_that_are_not_known_is_refused():
    with pytest.raises(UserError, match=r"'moving_horizon'.*kernel 'step', line \d+: .*sizes"):
        of_small("moving_horizon", compiled_linear())
