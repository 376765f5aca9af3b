"""Compile kernels for a graphics card and start them, one thread for each run.

Modules of kernels are written anew for it: numbers of threads in place of lanes, arrays of known size. The text is that
of the kernels for processors, so the equations stand once.
"""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

from numba import config, cuda

from harness.common.cache import TEXT, kept
from harness.common.errors import ModelError, UserError
from harness.common.sources import digest
from harness.cuda import compiling, linalg, loops, specialise
from harness.cuda import lanes as threads
from harness.engine import kernel_names
from harness.engine.compile import CompiledModel, Exchange, load_source, written_over
from harness.engine.kernel_source import Kernel, kernel_source
from harness.engine.simd import inner, lanes, memory
from harness.engine.simd import linalg as simd
from harness.runner.filter_loop import turned

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


THREADS = 64
"""Of a block: few, so that the registers of a multiprocessor, of which each takes all it can get, are shared out."""

CARD = Exchange(
    {lanes: threads, memory: threads, inner: compiling, kernel_names: kernel_names},
    any_code=False,
    rewrite=for_card,
)

warnings.filterwarnings("ignore", message=".*Grid size")  # numba's, of every small study

_VERSION = f"# numba-cuda {compiling.version()}\n"


def check_card() -> None:
    """Raise ``UserError`` in one line if there is no card that can be used."""
    if not cuda.is_available():
        raise UserError("there is no graphics card of NVIDIA here with a driver that numba can use")


def name_of_card() -> str:
    """Return what the card calls itself."""
    if config.ENABLE_CUDASIM:
        return "numba's simulator"
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


@functools.lru_cache(maxsize=16)
def model_on_card(kernels: ModuleType) -> ModuleType:
    """Return the kernels of a compiled model as functions of a card, from the same source."""
    name = kernels.__name__.rpartition("_")[0]
    return load_source(f"card_{name}", _VERSION + written_over(inspect.getsource(kernels), CARD))


def _specialised(general: ModuleType, entry: str) -> str:
    """Return a module specialised for its sizes, which takes seconds, kept from earlier processes."""
    key = f"{general.__name__} {entry} {digest([specialise])}"  # the name tells all that the module is made from
    return kept("specialised", key, lambda: specialise.specialised(general, entry), TEXT)


class CardKernel:
    """A function of runs ready for a card.

    Args:
        stem: What it does.
        function: Ordinary function whose threads are runs; those it calls come with it.
        compiled: The model whose kernels it uses, if any.
        given: What its stand-ins stand for, in addition to the names of the model.

    Raises:
        ModelError: If it uses an undefined name, machine code written for a processor, or arrays of unknown sizes.
    """

    def __init__(
        self,
        stem: str,
        function: Kernel,
        compiled: CompiledModel | None = None,
        given: Mapping[Any, Any] | None = None,
    ) -> None:
        model = model_on_card(compiled.kernels) if compiled else None
        meant = {simd.outer_sum: linalg.outer_sum, simd.sigma_mean: linalg.sigma_mean, turned: loops.carried_over}
        source = _VERSION + written_over(kernel_source(stem, [function], model, meant | dict(given or {})), CARD)
        general = load_source(f"card_{stem}", source)
        text = _specialised(general, function.__name__)
        if "np.empty(" in text or "np.zeros(" in text:
            raise ModelError(f"'{stem}' makes arrays whose sizes are not known before it runs, which no card can have")
        special = load_source(f"card_{stem}", _VERSION + text)
        made: Callable[..., Any] = getattr(special, function.__name__).py_func
        self.function = cuda.jit(cache=True)(made)

    def __call__(self, runs: int, *arguments: Any) -> None:
        """Start it for so many runs; it goes on while the processor does something else."""
        self.function[-(-runs // THREADS), THREADS](*arguments)
