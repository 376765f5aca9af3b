"""Estimators of somebody else that cannot run: one line before the study begins, or one that fails at once."""

import sys

import pytest

from harness.common.errors import UserError
from harness.config import build_study
from harness.external.references import installed
from harness.study.evaluate import StudyEvaluator
from harness.testing import check_estimator
from support.observers import CONTENT, OF_THE_LIBRARY, compiled, needs_compiler, source

MODULE = """
import math, sys

class Bare: pass
class Observer:
    inputs, measurements, estimates = ["speed"], ["yaw_rate"], {"yaw_rate": "deg/s"}
    def step(self, u, y, dt): return 0.0
class Misread(Observer): estimates = ["yaw_rat"]
class Unit(Observer): estimates = {"yaw_rate": "kg"}
class Silent(Observer):
    def step(self, u, y, dt): pass
class Divides(Observer):
    def step(self, u, y, dt): return 1.0 / dt
class Two(Observer):
    def step(self, u, y, dt): return [0.0, 1.0]
class Sticky(Observer):
    x = 0.0
    def step(self, u, y, dt): self.x += y[0]; return self.x
class Alone(Observer):
    variances = True
class Exits(Observer):
    def __init__(self): sys.exit(1)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "somebody.py").write_text(MODULE)
    (folder / "broken.py").write_text("import math\nx = = 1\n")
    (folder / "needy.py").write_text("import no_such_package\n")
    (folder / "leaves.py").write_text("import os\nos._exit(5)\n")
    (folder / "libgarbage.so").write_bytes(b"\x7fELF\x02 and nothing more")
    return folder


def evaluator(folder, **settings):
    content = {**CONTENT, "estimator": [{"name": "it", "kind": "external", **settings}]}
    return StudyEvaluator(build_study(content, folder / "study.toml"))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "state one of python, library, fmu, onnx"),
        ({"python": "somebody:Observer", "onnx": "net.onnx"}, "state one of"),
        ({"python": "somebody:Observer", "timeout": "5 m"}, "timeout"),
        ({"python": "somebody:Observer", "timeout": "0 s"}, "timeout: a run takes some time"),
        ({"python": "somebody"}, "write 'module:Class'"),
        ({"python": "nobody:Observer"}, "there is no module 'nobody'"),
        ({"python": "somebody:Observr"}, "has no 'Observr'; there are: Bare, Observer"),
        ({"python": "somebody:Bare"}, "has no step"),
        ({"python": "somebody:Exits"}, r"sys.exit\(1\)"),
        ({"python": "somebody:Observer", "settings": {"gain": 1.0}}, "TypeError"),
        ({"python": "somebody:Misread"}, "estimates: there is no signal 'yaw_rat'; closest: yaw_rate"),
        ({"python": "somebody:Unit"}, "estimates.yaw_rate"),
        ({"python": "somebody:Observer", "inputs": ["sped"]}, "knows no input 'sped'; closest: speed"),
        ({"python": "somebody:Observer", "inputs": "sped"}, "knows no input 'sped'; closest: speed"),
        ({"python": "somebody:Observer", "measurements": ["speed"]}, "measures no 'speed'"),
        ({"python": "somebody:Observer", "values": ["mas"]}, "the belief has no 'mas'; closest: mass"),
        ({"python": "broken:Observer"}, "SyntaxError: invalid syntax"),
        ({"python": "needy:Observer"}, "ModuleNotFoundError: No module named 'no_such_package' .needy.py, line 1."),
        ({"python": "leaves:Observer"}, "ended with status 5"),
        ({"library": "libmissing.so"}, "there is no file"),
        ({"library": "libgarbage.so", **OF_THE_LIBRARY}, "libgarbage.so: cannot be loaded"),
    ],
)
def test_what_cannot_be_loaded_is_an_error_in_one_line(folder, settings, words):
    with pytest.raises(UserError, match=rf"study.toml: estimator\[0\].*{words}") as raised:
        evaluator(folder, **settings)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Silent", "step returned nothing"),
        ("Divides", "ZeroDivisionError"),
        ("Two", "gives 2 estimates, the study states 1"),
        ("Sticky", "its estimate of 'yaw_rate' is no number"),
        ("Alone", r"must return the tuple \(estimates, variances\)"),
    ],
)
def test_what_fails_at_once_does_so_before_the_study(folder, name, words):
    with pytest.raises(UserError, match=f"estimator 'it' fails within the first 3 samples, .*{words}"):
        evaluator(folder, python=f"somebody:{name}").warm_up(1)


@needs_compiler
@pytest.mark.parametrize(
    ("old", "new", "settings", "words"),
    [
        ("harness_reset", "harness_rest", {}, "has no function harness_reset"),
        (".values = 5", ".values = 6", {}, "it has 6 values, the study 5"),
        (".values = 5", ".values = -5", {}, "harness_sizes gives values = -5"),
        ("", "", {"measurements": ["yaw_rate", "lateral_acceleration"]}, "it has 1 measurements, the study 2"),
        ("", "", {"estimates": None}, "state them in its order"),
    ],
)
def test_a_library_that_is_none_or_of_other_sizes(tmp_path, old, new, settings, words):
    compiled(tmp_path, source("observer.c").replace(old, new) if old else source("observer.c"))
    stated = {k: v for k, v in {**OF_THE_LIBRARY, **settings}.items() if v is not None}
    with pytest.raises(UserError, match=words) as raised:
        evaluator(tmp_path, library="libobserver.so", **stated)
    assert "\n" not in str(raised.value)


@needs_compiler
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return 7;", "harness_step returned 7"),
        ("*(volatile int *)0 = 1;", "ended by SIG"),
        ("memset(o, 0, 1 << 28);", "ended by SIG"),
    ],
)
def test_a_library_that_fails_at_once(tmp_path, body, words):
    text = source("observer.c").replace(
        "    estimates[0] = o->v;", f"    if (dt > 0.0) {{ {body} }}\n    estimates[0] = o->v;"
    )
    compiled(tmp_path, text)
    with pytest.raises(UserError, match=words):
        evaluator(tmp_path, library="libobserver.so", **OF_THE_LIBRARY).warm_up(1)


@needs_compiler
def test_a_library_of_another_machine(tmp_path):
    library = compiled(tmp_path, source("observer.c"))
    content = bytearray(library.read_bytes())
    content[4] = 1  # ELF of 32 bits
    library.write_bytes(content)
    with pytest.raises(UserError, match=r"cannot be loaded: .*ELFCLASS32"):
        evaluator(tmp_path, library="libobserver.so", **OF_THE_LIBRARY)


def test_it_is_no_kernel():
    with pytest.raises(UserError, match="'external' is no kernel"):
        check_estimator("external")


def test_installed_modules_have_a_file_and_are_not_imported():
    adapters = installed("harness.external.estimators.adapters:FilterPy")
    assert adapters.name == "adapters.py"
    assert installed("pkg_that_is_not_there.module:Filter") is None
    assert installed("turtledemo.clock:main").name == "clock.py"
    assert "turtledemo" not in sys.modules
