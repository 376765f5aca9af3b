"""Kernels specialised for known sizes: the same results, with loops of known length written out."""

import ast
import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.cuda.specialise import LONGEST, specialised

MODULE = """
import numpy as np
from types import SimpleNamespace


def compiled(function):
    return SimpleNamespace(py_func=function, __name__=function.__name__)


cuda = SimpleNamespace(local=SimpleNamespace(array=lambda shape, kind: np.zeros(shape)))
float64 = float
WRITTEN_FOR_CARDS = True
N, MANY = 3, 40
TABLE = np.array([[2, 0, -1], [1, -1, -1]])


@compiled
def weighted(rows, table, a, n):
    total = 0.0
    for c in range(n):
        j = table[a, c]
        if j < 0:
            break
        if c == 0:
            total = total + 10.0 * rows[j, 0]
        else:
            total = total + rows[j, 0]
    return total


@compiled
def entry(samples, start, out):
    rows = cuda.local.array((3, 1), float64)
    last = -1
    for i in range(rows.shape[0]):
        rows[i, 0] = start + i
    for k in range(samples):
        for i in range(N):
            rows[i, 0] = rows[i, 0] + k * i
        for a in range(TABLE.shape[0]):
            out[k, a] = weighted(rows, TABLE, a, rows.shape[0])
        last = k
    for m in range(MANY):
        out[0, 0] = out[0, 0] + m
    out[1, 0] = out[1, 0] + last
"""


@pytest.fixture
def module(tmp_path):
    def made(source: str):
        path = tmp_path / f"kernels_{len(sys.modules)}.py"
        path.write_text(source)
        spec = importlib.util.spec_from_file_location(path.stem, path)
        found = importlib.util.module_from_spec(spec)
        sys.modules[path.stem] = found
        spec.loader.exec_module(found)
        return found

    return made


def run(text: str, module, name: str, *arguments):
    """Run a function of a specialised module as Python."""
    body = text.split("\n\n\n", 1)[1]
    names = {**vars(module), "forced": lambda f: f, "inlined": lambda f: f}
    exec(body, names)
    return names[name](*arguments)


def general(module):
    """Return the entry of a module as Python."""
    for name, value in list(vars(module).items()):
        if isinstance(value, SimpleNamespace) and hasattr(value, "py_func"):
            setattr(module, name, value.py_func)
    return module.entry


def test_the_same_numbers_without_loops_of_known_length(module) -> None:
    text = specialised(module(MODULE), "entry")
    loops = [n.iter for n in ast.walk(ast.parse(text)) if isinstance(n, ast.For)]
    assert [ast.unparse(each) for each in loops] == ["range(samples)", "range(40)"]
    assert LONGEST < 40
    found, wanted = np.zeros((4, 2)), np.zeros((4, 2))
    run(text, module(MODULE), "entry", 4, 0.5, found)
    general(module(MODULE))(4, 0.5, wanted)
    np.testing.assert_array_equal(found, wanted)
    assert np.abs(found).min() > 0


def test_a_function_is_copied_for_what_is_known_of_its_arguments(module) -> None:
    text = specialised(module(MODULE), "entry")
    copies = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef) and n.name.startswith("weighted")]
    assert len(copies) == 2  # one for each row of the table, whose columns are numbers there
    assert not any(isinstance(n, (ast.For, ast.If)) for copy in copies for n in ast.walk(copy))


def test_a_loop_left_by_an_unknown_condition_stays(module) -> None:
    source = MODULE.replace("if j < 0:", "if rows[j, 0] < 0.0:")
    text = specialised(module(source), "entry")
    assert any(isinstance(n, ast.Break) for n in ast.walk(ast.parse(text)))
    found, wanted = np.zeros((4, 2)), np.zeros((4, 2))
    run(text, module(source), "entry", 4, -0.5, found)
    general(module(source))(4, -0.5, wanted)
    np.testing.assert_array_equal(found, wanted)


def test_a_name_with_two_meanings_is_refused(module) -> None:
    other = module("import statistics as np\n" + MODULE.partition("import numpy as np\n")[2].replace(
        "np.zeros(shape)", "None").replace("TABLE = np.array([[2, 0, -1], [1, -1, -1]])", ""
    ).replace("for a in range(TABLE.shape[0])", "for a in range(0)") + """

@compiled
def further(x):
    return np.mean(x)
""")  # fmt: skip
    source = MODULE.replace("    last = -1\n", "    last = further(np.zeros(1))\n").replace(
        "float64 = float\n", f"float64 = float\nfrom {other.__name__} import further\n"
    )
    with pytest.raises(ModelError, match="'np' means something else"):
        specialised(module(source), "entry")
