"""The public names: lazy, documented, with examples that run."""

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import harness

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


def imported(statements):
    """Return what a fresh interpreter has imported after some statements, and the processor time of the first in s."""
    code = (
        "import sys, time; begun = time.process_time(); import harness; print(time.process_time() - begun); "
        f"{statements}; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    seconds, modules = done.stdout.splitlines()
    return float(seconds), set(modules.split())


def test_importing_the_harness_imports_nothing_and_takes_no_time():
    seconds, modules = imported("dir(harness)")
    assert not modules & {"numba", "numpy", "sympy", "scipy", "xarray", "pandas", "matplotlib", "typer"}
    assert seconds < 0.3


def test_nothing_is_compiled_before_a_model_is_run():
    _, modules = imported(
        "harness.model('car', 'govindarajan_2018').parameters; harness.drive('sine'); harness.levels('mass', [1]); "
        "harness.Study; harness.Diagnosis; harness.identify; harness.read_recording"
    )
    assert {"sympy", "pandas", "xarray"} <= modules
    assert not {"numba", "matplotlib", "typer"} & modules


def test_an_unknown_name_lists_those_that_there_are():
    with pytest.raises(AttributeError, match=r"no attribute 'modle'; it offers Check, Diagnosis, .*, model, "):
        _ = harness.modle


def test_every_public_name_is_on_the_page_and_no_other():
    table = PAGE.split("| for | names |")[1].split("\n\n")[0]
    assert sorted(re.findall(r"`(\w+)`", table)) == harness.__all__


@pytest.mark.parametrize("name", harness.__all__)
def test_every_public_name_and_method_is_documented(name):
    found = getattr(harness, name)
    members = [found]
    if inspect.isclass(found):
        own = [m for n, m in vars(found).items() if not n.startswith("_")]
        members += [m for m in own if callable(m) or isinstance(m, property)]
    assert all(inspect.getdoc(m) for m in members)
    if inspect.isfunction(found):
        assert re.search(r"^Example:", inspect.getdoc(found), re.MULTILINE)


@pytest.mark.parametrize("module", sorted({m for m in harness._PLACES if m.startswith("harness.api")}))
def test_every_example_runs(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testmod(importlib.import_module(module), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert tried
    assert not failed


def test_the_examples_of_the_page_run(tmp_path, monkeypatch):
    """From nothing to a box plot in at most six lines, and the rest of the page in its order."""
    import matplotlib as mpl

    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    cells = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    first = [line for line in cells[0].splitlines() if line.strip()]
    assert len(first) <= 6
    names = {}
    for cell in cells:
        exec(compile(cell, "docs/api.md", "exec"), names)
    boxes = names["axes"].patches or names["axes"].lines
    assert len(boxes) >= 6
