"""Every target of the Makefile and every module that runs is begun by a test, and what it makes is looked at.

A target or a module that is in neither table of ``support/programs.py`` fails the first tests. Commands that README and
docs show are begun by ``test_commands.py`` and run by ``package/test_documented.py``.
"""

import ast
import functools
import math
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support import small_study, synthetic
from support.programs import (
    MODULES,
    PACKAGES,
    PROGRAMS,
    REPORT,
    ROOT,
    TARGETS,
    Begun,
    By,
    Shown,
    Small,
    each,
    expanded,
    modules,
    recipe,
)  # fmt: skip

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")

pytestmark = [
    pytest.mark.skipif(shutil.which("make") is None, reason="there is no make here, as on Windows"),
    pytest.mark.filterwarnings("ignore:.*found in sys.modules"),  # tests of it have imported what runs once more
]


# --- nothing is left out


def test_every_target_has_its_place():
    plain = re.findall(r"^([a-z-]+):(?!=)", MAKEFILE, re.MULTILINE)
    patterns = re.findall(r"^\$\(\w+\): ([a-z-]+%):", MAKEFILE, re.MULTILINE)
    assert {"loop", "fuzz", "bench"} < set(plain)
    assert set(TARGETS) == {*plain, *patterns}


def test_every_module_that_runs_has_its_place():
    assert {"bench.gallery", "bench.tuning"} < set(targets_of())
    assert {*targets_of(), *MODULES} >= PROGRAMS
    assert set(MODULES) <= PROGRAMS


def test_what_looks_as_if_it_ran_does():
    """A module with a ``main`` and nothing that calls it ends at once, and with success."""
    mains = {n for n, tree in modules() for d in tree.body if isinstance(d, ast.FunctionDef) and d.name == "main"}
    assert mains - PROGRAMS == set()
    texts = [MAKEFILE, *(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))]
    texts += [path.read_text(encoding="utf-8") for part in PACKAGES for path in (ROOT / part).rglob("*.py")]
    ran = rf"-m\"?,? \"?((?:{'|'.join(PACKAGES)})(?:\.\w+)*)(?![.\w])"
    called = {name for text in texts for name in re.findall(ran, text)}
    assert len(called) > 20
    assert called - PROGRAMS == set()


@pytest.mark.parametrize("name", [name for name, way in (TARGETS | MODULES).items() if isinstance(way, By)])
def test_the_test_that_begins_it_is_there(name):
    file, _, function = (TARGETS | MODULES)[name].test.partition("::")
    if not function:
        assert f"make {name}\n" in (ROOT / file).read_text(encoding="utf-8")
        return
    assert f"def {function}(" in (ROOT / "tests" / file).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [name for name, way in TARGETS.items() if isinstance(way, Shown)])
