"""Change the numeric code in one place at a time and count in how many places a test sees it; ``make mutation``.

A tool of its own, because mutmut runs the original and its mutants as functions of one module, whose source is not what
``harness.engine.kernel_source`` compiles, and cosmic-ray has one test command for all files.

Each mutant is written into a copy of the tree, and the quick tests that concern its file are run there until one fails
or the time is over. Kernels are kept under the hash of their source, so that a mutated one is compiled; what is kept
under other keys is removed before each run. A test that fails without a mutation as well kills none.
"""

from __future__ import annotations

import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from typing import Any

from harness.common.arguments import Parser
from harness.common.cache import cache_folder
from harness.common.errors import UserError

ROOT = Path(__file__).parents[1]
CODE = (
    "harness/common/statistics.py", "harness/study/sobol_indices.py", "harness/study/score_names.py",
    "harness/estimation/methods/*.py", "harness/identification/input_effects.py", "harness/identification/objective.py",
    "harness/diagnosis/selection/*.py", "harness/recordings/check/*.py", "harness/recordings/motion/*.py",
    "harness/runner/*.py", "models/assembly/*.py", "models/effects/*.py",
)  # fmt: skip
OUT_OF_TIME = "out of time"
MOST_TESTS = 3
"""Test files that are run for a mutant, those first that concern its file most."""

_SWAPS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.MatMult: ast.Mult,
}  # fmt: skip


def mutated(node: ast.AST) -> ast.AST | None:
    """Return a node with another meaning, ``None`` of a kind that has none."""
    match node:
        case ast.Compare(left, [operator], [right]):
            return ast.Compare(left, [_SWAPS[type(operator)]()], [right])
        case ast.BoolOp(operator, values):
            return ast.BoolOp(_SWAPS[type(operator)](), values)
        case ast.BinOp(left, operator, right) if type(operator) in _SWAPS and not isinstance(
            left, ast.Constant | ast.JoinedStr
        ):
            return left if isinstance(right, ast.Constant) else ast.BinOp(left, _SWAPS[type(operator)](), right)
        case ast.BinOp(left, operator, right) if type(operator) in _SWAPS and isinstance(
            getattr(left, "value", 0), int | float
        ):
            return ast.BinOp(left, _SWAPS[type(operator)](), right)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            return operand
        case ast.Constant(bool() as value):
            return ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            return ast.Constant(value + 1 if isinstance(value, int) else 2.0 * value or 1.0)
        case ast.Raise() | ast.AugAssign() | ast.Continue() | ast.Break():
            return ast.Pass()
    return None


