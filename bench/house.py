"""Count what the package is made of: ``python -m bench.house``, for each note on a change of its structure.

``python -m bench.house harness bench`` counts other folders. A link to another folder counts once, where it leads from.
"""

from __future__ import annotations

import ast
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from harness.common.arguments import Parser

ROOT = Path(__file__).parents[1]
FEW_LINES, MANY_LINES = 100, 450
LONG_FUNCTION, MANY_PARAMETERS = 70, 10
VAGUE = {"found", "known", "told", "left"}
"""Names of variables that do not say what they hold."""
EXPORTED = {"Settings"}
"""Classes that contracts demand of each file of a folder by this name (``contract`` of estimation, identification)."""

NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
           tokenize.ENCODING}  # fmt: skip
FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(path: Path) -> int:
    """Return the number of lines of a file with code on them: neither empty, comment nor docstring."""
    with tokenize.open(path) as file:
        lines = {n for t in tokenize.generate_tokens(file.readline) if t.type not in NO_CODE
                 for n in range(t.start[0], t.end[0] + 1)}  # fmt: skip
    texts = (n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Expr))
    for text in texts:
        if isinstance(text.value, ast.Constant) and isinstance(text.value.value, str):
            lines -= set(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return len(lines)


def header_lines(tree: ast.Module) -> int:
    """Return the number of lines of the imports at the top level of a module."""
    imports = [n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)]
    return sum((n.end_lineno or n.lineno) - n.lineno + 1 for n in imports)


def imported(tree: ast.Module, modules: set[str]) -> set[str]:
    """Return those of some modules that a module imports, at its top or within functions."""
    named = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    for n in ast.walk(tree):
        if isinstance(n, ast.ImportFrom) and n.module:
            inner = {f"{n.module}.{a.name}" for a in n.names}
            named |= inner if inner <= modules else inner | {n.module}
    return named & modules


def used(tree: ast.Module) -> Counter[str]:
    """Return how often each name is read in a module, as a variable or an attribute."""
    names = (n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load))
    return Counter(names) + Counter(n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute))


def assigned(tree: ast.Module) -> set[str]:
    """Return the variables of a module."""
    return {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def parameters(function: FUNCTION) -> int:
    """Return the number of parameters of a function, ``self`` and ``cls`` apart."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return sum(a is not None and a.arg not in ("self", "cls") for a in named)


def files(folder: Path) -> Iterator[Path]:
    """Yield the Python files below a folder, those behind links apart."""
    return (p for p in sorted(folder.rglob("*.py")) if not any(q.is_symlink() for q in (p, *p.parents)))


def counts(root: Path, folders: Sequence[str]) -> dict[str, int]:
    """Return the counts by what is counted.

    Args:
        root: Of the tree, with ``docs/``.
        folders: Packages below it.
    """
    paths = {".".join(p.relative_to(root).with_suffix("").parts): p for f in folders for p in files(root / f)}
    paths = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in paths.items()}
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for path in paths.values()]
    functions = [n for tree in trees.values() for n in ast.walk(tree) if isinstance(n, FUNCTION)]
    importers, classes, once = Counter[str](), defaultdict[str, set[str]](set), 0
    for name, tree in trees.items():
        importers.update(imported(tree, set(paths)) - {name})
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name].add(name)
        calls = used(tree)
        once += sum(isinstance(n, FUNCTION) and n.name.startswith("_") and calls[n.name] == 1 for n in tree.body)
    pages = [p.read_text(encoding="utf-8").splitlines() for p in (root / "docs").rglob("*.md")]
    return {
        "files": len(paths),
        "lines": sum(lengths),
        "code lines": sum(map(code_lines, paths.values())),
        "lines of import headers": sum(map(header_lines, trees.values())),
        "private functions called once": once,
        "modules imported by one module only": sum(n == 1 for n in importers.values()),
        "class names with several meanings": sum(
            len(where) > 1 and name not in EXPORTED for name, where in classes.items()
        ),
        f"files below {FEW_LINES} lines": sum(n < FEW_LINES for n in lengths),
        f"modules above {MANY_LINES} lines": sum(n > MANY_LINES for n in lengths),
        f"functions above {LONG_FUNCTION} lines": sum(
            (f.end_lineno or f.lineno) - f.lineno >= LONG_FUNCTION for f in functions
        ),
        f"functions with more than {MANY_PARAMETERS} parameters": sum(
            parameters(f) > MANY_PARAMETERS for f in functions
        ),
        f"files with a variable {', '.join(sorted(VAGUE))}": sum(bool(assigned(t) & VAGUE) for t in trees.values()),
        "lines of docs, tables apart": sum(not line.startswith("|") for page in pages for line in page),
    }


def main(arguments: Sequence[str]) -> None:
    """Print the counts."""
    parser = Parser(prog="python -m bench.house", description=__doc__)
    parser.add_argument("folders", nargs="*", default=["harness"], help="packages of the checkout; harness if absent")
    for what, number in counts(ROOT, parser.parse_args(arguments).folders).items():
        print(f"{number:8,}  {what}")


if __name__ == "__main__":
    main(sys.argv[1:])
