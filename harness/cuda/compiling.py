"""How functions compile for a card."""

from __future__ import annotations

import importlib.metadata
from typing import Any

from numba import config, cuda

from harness.cuda.light_compilation import compile_lightly

compile_lightly()

device = cuda.jit(device=True)
inlined = cuda.jit(device=True, inline="always")
"""For what hands over arrays that it was not given: only so does numba let a function on a card do so."""


def njit(*function: Any, inline: str = "never", **_: Any) -> Any:
    """Compile for a card what a module of kernels compiles by numba's function of this name; an argument as there."""
    compiled = cuda.jit(device=True, inline=inline)
    return compiled(function[0]) if function else compiled


forced = device if config.ENABLE_CUDASIM else cuda.jit(device=True, forceinline=True)
"""For what is specialised: compiled where it is called, so that arrays handed over may be kept in registers."""

inner = device


def version() -> str:
    """Return the version of the compiler; that of numba where its simulator stands in for a card."""
    return importlib.metadata.version("numba" if config.ENABLE_CUDASIM else "numba-cuda")


def versions() -> dict[str, str]:
    """Return it by the name of the package."""
    return {"numba-cuda": version()}