def sites(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """Give what can be mutated below a node; not annotations, decorators, texts and what errors say."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_comment") or isinstance(node, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.expr | ast.stmt) and mutated(child) is not None:
                yield child
            if isinstance(child, ast.AST) and not isinstance(child, ast.Raise):
                yield from sites(child)


def mutants(seed: int, count: int) -> list[dict[str, Any]]:
    """Draw mutants: file, line, what stood there, what stands there now, and the whole text of the file."""
    mutants_found = []
    if gone := [pattern for pattern in CODE if not any(ROOT.glob(pattern))]:
        raise UserError(f"bench/mutation.py: CODE: no file is {', '.join(gone)}")
    for path in sorted(p for pattern in CODE for p in ROOT.glob(pattern)):
        text = path.read_bytes()
        starts = [0, *(m.end() for m in re.finditer(b"\n", text))]
        tree = ast.parse(text)
        within = {
            line: function.name
            for function in ast.walk(tree)
            if isinstance(function, ast.FunctionDef)
            for line in range(function.lineno, function.end_lineno + 1)
        }
        for site in sites(tree):
            first, last = starts[site.lineno - 1] + site.col_offset, starts[site.end_lineno - 1] + site.end_col_offset
            new = ast.unparse(ast.fix_missing_locations(mutated(site)))
            new = f"({new})" if isinstance(site, ast.expr) and not isinstance(site, ast.Constant) else new
            where, old = path.relative_to(ROOT).as_posix(), text[first:last].decode()
            content = text[:first] + new.encode() + text[last:]
            about = {
                "file": where,
                "line": site.lineno,
                "function": within.get(site.lineno, ""),
                "old": old,
                "new": new,
            }
            mutants_found.append(about | {"text": content})
    return random.Random(seed).sample(mutants_found, min(count, len(mutants_found)))


def concerned(file: str, function: str = "") -> list[str]:
    """Return the test files that concern a file, those first that name its function or its name."""
    path = Path(file)
    module = ".".join(path.with_suffix("").parts).replace("models.", "harness.models.", file.startswith("models"))
    named, folder = re.compile(rf"\b{path.stem}\b"), path.parent.name
    package = module.split(".")[2 if file.startswith("models") else 1]
    ranked = []
    users = [
        p.stem
        for p in (ROOT / path.parent).glob("*.py")
        if re.search(rf"\b{module.rpartition('.')[2]}\b", p.read_text())
    ]
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        text, where = test.read_text(encoding="utf-8"), test.relative_to(ROOT).as_posix()
        marks = (
            function and path.stem in text and re.search(rf"\b{function}\b", text),
            test.stem.removeprefix("test_") == path.stem.strip("_"),
            re.search(
                rf"\b{re.escape(module)}\b|from {re.escape(module.rpartition('.')[0])} import .*\b{path.stem}\b", text
            ),
            test.stem.removeprefix("test_") in users,
            named.search(text) and test.parent.name in (package, "contracts", file.split("/")[0]),
            test.stem == f"test_{folder}",
            f"{module.rpartition('.')[0]}." in text,
            test.parent.name == package,
            any(re.search(rf"['\"]{user}['\"]", text) for user in users),
        )
        weight = sum(2 ** (len(marks) - n) for n, mark in enumerate(marks) if mark)
        if weight:
            ranked.append((-weight, len(text), where))
    return [where for _, _, where in sorted(ranked)[:MOST_TESTS]]


def run_tests(tree: Path, tests: list[str], limit: int) -> str:
    """Run tests in a copy of the tree; return the one that failed, empty if none did."""
    cache = tree.with_name("cache")
    for kind in ("points", "chi-square-bounds", "conversions"):  # their keys do not hold the code that makes them
        shutil.rmtree(cache / kind, ignore_errors=True)
    path = os.pathsep.join([str(tree), str(tree / "tests")])
    own = {"HARNESS_CACHE": str(cache), "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider",
               "-m", "not proof and not wheel and not notebooks and not browser", *tests]  # fmt: skip
    command = ["prlimit", f"--cpu={limit}", *command]
    done = subprocess.run(command, cwd=tree, env=os.environ | own, capture_output=True, text=True, check=False)
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    if failed:
        return failed[1]
    return "" if done.returncode in (0, 5) else OUT_OF_TIME


def copied(folder: Path, number: int) -> Path:
    """Return a copy of the tree."""
    tree = folder / f"tree-{number}"
    shutil.rmtree(tree, ignore_errors=True)
    away = shutil.ignore_patterns(".*", "results", "build", "site", "__pycache__")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=away)
    (tree / "results").mkdir()
    return tree


def main() -> int:
    """Write score and survivors; return 0."""
    parser = Parser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=int, default=60, help="s of processor time for the tests of a mutant")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/mutation"))
    given = parser.parse_args()
    out = given.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if not (out / "cache").exists():  # what is compiled already need not be compiled again
        shutil.copytree(cache_folder(), out / "cache")
    trees: SimpleQueue[Path] = SimpleQueue()
    for number in range(given.jobs):
        trees.put(copied(out, number))

    def judged(mutant: dict[str, Any]) -> dict[str, Any]:
        """Return a mutant with the test that saw it, and keep it in the file of the run."""
        tree, file = trees.get(), mutant["file"]
        try:
            (tree / file).write_bytes(mutant.pop("text"))
            by = run_tests(tree, concerned(file, mutant["function"]), given.limit)
            shutil.copyfile(ROOT / file, tree / file)
            if by not in ("", OUT_OF_TIME) and run_tests(tree, [by], given.limit):
                by = ""  # it fails without the mutation as well
        finally:
            trees.put(tree)
        print(f"{file}:{mutant['line']}: {mutant['old']} -> {mutant['new']}: {by or 'SURVIVED'}", flush=True)
        with lock, kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps(mutant | {"killed_by": by}) + "\n")
        return mutant | {"killed_by": by}

    kept, lock = out / f"mutants-{given.seed}.jsonl", Lock()
    kept.unlink(missing_ok=True)
    with ThreadPoolExecutor(given.jobs) as pool:
        mutants_found = list(pool.map(judged, mutants(given.seed, given.count)))
    late = sum(m["killed_by"] == OUT_OF_TIME for m in mutants_found)
    ended = len(mutants_found) - late
    killed = sum(bool(m["killed_by"]) for m in mutants_found) - late
    print(f"{killed} of {ended} mutants killed, {killed / max(ended, 1):.0%}; of {late} the tests took too long")
    return 0


if __name__ == "__main__":
    sys.exit(main())
