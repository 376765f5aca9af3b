"""The text of a model names what its kernels follow from, and their source is derived once for it."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
import sympy as sp

from harness.engine import compile as compiler
from harness.engine.codegen.identity import identity
from harness.models.assembly.assemble import assemble
from harness.models.assembly.expressions import larger, smaller
from harness.testing.small_models import linear

SCRIPT = """
import hashlib
from harness.engine.codegen.identity import identity
from harness.models.assembly.assemble import assemble
text = identity(assemble("semitrailer", "magic_formula", ("crosswind", "road_bank"), optional=True))
print(hashlib.sha256(text.encode()).hexdigest())
"""


def test_every_process_has_the_same_text():
    """Sets and dictionaries of SymPy are in another order where strings have other hashes."""
    found = {
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1


def test_whatever_differs_between_models_is_in_their_texts():
    model, x = linear(), sp.Symbol("x")
    first, *others = model.derivatives
    texts = [
        identity(replace(model, derivatives=(rate, *others)))
        for rate in (first, 1.0000001 * first, first + x, first + larger(x, 0), first + smaller(x, 0))
    ]
    texts += [identity(replace(model, name="another")), identity(replace(model, discrete=True))]
    assert len(set(texts)) == len(texts)
    assert identity(linear()) == texts[0]


def test_a_function_is_known_by_the_source_of_its_class(tmp_path, monkeypatch):
    """Printer and derivatives ask the class, so a changed class is another model."""
    monkeypatch.syspath_prepend(tmp_path)
    texts = []
    for factor in (2, 3):
        name = f"own_function_{factor}"
        (tmp_path / f"{name}.py").write_text(
            "import sympy as sp\n\nclass steep(sp.Function):\n"
            f"    def fdiff(self, argindex=1):\n        return sp.Integer({factor})\n"
        )
        steep = __import__(name).steep
        texts.append(identity(replace(linear(), ports={"alpha": steep(sp.Symbol("x"))})))
    first, second = (text.replace("own_function_2", "own_function_3") for text in texts)
    assert first != second


def test_a_function_without_a_file_has_no_text():
    class steep(sp.Function):
        """Made at a prompt."""

    steep.__module__ = "__main__"
    assert identity(replace(linear(), ports={"alpha": steep(sp.Symbol("x"))})) is None


def test_equations_are_derived_once_for_all_processes(tmp_path, monkeypatch):
    """The source is that of the first derivation, and other settings have their own."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    derived = []
    real = compiler.derive
    monkeypatch.setattr(compiler, "derive", lambda model, *rest: (derived.append(model.name), real(model, *rest))[1])
    model, step = assemble("semitrailer", "linear"), 0.01

    def source(step):
        compiler._source.cache_clear()
        return compiler._source(model, (), (), True, step, "euler", 1)

    first = source(step)
    assert source(step) == first
    assert len(derived) == 1
    assert source(0.02) != first
    assert len(derived) == 2
    damaged = next((tmp_path / "kernels").iterdir())
    damaged.write_bytes(damaged.read_bytes()[:-1])
    assert {source(step), source(0.02)} >= {first}
    assert len(derived) == 3


@pytest.fixture(autouse=True)
def _forget():
    yield
    compiler._source.cache_clear()
