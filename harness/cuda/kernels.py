"""Compile kernels for a graphics card and start them, one thread for each run."""

from __future__ import annotations

import functools
import inspect
import warnings
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

from numba import config, cuda

from harness.common.cache import TEXT, kept
from harness.common.errors import ModelError, UserError
from harness.common.sources import digest
from harness.cuda import compiling, linalg, loops, specialise
from harness.cuda import lanes as threads
from harness.cuda.write import for_card
from harness.engine import kernel_names
from harness.engine.compile import CompiledModel, Exchange, load_source, written_over
from harness.engine.kernel_source import Kernel, kernel_source
from harness.engine.simd import inner, lanes, memory
from harness.engine.simd import linalg as simd
from harness.runner.filter_loop import turned

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
        given: What its stand-ins stand for, beside the names of the model.

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