def test_what_nobody_begins_here_can_be_read(name):
    done = subprocess.run(
        ["make", "-n", "-B", "-C", str(ROOT), "PYTHON=python3", name], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "pip" in done.stdout


# --- what they do


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """Work in a checkout of its own, with the files that programs name by their path and no result."""
    folder = tmp_path / "checkout"
    for part in ("studies", "docs"):
        shutil.copytree(ROOT / part, folder / part)
    (folder / "results").mkdir()
    (folder / "small.toml").write_text(small_study.STUDY, encoding="utf-8")
    monkeypatch.chdir(folder)
    settings = {"COLUMNS": "200", "MPLBACKEND": "Agg", "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}
    for name, value in (settings | {"NUMBA_ENABLE_CUDASIM": "1"}).items():
        monkeypatch.setenv(name, value)
    return folder


def run(module: str, arguments: list[str], monkeypatch) -> int:
    """Run a module as ``python -m`` does, in this process, and return its exit status."""
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def see(way: Small, programs: list[tuple[str, list[str]]], monkeypatch, capfd) -> None:
    """Run programs and look at what they say and write."""
    statuses = []
    for module, arguments in programs:
        if way.apart:
            command = [sys.executable, "-m", module, *arguments]
            statuses.append(subprocess.run(command, stdin=subprocess.DEVNULL, check=False).returncode)
        else:
            statuses.append(run(module, arguments, monkeypatch))
    said = "".join(capfd.readouterr())
    assert statuses == [0] * len(programs), said[-3000:]
    found = re.search(way.says, said)
    assert found, said[-3000:]
    assert all(math.isfinite(float(number)) for number in found.groups())
    assert [name for name in way.writes if not Path(name).stat().st_size] == []


def reached(way: Begun, programs: list[tuple[str, list[str]]], monkeypatch) -> str:
    """Run programs until their work begins; return what it is given there."""
    given = []

    def stop(*arguments, **named):
        given.append(f"{arguments} {named}")
        raise RuntimeError("the work would begin")

    monkeypatch.setattr(way.at, stop)
    for module, arguments in programs:
        try:
            run(module, arguments, monkeypatch)
        except RuntimeError:
            continue
    return " ".join(given)


@pytest.mark.parametrize(("target", "way"), each(Small, TARGETS))
def test_a_target_does_its_work(target, way, checkout, monkeypatch, capfd):
    see(way, recipe(target, way.given), monkeypatch, capfd)


@pytest.mark.parametrize(("module", "way"), each(Small, MODULES))
def test_a_module_does_its_work(module, way, checkout, monkeypatch, capfd):
    see(way, [(module, shlex.split(way.given))], monkeypatch, capfd)


@pytest.mark.parametrize(("target", "way"), each(Begun, TARGETS))
def test_a_target_begins_its_work(target, way, checkout, monkeypatch):
    says = way.says.replace("{stem}", target.removeprefix("study-"))
    assert re.search(says, reached(way, recipe(target, way.given), monkeypatch))


@pytest.mark.parametrize(("module", "way"), each(Begun, MODULES))
def test_a_module_begins_its_work(module, way, checkout, monkeypatch):
    assert re.search(way.says, reached(way, [(module, shlex.split(way.given))], monkeypatch))


def test_help_names_every_target():
    done = subprocess.run(["make", "-C", str(ROOT), "help"], capture_output=True, text=True, check=True)
    for name in {name for key in TARGETS for name in expanded(key)} - {"help"}:
        assert re.search(rf"(?<![\w-]){name}(?![\w-])", done.stdout) or name.startswith("study-"), name
    assert re.search(r"\bstudy-mass\b", done.stdout)


@functools.cache
def targets_of() -> dict[str, set[str]]:
    """Return the targets that run a module, one of each pattern, by the module."""
    found: dict[str, set[str]] = {}
    for target in (expanded(key)[0] for key in TARGETS):
        for module, _ in recipe(target, ""):
            found.setdefault(module, set()).add(target)
    return found


def parsed() -> list[str]:
    """Return the modules that say what they take; the others are begun by another program, or need what is not here."""
    silent = {
        "harness",
        "harness.cli.main",
        "bench.card",
        "bench.peers",
        "bench.faults.child",
        "harness.external.worker",
        "bench.attribution.changed_criteria",
    }
    return sorted(PROGRAMS - silent)


@pytest.mark.parametrize("module", parsed())
def test_help_says_what_a_module_takes(module, checkout, monkeypatch, capsys):
    """And that is all that the Makefile gives it."""
    if module == "bench.notebooks":
        pytest.importorskip("nbclient", reason="only `make notebooks` installs what runs notebooks")
    assert run(module, ["--help"], monkeypatch) == 0
    said = capsys.readouterr().out
    assert "usage: " in said
    taken = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", said))
    for target in targets_of().get(module, ()):
        variables = [
            f"{v}=1" for v in re.findall(r"\$\((?:if|or) \$\((\w+)\)", MAKEFILE) if v not in ("PEERS", "DEVICE")
        ]
        given = [w for name, words in recipe(target, shlex.join(variables)) if name == module for w in words]
        assert {w for w in given if w.startswith("-")} <= taken


def test_the_peers_are_measured_where_they_are_installed():
    pytest.importorskip("jax", reason="only `make bench PEERS=1` installs the other libraries")
    command = [sys.executable, "-m", "bench.peers", "--help"]  # it keeps its process to one core
    assert "usage: " in subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_all_studies_are_run_and_gathered():
    """Those of a recording, which is not part of the project, are left out."""
    programs = [words for module, words in recipe("studies", "") if module == "harness"]
    there = {path.name for path in (ROOT / "studies").glob("*.toml") if "from_file" not in path.read_text("utf-8")}
    assert {Path(words[1]).name for words in programs if words[0] == "run"} == there
    assert [words[:2] for words in programs[-1:]] == [["campaign", "results"]]


def made(target: str, folder: Path) -> str:
    """Make a target in a checkout of its own with the packages that are here; return what it prints."""
    shutil.copy(ROOT / "Makefile", folder)
    stamps = [word for name in ("run", "dev") for word in ("-o", f".venv/{name}.stamp")]
    command = ["make", *stamps, f"BIN={Path(sys.executable).parent}", target]
    environment = os.environ | {"HARNESS_CACHE": str(folder / "cache")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.proof
def test_reports_are_written_again(checkout):
    synthetic.write(checkout / "results" / "mass", {"level": synthetic.design(repeats=3, drives=synthetic.DRIVES[:2])})
    (checkout / "results" / "notes").mkdir()
    said = made("report", checkout)
    assert [Path(line).name for line in said.splitlines() if line.startswith("results/mass/")] == list(REPORT)
    assert (checkout / "results" / "mass" / "report.pdf").stat().st_size > 10_000


def test_clean_removes_results_and_keeps_the_environment(checkout):
    for name in (
        "results/README.md",
        "results/mass/report.html",
        ".pytest_cache/x",
        ".venv/x",
        "cache/filter_01234567.py",
    ):
        (checkout / name).parent.mkdir(parents=True, exist_ok=True)
        (checkout / name).write_text("")
    assert "1 files" in made("clean", checkout)
    left = {
        str(path.relative_to(checkout))
        for part in ("results", ".venv", "cache")
        for path in (checkout / part).rglob("*")
    }
    assert left == {"results/README.md", ".venv/x"}
    assert not (checkout / ".pytest_cache").exists()


@pytest.mark.proof
def test_the_audit_counts_what_it_finds(checkout, monkeypatch, capsys):
    """The packages of the documentation may be absent here, so there may be findings; each is a line."""
    status = run("bench.supply", [], monkeypatch)
    *findings, last = capsys.readouterr().out.splitlines()
    counts = re.fullmatch(r"(\d+) pins: .*: (\d+) findings", last)
    assert counts
    assert int(counts[1]) > 100
    assert int(counts[2]) == len(findings)
    assert status == bool(findings)
