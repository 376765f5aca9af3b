"""The machine code of hot kernels: an upgrade of LLVM or numba that breaks it shows nowhere else but in the clock."""

import math
import platform
import re

import llvmlite.binding as llvm
import numpy as np
import pytest
from numba import njit, types

from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES, get, put
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.runner.contract import Held, InputSeries
from harness.runner.scores import Scoring
from harness.testing.small_models import P0, compiled_linear

X = types.Array(types.float64, 2, "C")
P = types.Array(types.float64, 3, "C")
KERNELS = {
    "next_state": (X, X, X, X, X),
    "leading_part": (X, X, X, X),
    "next_state_behind": (X, X, X, X, X),
    "next_covariance": (X, X, X, P, X, P, X),
}
"""What a simulation, a UKF and an EKF of the semitrailer spend most of their time in."""

LIBM = re.compile(r"\b(?:a?(?:sin|cos|tan)h?|atan2|sincos|exp[2m]?1?|log(?:10|1p|2)?|pow|fmod|floor|sqrt|fma)f?\b(?!:)")
SPILLED = {"skylake-avx512": 0.17, "haswell": 0.19}
"""Stores to the stack per vector instruction: half as much again as now (0.11 with 32 registers, 0.12 with 16)."""


pytestmark = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="counts instructions of x86")


def assembly(dispatcher, arguments, cpu):
    """Return the instructions that a compiled function becomes on a processor."""
    dispatcher.compile(arguments)
    result = dispatcher.overloads[arguments]
    module = llvm.parse_assembly(str(result.library._get_module_for_linking()))  # holds for cached code as well
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(cpu=cpu, opt=3)
    body = machine.emit_assembly(module).split(f"\n{result.fndesc.llvm_func_name}:\n")[1].split("\n.Lfunc_end")[0]
    return re.findall(r"^\t([a-z]\w*\t?.*)$", body, re.MULTILINE)


def scalar_calls(code):
    return {name for line in code if line.startswith(("call", "movabs")) for name in LIBM.findall(line)}


def spilled(code):
    vectors = [line for line in code if re.match(r"v.*%[yz]mm", line)]
    stores = [line for line in vectors if re.match(r"vmov\w+\t%[yz]mm\d+, -?\d*\(%r[sb]p\)", line)]
    return len(stores) / len(vectors)


@pytest.fixture(scope="module")
def semitrailer():
    return compile_model(assemble("semitrailer", "magic_formula").augment(["steering_wheel_angle"])).kernels


@pytest.mark.parametrize("cpu", SPILLED)
@pytest.mark.parametrize("name", KERNELS)
def test_hot_kernels_call_no_library_and_keep_to_their_registers(semitrailer, name, cpu):
    code = assembly(getattr(semitrailer, name), KERNELS[name], cpu)
    assert len(code) > 100
    assert scalar_calls(code) == set()
    assert spilled(code) < SPILLED[cpu]


def test_a_call_and_a_spill_storm_are_seen():
    @njit(error_model="numpy")
    def scalar(x, y):
        for i in range(x.shape[0]):
            for j in range(x.shape[1]):
                y[i, j] = math.exp(x[i, j])

    lines = [f"    x{i} = get(x, {i})" for i in range(64)]
    lines += [f"    put({' * '.join(f'(x{i} + {k}.0)' for i in range(64))}, y, {k})" for k in range(4)]
    names = {"get": get, "put": put}
    exec("def crowded(x, y):\n" + "\n".join(lines), names)
    assert scalar_calls(assembly(scalar, (X, X), "haswell")) == {"exp"}
    assert spilled(assembly(njit(error_model="numpy")(names["crowded"]), (X, X), "haswell")) > 0.0


def users_counted(dispatcher):
    """Return how often a compiled loop counts a user of an array."""
    result = next(iter(dispatcher.overloads.values()))
    name = re.escape(result.fndesc.llvm_func_name)
    text = str(result.library._get_module_for_linking())
    body = re.search(rf'^define [^\n]*@"?{name}"?\(.*?^}}', text, re.MULTILINE | re.DOTALL)[0]
    return body.count("@NRT_incref(")


def test_a_loop_over_time_counts_no_users_of_arrays_at_each_sample():
    """Counting is atomic: of the EKF of the mass study it took a quarter of the time."""
    compiled = compiled_linear()
    estimator, samples = CompiledEstimator("ekf", compiled), 20
    y, truth = np.ones((samples, compiled.ny, LANES)), np.ones((samples, 1, LANES))
    held = Held(np.full((1, LANES), 1.5), *(np.ones((n, LANES)) for n in (3, 2)), np.zeros((3, LANES)), P0)
    record = Scoring(truth, compiled.signal_names, np.full(LANES, 1.0 * samples))
    scores = estimator.run(InputSeries(np.ones((samples, 1, LANES))), y, held, record).scores()
    assert np.isfinite(scores.rmse).all()
    assert users_counted(estimator.loop) < 60  # 35 where it makes its arrays; 145 if it counted at each sample
