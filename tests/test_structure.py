"""The tree as docs/structure.md has it: nothing too long, every part in its place; `make lint` holds the imports."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOPS = ("harness", "models", "reproductions", "bench", "tests")
OURS = ("harness", "reproductions")
"""What keeps to the rules of how files are written and stores are opened."""
BESIDE = {"bench", "blind", "contracts", "package", "reproductions", "support"}
"""Folders of tests that stand for no package of the harness."""
LONGEST_MODULE, LONGEST_FUNCTION = 450, 80
PARAMETERS, OF_KERNELS = 10, 14
STARTED = Path("harness/cuda/loops.py")
"""Kernels that are started on a card, which takes arrays one by one."""

OF_TESTS = Path("tests/support/largest_nis.py")
"""Kernels of a test."""

FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef


def files(*tops: str) -> list[Path]:
    """Return the Python files of some folders; those of ``harness/models`` are those of ``models``."""
    found = (p.relative_to(ROOT) for top in tops for p in (ROOT / top).rglob("*.py"))
    return sorted(p for p in found if p.parts[:2] != ("harness", "models"))


def functions(path: Path) -> Iterator[FUNCTION]:
    return (n for n in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))) if isinstance(n, FUNCTION))


def parameters(function: FUNCTION) -> list[ast.arg]:
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return [a for a in named if a is not None and a.arg not in ("self", "cls")]


def allowed(path: Path, function: FUNCTION) -> float:
    """Return how many parameters a function may have: what is compiled, and takes arrays only, a few more."""
    if path == STARTED:
        return float("inf")
    compiled = (path.parts[0] in OURS or path == OF_TESTS) and not any(a.annotation for a in parameters(function))
    return OF_KERNELS if compiled else PARAMETERS


def test_no_module_is_too_long():
    lengths = {str(p): len((ROOT / p).read_text(encoding="utf-8").splitlines()) for p in files(*TOPS)}
    assert {p: n for p, n in lengths.items() if n > LONGEST_MODULE} == {}


def test_no_function_is_too_long_or_has_too_many_parameters():
    wrong = []
    for path in files(*TOPS):
        for f in functions(path):
            lines, count = f.end_lineno - f.lineno + 1, len(parameters(f))
            if lines > LONGEST_FUNCTION:
                wrong.append(f"{path}:{f.lineno} {f.name}: {lines} lines")
            if count > allowed(path, f):
                wrong.append(f"{path}:{f.lineno} {f.name}: {count} parameters")
    assert wrong == []


@pytest.mark.parametrize(
    ("path", "text", "limit"),
    [
        ("harness/cuda/loops.py", "def run(u, c): ...", float("inf")),
        ("harness/cli/recordings.py", "def trace(a: int): ...", PARAMETERS),
        ("harness/study/run.py", "def run(a: int, *, b, **c): ...", PARAMETERS),
        ("harness/runner/simulation_loop.py", "def simulate(u, c): ...", OF_KERNELS),
        ("tests/test_it.py", "def test_it(u, c): ...", PARAMETERS),
    ],
)
def test_kernels_may_have_more_parameters(path, text, limit):
    assert allowed(Path(path), ast.parse(text).body[0]) == limit


def test_the_harness_shows_its_flow_at_a_glance():
    entries = {p.name for p in (ROOT / "harness").iterdir() if p.name != "__pycache__"}
    assert len(entries) <= 24
    text = (ROOT / "docs" / "structure.md").read_text(encoding="utf-8")
    packages = [f"harness/{name}" for name in sorted(entries) if not name.endswith(".py")]
    assert [p for p in packages if f"{p.removeprefix('harness/')}/" not in text] == []


def test_what_happens_where_is_there():
    text = (ROOT / "docs" / "structure.md").read_text(encoding="utf-8")
    rows = text.split("## Where it happens")[1].split("\n## ")[0].splitlines()
    rows = [re.findall(r"`([^`]+)`", row) for row in rows if "`" in row]
    assert len(rows) == 5
    for row in rows:
        modules = [ROOT / name for name in row if "/" in name]
        sources = [path.read_text(encoding="utf-8") for path in modules if path.suffix == ".py"]
        names = [part for name in row if "/" not in name for part in name.split(".")]
        assert [n for n in names if not any(f" {n}(" in s or f"class {n}:" in s for s in sources)] in ([], ["step"])


def test_tests_stand_where_the_code_stands():
    folders = {p.parts[1] for p in files("tests") if len(p.parts) > 2}
    assert {f for f in folders - BESIDE if not (ROOT / "harness" / f).is_dir()} == set()


def test_names_of_test_modules_are_unique():
    """Test folders are no packages: two modules of one name would be one to pytest."""
    names = [p.name for p in files("tests") if p.name.startswith("test_")]
    assert sorted(n for n in set(names) if names.count(n) > 1) == []


def test_no_test_imports_from_another():
    found = []
    for path in files("tests"):
        for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            found += [
                f"{path} imports {n}" for n in names if n.rsplit(".", 1)[-1].startswith("test_") and "harness" not in n
            ]
    assert found == []


@pytest.mark.parametrize(("link", "target"), [("harness/models", "models"), ("harness/config/studies", "studies")])
def test_what_the_package_holds_is_linked_and_not_copied(link, target):
    assert (ROOT / link).is_symlink()
    assert (ROOT / link).resolve() == ROOT / target


WRITERS = {"harness/common/places.py", "harness/common/lock.py"}
"""Where files are opened to be written: whole or not at all, and through no link."""
OF_PATHS = {"savefig", "to_csv", "to_parquet", "to_netcdf", "savez", "savez_compressed"}
"""What writes to a path or to a stream, which is that of ``places.unfinished`` or memory."""


def writes(call: ast.Call) -> bool:
    """Return whether a call may open a file to write it."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    first, *further = [getattr(a, "value", getattr(a, "id", "")) for a in call.args] or [None]
    if name in OF_PATHS:
        return first not in (None, "stream", "buffer", "file")
    if name == "open":
        modes = [first, *further, *(getattr(k.value, "value", "") for k in call.keywords if k.arg == "mode")]
        return any(isinstance(m, str) and set(m) <= set("rwxabt+") and set(m) & set("wxa+") for m in modes)
    return name in ("write_text", "write_bytes", "touch", "symlink_to", "mkstemp", "NamedTemporaryFile")


def calls(path: Path) -> Iterator[ast.Call]:
    return (n for n in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))) if isinstance(n, ast.Call))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("p.write_text('a')", True),
        ("p.open('wb')", True),
        ("open(p, 'ab+')", True),
        ("open(p, mode='x')", True),
        ("open(p, 'rb')", False),
        ("fig.savefig(folder / 'a.svg')", True),
        ("fig.savefig(stream, format='svg')", False),
        ("data.to_netcdf()", False),
        ("np.savez(path, a=1)", True),
    ],
)
def test_what_writes_a_file_is_seen(text, found):
    assert writes(ast.parse(text).body[0].value) is found


def test_files_are_written_in_one_place():
    wrong = [f"{p}:{c.lineno}" for p in files(*OURS) if str(p) not in WRITERS for c in calls(p) if writes(c)]
    assert wrong == []


def test_stores_are_opened_in_one_place():
    opening = {"open_group", "open_array", "open_zarr", "open_dataset", "open_datatree", "to_zarr"}
    attributes = ((p, c.func, c.lineno) for p in files(*OURS) for c in calls(p) if isinstance(c.func, ast.Attribute))
    found = {str(p) for p, f, _ in attributes if f.attr in opening or getattr(f.value, "id", "") == "zarr"}
    assert found == {"harness/common/stores.py"}
