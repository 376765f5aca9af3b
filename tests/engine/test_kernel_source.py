"""Kernels are put together from what their files say, whatever these are called; what is missing is named."""

import importlib
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import harness.estimation.methods
from harness.common.errors import ModelError
from harness.engine import kernel_names
from harness.engine.compile import compile_model, in_one_lane, over_duals, paste
from harness.engine.kernel_source import kernel_source
from harness.engine.simd import (
    dual as dual_lanes,
)
from harness.engine.simd import (
    lanes,
    linalg,
)
from harness.engine.simd import (
    random as lane_random,
)
from harness.estimation.contract import kernels_of, load_estimator
from harness.estimation.methods import _sigma_points, ukf
from harness.runner import scores
from harness.runner.filter_loop import BATCH
from harness.testing.small_models import compiled_linear, linear

ROOT = Path(__file__).parents[2]


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a module of its own and import it."""
    monkeypatch.syspath_prepend(tmp_path)
    written = []

    def write(name, text):
        (tmp_path / f"{name}.py").write_text(text)
        importlib.invalidate_caches()
        written.append(name)
        return importlib.import_module(name)

    yield write
    for name in written:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def compiled():
    return compiled_linear()


def copied(module, **instead):
    """Return the text of a module that imports from other modules."""
    text = Path(module.__file__).read_text(encoding="utf-8")
    for old, new in instead.items():
        text = re.sub(rf"from [\w.]*\b{old} import", f"from {new} import", text)
    return text


def definitions(source):
    return set(re.findall(r"^def (\w+)", source, re.MULTILINE))


def test_an_estimator_in_the_registry_shares_a_file_of_any_name(compiled, tmp_path, monkeypatch):
    monkeypatch.setattr(harness.estimation.methods, "__path__", [*harness.estimation.methods.__path__, str(tmp_path)])
    (tmp_path / "spread.py").write_text(copied(_sigma_points))
    (tmp_path / "filter_of_mine.py").write_text(copied(ukf, _sigma_points="harness.estimation.methods.spread"))
    importlib.invalidate_caches()
    files = [load_estimator(kind) for kind in ("filter_of_mine", "ukf")]
    mine, own = (
        paste(compiled, "", [scores.run_and_score], kernels_of(file) | BATCH | scores.SCORES) for file in files
    )
    assert {"propagate", "observe", "displace", "workspace"} <= definitions(mine)
    assert mine == own


def test_algebra_of_any_name_is_generated_over_duals_and_for_one_lane(write):
    mine = write("algebra_of_mine", copied(linalg))
    text = "from algebra_of_mine import deviations\n"
    dual, narrow = over_duals(text), in_one_lane(text)
    for source, width in ((dual, dual_lanes.LANES), (narrow, 1)):
        made = sys.modules[re.fullmatch(r"from (\w+) import deviations\n", source)[1]]
        assert made is not mine
        images, mean = np.zeros((1, 1, width)), np.zeros((1, width))
        images[..., : lanes.LANES], images[..., lanes.LANES :], mean[..., : lanes.LANES] = 4.0, 3.0, 1.0
        made.deviations(images, mean, 1)
        assert images[0, 0].tolist() == [3.0] * width


def test_machine_code_for_plain_lanes_is_refused_over_duals(write):
    write("random_of_mine", copied(lane_random))
    with pytest.raises(ModelError, match=r"random_of_mine\.py: it writes machine code for plain lanes"):
        over_duals("from random_of_mine import uniform\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def f(x):\n    return helper(x)\n", r"'f' in .*probe\.py uses 'helper', which is defined nowhere"),
        ("from math import inf\ndef f(x):\n    return inf\n", r"uses 'inf', which is inf; write np.inf"),
        ("WORDS = {'a': 1}\ndef f(x):\n    return WORDS\n", r"uses 'WORDS', a dict, which cannot be compiled in"),
        ("f = lambda x: x\n", r"no function that a kernel can be made of"),
        (
            "def g():\n    def f(x):\n        return x\n    return f\nf = g()\n",
            r"must be defined at the top level of its",
        ),
        (
            "from harness.runner.filter_loop import step\ndef f(x):\n    step(x)\n",
            r"uses 'step', which the module .* not define",
        ),
        (
            "from harness.engine.kernel_names import NX\ndef f(x):\n    return NX\n",
            r"uses 'NX', which the module .* not define",
        ),
        (
            "from harness.runner import simulation_loop as loops\ndef f(x):\n    loops.outside(x)\n",
            r"'loops.outside', a function to be imported",
        ),
        (
            "from harness.runner.scores import keep_targets as keep\n"
            "def put(x):\n    pass\ndef f(x):\n    keep(x)\n    put(x)\n",
            r"'put' means som",
        ),
    ],
)
def test_what_no_kernel_can_use_is_named_with_its_file(write, compiled, text, message):
    probe = write("probe", text)
    kernels = compiled.kernels if "keep" in text else None
    with pytest.raises(ModelError, match=message):
        kernel_source("probe", [probe.f], kernels)


def test_a_model_without_derivatives_lacks_what_a_filter_needs(write):
    plain = compile_model(linear(), 0.05, jacobians=False)
    probe = write(
        "probe", "from harness.engine.kernel_names import SEEN_STATES as seen\ndef f(x):\n    return seen[0, 0]\n"
    )
    with pytest.raises(ModelError, match="uses 'seen', which the module that it is compiled in does not define"):
        kernel_source("probe", [probe.f], plain.kernels)


def test_numbers_modules_and_other_names_come_along(write, compiled):
    text = (
        "import numpy as np\nfrom harness.engine.kernel_names import LANES, NX as length, StandIn, get as read\n"
        "LIMIT = 2.5\n@StandIn\ndef hook():\n    pass\ndef mine():\n    return LIMIT\n"
        "def f(x):\n    return np.sqrt(hook()) + read(x, 0) * LANES * length\n"
    )
    probe = write("probe", text)
    source = kernel_source("probe", [probe.f], compiled.kernels, {probe.hook: probe.mine})
    assert "LIMIT = 2.5\n" in source
    assert source.endswith("\nhook = mine\n")
    assert f"from {compiled.kernels.__name__} import NX as length\n" in source
    assert f"from {lanes.__name__} import LANES, get as read\n" in source
    with pytest.raises(RuntimeError, match="'hook' exists in compiled modules only"):
        probe.hook()
    assert kernel_names.NX.name == "NX"


MOVED = {
    "harness/engine/simd/lanes.py": "vectors",
    "harness/engine/simd/dual.py": "gradients",
    "harness/engine/simd/functions.py": "elementary",
    "harness/engine/simd/linalg.py": "matrices",
    "harness/engine/kernel_names.py": "names_of_kernels",
    "harness/runner/filter_loop.py": "over_time",
    "harness/common/sources.py": "texts",
    "harness/estimation/methods/_sigma_points.py": "spread",
    "harness/identification/time_loops.py": "over_recordings",
    "harness/models/assembly/expressions.py": "terms",
}

RUN = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from harness.testing.small_models import linear
from harness.common import sources
from harness.study import evaluate
from harness.engine.compile import compile_model, load_source, paste
from harness.estimation.contract import kernels_of, load_estimator
from harness.estimation.methods import ukf
from harness.identification import time_loops as kernels
from harness.runner.filter_loop import RECORDING
from harness.engine.compile import in_one_lane

plain, duals = (compile_model(linear(), 0.05, signals=("beta_test",), duals=d) for d in (False, True))
given = kernels_of(load_estimator("ukf"))
likelihood = {**given, **RECORDING, **kernels.Likelihood(kernels.note_slopes, ()).recorder.kernels}
slopes = paste(duals, "slopes", [kernels.innovate, kernels.follow], likelihood)
narrow = in_one_lane(paste(plain, "narrow", [ukf.workspace, ukf.step], given))
print([sorted(vars(load_source(*made))) for made in (("slopes", slopes), ("narrow", narrow))])
print([load_source(*made).LANES for made in (("slopes", slopes), ("narrow", narrow))])
x, ahead = np.ones((3, 16)), np.zeros((3, 16))
duals.kernels.next_state(x, np.zeros((1, 16)), np.ones((duals.nc, 16)), ahead, np.zeros((duals.nw, 16)))
print(ahead.tolist())
print(sources.digest([evaluate, ukf]))
"""


