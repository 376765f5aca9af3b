"""Write modules of kernels for a card: numbers of threads in place of lanes, and arrays of known size.

The text is that of the kernels for processors, so the equations stand once.
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Mapping, Sequence
from typing import Any

from harness.cuda import compiling
from harness.cuda import lanes as threads

_NEEDED = f"""\
import math
from numba import cuda, float64
from {compiling.__name__} import inlined as new, reshaped
from {threads.__name__} import inverted
"""


class _ForCard(ast.NodeTransformer):
    """Rewrites what a card does otherwise.

    Args:
        numbers: Global numbers of the module, of which sizes are made.

    Attributes:
        zeros: Functions that make arrays of zeros, by name.
    """

    def __init__(self, numbers: Mapping[str, Any]) -> None:
        self._numbers = numbers
        self.zeros: dict[str, str] = {}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        """Take numba's compiler for cards."""
        if node.module == "numba":
            node.module = compiling.__name__
        return node

    def visit_If(self, node: ast.If) -> Any:
        """Leave out what is never reached: what it does need not even compile."""
        if isinstance(node.test, ast.Name) and node.test.id in self._numbers:
            taken = node.body if self._numbers[node.test.id] else node.orelse
            return [self.visit(each) for each in taken] or ast.Pass()
        return self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Write a mask turned round as a call."""
        self.generic_visit(node)
        if isinstance(node.op, ast.Invert):
            return ast.Call(ast.Name("inverted", ast.Load()), [node.operand], [])
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Write new arrays as arrays of a thread, whose size has to be known when they are compiled."""
        self.generic_visit(node)
        made = ast.unparse(node.func)
        if made == "get":  # a function would be compiled for each index
            return _at(node.args[0], node.args[1:], ast.Load())
        if made.endswith(".reshape") and isinstance(node.func, ast.Attribute):
            return ast.Call(ast.Name("reshaped", ast.Load()), [node.func.value, *node.args], [])
        if made in ("np.log1p", "np.exp", "np.sqrt"):
            return ast.Call(ast.parse(made.replace("np.", "math."), mode="eval").body, node.args, [])
        if made not in ("np.empty", "np.zeros"):
            return node
        text = ast.unparse(node.args[0])
        try:
            shape = eval(text, {"max": max, "min": min}, dict(self._numbers))
        except (NameError, AttributeError, TypeError):
            return node  # where inputs are exact, a branch that is not taken has one of their errors
        sizes = tuple(int(n) for n in (shape if isinstance(shape, tuple) else (shape,)))
        kind = ast.unparse(node.args[1]) if len(node.args) > 1 else "float64"
        array = f"cuda.local.array({sizes!r}, {kind})"
        if made == "np.empty":
            return ast.parse(array, mode="eval").body
        name = f"zeros_{'_'.join(map(str, sizes))}"
        self.zeros[name] = _zeros(name, array, sizes)
        return ast.Call(ast.Name(name, ast.Load()), [], [])

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Write what puts a number into an array as an assignment."""
        self.generic_visit(node)
        call = node.value
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "put":
            value, array, *indices = call.args
            return ast.Assign([_at(array, indices, ast.Store())], value)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Compile what hands arrays of its own over where it is called: they end with the function that made them."""
        before = ast.unparse(node)
        self.generic_visit(node)
        if ("np.empty" in before or "np.zeros" in before) and any(isinstance(n, ast.Return) for n in ast.walk(node)):
            node.decorator_list = [ast.Name("inlined", ast.Load())]
        return node


def _zeros(name: str, array: str, sizes: Sequence[int]) -> str:
    """Return the source of a function that makes an array of zeros."""
    places = [f"i{axis}" for axis in range(len(sizes))]
    lines = [f"{'    ' * (axis + 1)}for i{axis} in range({size}):" for axis, size in enumerate(sizes)]
    lines.append(f"{'    ' * (len(sizes) + 1)}array[{', '.join(places)}] = 0.0")
    return "\n".join(["@new", f"def {name}():", f"    array = {array}", *lines, "    return array\n\n\n"])


def _at(array: ast.expr, indices: Sequence[ast.expr], access: ast.expr_context) -> ast.Subscript:
    """Return the place of this thread at some indices of an array."""
    return ast.Subscript(array, ast.Tuple([*indices, ast.Constant(0)], ast.Load()), access)


def for_card(source: str) -> str:
    """Return the source of a module of kernels with what a card does otherwise rewritten."""
    tree = ast.parse(source)
    writer = _ForCard(_numbers(tree))
    text = ast.unparse(ast.fix_missing_locations(writer.visit(tree)))
    marks = "".join(writer.zeros.values())
    future = "from __future__ import annotations"
    return f"{future}\n{_NEEDED}\nWRITTEN_FOR_CARDS = True\n{marks}{text.replace(future, '')}\n"


def _numbers(tree: ast.Module) -> dict[str, Any]:
    """Return the global numbers that a module imports or states."""
    constants: dict[str, Any] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            home = importlib.import_module(node.module)
            constants |= {n.asname or n.name: getattr(home, n.name, None) for n in node.names}
        elif isinstance(node, ast.Assign):
            try:
                value = ast.literal_eval(node.value)
            except ValueError:
                continue
            for target in node.targets:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                values = value if isinstance(target, ast.Tuple) else [value]
                constants |= {n.id: v for n, v in zip(names, values, strict=True) if isinstance(n, ast.Name)}
    return {name: value for name, value in constants.items() if isinstance(value, (int, float))}
