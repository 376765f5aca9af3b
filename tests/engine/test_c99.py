"""Kernels printed as C compute what Python computes of their source, and say in one line what has no C."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.engine.c99 import values as v
from harness.engine.c99.program import Program
from harness.engine.c99.values import Array, Root
from harness.realtime.export.source import _EXPONENT, _LAYOUT, _POWER, _PRELUDE, _filled
from support import printed_kernels as kernels
from support.observers import C_COMPILER, needs_compiler

SIZE = 5
X = np.array([[0.3, -0.7, 1.9, 0.0, np.nan], [-2.0, 0.4, 0.1, 5.0, 1.0], [1.5, 0.6, -0.2, 2.0, 0.5]])


def printed(function):
    """Return C of a kernel on ``x`` and ``y``."""
    program = Program("a kernel")
    arrays = [Array("real", (SIZE, 1), Root(name), v.whole(0)) for name in ("x", "y")]
    _, lines = program.statements(function, arrays)
    return "\n".join(program.needed(lines)), "\n".join(lines)


NUMBERS = {
    "get": lambda array, *at: array[at][0],
    "select": lambda condition, yes, no: yes if condition else no,
    "splat": float,
    "any_of": bool,
    "is_nan": lambda x: x != x,
    "maximum": lambda a, b: b if a < b else a,
    "exp": lambda x: 0.0 if x < -708 else float(np.exp(x)),
    "log": lambda x: float(np.log(x)),
    "tanh": np.tanh,
    "sqrt": np.sqrt,
    "LANES": 1,
}


def put(value, array, *at):
    array[at][0] = value


def in_python(function, x):
    """Return what a kernel writes, run by Python with plain numbers."""
    source = Path(kernels.__file__).read_text(encoding="utf-8").replace("& ~(", "and not (")
    names = {"__name__": "plain"}
    exec(compile(source, "plain", "exec"), names)
    names.update(NUMBERS, put=put)
    y = np.zeros((SIZE, 1))
    names[function.__name__](x[:, None].copy(), y)
    return y[:, 0]


@needs_compiler
@pytest.mark.parametrize("function", kernels.KERNELS, ids=lambda f: f.__name__)
def test_c_computes_what_python_does(function, tmp_path):
    functions, lines = printed(function)
    bits = [_filled(t, _LAYOUT["double"]) for t, n in ((_POWER, "power_of"), (_EXPONENT, "nt_of")) if n in functions]
    main = "int main(void) {\n    double x[5], y[5] = {0.0};\n    while (fread(x, sizeof x, 1, stdin) == 1) {\n"
    main += (
        f"        memset(y, 0, sizeof y);\n{lines}\n        fwrite(y, sizeof y, 1, stdout);\n    }}\n    return 0;\n}}"
    )
    include = "".join(f"#include <{h}.h>\n" for h in ("math", "stdbool", "stdint", "stdio", "string"))
    text = "\n\n".join([include, _PRELUDE["double"], *bits, functions, main]) + "\n"
    (tmp_path / "kernel.c").write_text(text)
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O1", "-fsanitize=undefined"]
    subprocess.run([C_COMPILER, *flags, "kernel.c", "-o", "kernel", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "kernel"], input=X.tobytes(), capture_output=True, check=True)
    with np.errstate(all="ignore"):
        right = np.array([in_python(function, x) for x in X])
    np.testing.assert_allclose(np.frombuffer(done.stdout).reshape(X.shape), right, rtol=1e-14, atol=0)


@pytest.mark.parametrize("function", kernels.REFUSED, ids=lambda f: f.__name__)
def test_what_has_no_c_is_said_in_one_line(function):
    with pytest.raises(UserError) as refused:
        printed(function)
    assert kernels.REFUSED[function] in str(refused.value)
    assert str(refused.value).startswith("a kernel: ")
    assert "\n" not in str(refused.value)


def test_a_function_is_printed_once_for_each_size():
    functions, _ = printed(kernels.early)
    assert functions.count("static real k_sign_of(") == 1
    assert "k_sign_of_2" not in functions