def renamed(text, moved):
    """Return a file's text with its import statements as after a move."""
    for old, other in moved.items():
        package, _, name = old.removesuffix(".py").replace("/", ".").rpartition(".")
        text = re.sub(rf"\bfrom {package}\.{name} import", f"from {package}.{other} import", text)
        statement = re.compile(rf"^ *from {package} import (?:\([^)]*\)|[^(\n]*)$", re.MULTILINE)
        alias = re.compile(rf"(?<= ){name}( as \w+)?(?=,|$)", re.MULTILINE)
        replacement = partial(lambda found, n, o: o + (found[1] or f" as {n}"), n=name, o=other)
        text = statement.sub(partial(lambda found, a, r: a.sub(r, found[0]), a=alias, r=replacement), text)
    return text


@pytest.mark.proof
def test_renaming_modules_changes_nothing_but_import_statements(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "harness", copy / "harness", ignore=shutil.ignore_patterns("__pycache__"))
    for old, new in MOVED.items():
        (copy / old).rename((copy / old).with_stem(new))
    for path in copy.rglob("*.py"):
        path.write_text(renamed(path.read_text(), MOVED))
        assert re.search(r"^from harness\.engine\.simd\.lanes ", path.read_text(), re.MULTILINE) is None

    def run(root, script):
        path = tmp_path / f"run_{root.name}.py"
        path.write_text(script)
        environment = {"PYTHONPATH": str(root), "HARNESS_CACHE": str(tmp_path / "cache"), "PATH": "/usr/bin:/bin"}
        done = subprocess.run(
            [sys.executable, str(path), str(ROOT / "tests")], env=environment, cwd=root, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    before, after = run(ROOT, RUN), run(copy, renamed(RUN, MOVED))
    assert before[1] == "[16, 1]"
    assert after == before
