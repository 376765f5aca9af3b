"""Put the source of functions together to a module of compiled kernels.

A kernel is an ordinary function whose source is compiled in another module, behind the kernels of a model. Which names
it uses its code says, and what they mean the file says that it is written in: a function is put into the module as
well, what is compiled already, a class or a module is imported from where it is defined, a number is written down, and
a stand-in (``harness.engine.kernel_names.StandIn``) is replaced by what it stands for. So nothing depends on the names
of files or on lists of functions, and an undefined name is an error before anything is compiled.
"""

from __future__ import annotations

import builtins
import dis
import inspect
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite
from types import CodeType, FunctionType, ModuleType
from typing import Any

from harness.common.errors import ModelError
from harness.common.sources import is_own
from harness.engine.kernel_names import StandIn
from harness.engine.simd import lanes

Kernel = Callable[..., Any]

JIT = """\
jit = njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
inlined = njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, inline="always")"""
"""How every generated module compiles, behind ``from numba import njit``.

What is called at one place is compiled there: as a function of its own it would be optimised and written out at every
level of calls again.
"""


def kernel_source(
    title: str, functions: Sequence[Kernel], kernels: ModuleType | None = None, given: Mapping[Any, Any] | None = None
) -> str:
    """Return the source of a module of compiled functions.

    Args:
        title: First line of its docstring.
        functions: Ordinary functions; those they call come with them.
        kernels: Compiled model that defines the stand-ins of ``harness.engine.kernel_names``.
        given: What other stand-ins stand for: functions, compiled ones or numbers. A function may be replaced as well.

    Raises:
        ModelError: If a function uses an undefined name, or two use one name for different things.
    """
    module = _Module(kernels, given or {})
    for function in functions:
        module.add(function)
    return module.source(title)


_OWN = ("inlined", "jit", "njit")
"""Names that every generated module defines."""


class _Module:
    """A module in the making: its functions, each behind those it calls, and all they use."""

    def __init__(self, kernels: ModuleType | None, given: Mapping[Any, Any]) -> None:
        self._kernels, self._given = kernels, {id(k): v for k, v in given.items()}
        self._meanings: dict[str, tuple[Any, str]] = dict.fromkeys(_OWN, (None, "the module"))
        self._calls: Counter[FunctionType] = Counter()
        self._functions: list[FunctionType] = []
        self._imports: dict[str, set[str]] = {}
        self._modules: dict[str, str] = {}
        self._numbers: dict[str, str] = {}
        self._other_names: dict[str, str] = {}

    def add(self, function: Kernel) -> None:
        """Add a function and what it uses."""
        if not isinstance(function, FunctionType) or not function.__name__.isidentifier():
            raise ModelError(f"{function!r} is no function that a kernel can be made of")
        if self._settle(function.__name__, function, function):
            return
        if "." in function.__qualname__:
            raise ModelError(f"{_place(function)}: a kernel must be defined at the top level of its file")
        for name, attribute in _used(function.__code__):
            if name in function.__globals__:
                self._bind(name, attribute, function)
            elif not hasattr(builtins, name):
                raise _missing(name, function, "which is defined nowhere; define or import it in that file")
        self._functions.append(function)

    def source(self, title: str) -> str:
        """Return the module's source."""
        lines = [f'"""{title}; generated."""', "from numba import njit"]
        lines += [f"import {home} as {name}" for name, home in sorted(self._modules.items())]
        lines += [f"from {home} import {', '.join(sorted(names))}" for home, names in sorted(self._imports.items())]
        lines += ["", JIT, *(f"{name} = {number}" for name, number in self._numbers.items())]
        manner = {f: "@inlined" if self._calls[f] == 1 else "@jit" for f in self._functions}
        bodies = [f"{manner[f]}\n{inspect.getsource(f).rstrip()}" for f in self._functions]
        other_names = [f"{name} = {function}" for name, function in self._other_names.items()]
        return "\n\n\n".join(["\n".join(lines), *bodies, *other_names]) + "\n"

    def _bind(self, name: str, attribute: str, user: FunctionType) -> None:
        """Find out what a name that a function uses means, and bring it into the module."""
        meaning = user.__globals__[name]
        meaning = self._given.get(id(meaning), meaning)
        if isinstance(meaning, StandIn):
            if self._kernels is None or not hasattr(self._kernels, meaning.name):
                raise _missing(name, user, "which the module that it is compiled in does not define")
            if not self._settle(name, meaning, user):
                self._import(name, self._kernels, meaning.name)
        elif isinstance(meaning, FunctionType):
            self.add(meaning)
            self._calls[meaning] += 1
            if name != meaning.__name__ and not self._settle(name, meaning, user):
                self._other_names[name] = meaning.__name__
        elif isinstance(meaning, ModuleType):
            if is_own(meaning) and isinstance(getattr(meaning, attribute, None), FunctionType):
                raise _missing(f"{name}.{attribute}", user, f"a function to be imported by its own name, '{attribute}'")
            if not self._settle(name, meaning, user):
                self._modules[name] = meaning.__name__
        elif not self._settle(name, meaning, user):
            self._define(name, meaning, user)

    def _define(self, name: str, meaning: Any, user: FunctionType) -> None:
        """Write down a number or import an object from where it is defined."""
        if isinstance(meaning, (bool, int, float)):
            if vars(lanes).get(name) == meaning:  # not a number of its own but the width of what it runs over
                self._import(name, lanes, name)
            elif isfinite(meaning):
                self._numbers[name] = repr(meaning)
            else:
                raise _missing(name, user, f"which is {meaning}; write np.{meaning} in the function")
            return
        home = sys.modules.get(getattr(meaning, "__module__", None) or "")
        attribute = next((n for n, value in vars(home).items() if value is meaning), None) if home else None
        if home is not None and home.__name__ == "__main__":
            raise _missing(name, user, "which stands in a notebook or script; define it in a file that can be imported")
        if home is None or attribute is None:
            raise _missing(name, user, f"a {type(meaning).__name__}, which cannot be compiled in; pass it as argument")
        self._import(name, home, attribute)

    def _import(self, name: str, home: ModuleType, attribute: str) -> None:
        known_as = attribute if name == attribute else f"{attribute} as {name}"
        self._imports.setdefault(home.__name__, set()).add(known_as)

    def _settle(self, name: str, meaning: Any, user: FunctionType) -> bool:
        """Return whether the name is there already; one that means two things is refused."""
        if name not in self._meanings:
            self._meanings[name] = meaning, _place(user)
            return False
        settled, before = self._meanings[name]
        if settled is not meaning and (type(settled) is not type(meaning) or not isinstance(settled, (int, float)) or
                                     settled != meaning):  # fmt: skip
            raise ModelError(f"{_place(user)}: '{name}' means something else in {before}; rename one of the two")
        return True


def _used(code: CodeType) -> Iterator[tuple[str, str]]:
    """Give the global names that a function uses, each with the attribute that is taken of it."""
    instructions = list(dis.get_instructions(code))
    for instruction, after in zip(instructions, [*instructions[1:], instructions[-1]], strict=True):
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            yield instruction.argval, str(after.argval) if after.opname in ("LOAD_ATTR", "LOAD_METHOD") else ""
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _used(part)


def _place(function: FunctionType) -> str:
    return f"kernel '{function.__name__}' in {function.__code__.co_filename}"


def _missing(name: str, user: FunctionType, what: str) -> ModelError:
    return ModelError(f"{_place(user)} uses '{name}', {what}")
