"""How functions compile for a card."""

from __future__ import annotations

import functools
import importlib.metadata
from collections import Counter
from typing import Any

from numba import config, cuda


@functools.cache
def compile_lightly() -> None:
    """Count assignments once whenever this process compiles for a card.

    For each variable numba looks through all statements of its block for assignments, which takes nearly all of the
    time where a loop that is written out is one block of thousands of statements. Machine code is the same.
    """
    if config.ENABLE_CUDASIM:
        return
    from numba.cuda.core import ir
    from numba.cuda.core.analysis import compute_use_defs, must_use_alloca
    from numba.cuda.lowering import Lower

    def find_singly_assigned_variables(lower: Any) -> None:
        """Find variables that are assigned once and used where they are defined only."""
        single, blocks = set(), lower.func_ir.blocks
        if not lower.func_ir.func_id.is_generator:
            use_defs, kept = compute_use_defs(blocks), must_use_alloca(blocks)
            places = Counter(name for names in use_defs.defmap.values() for name in names)
            used = {name for names in use_defs.usemap.values() for name in names}
            times = Counter(
                each.target.name for block in lower.blocks.values() for each in block.find_insts(ir.assign_types)
            )
            once = (n for n, count in places.items() if count == 1 and times[n] == 1)
            single = {name for name in once if name not in kept and name not in used}
        lower._singly_assigned_vars = single
        lower._blk_local_varmap = {}

    Lower._find_singly_assigned_variable = find_singly_assigned_variables


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

# numba's own ``reshape`` calls a function that no compiler can see into, behind which all strides are unknown.
if config.ENABLE_CUDASIM:

    @inlined
    def reshaped(array, shape):
        """Return an array ``(..., 1)`` in another shape, the last axis as it is."""
        return array.reshape(shape)

else:
    from numba.cuda import types
    from numba.cuda.extending import intrinsic
    from numba.cuda.np.arrayobj import make_array, populate_array

    @intrinsic
    def reshaped(typingctx: Any, array: Any, shape: Any) -> Any:
        """Return an array ``(..., 1)`` in another shape, the last axis as it is."""
        result = array.copy(ndim=len(shape))

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            before, after = make_array(array)(context, builder, args[0]), make_array(result)(context, builder)
            sizes = [
                context.cast(builder, builder.extract_value(args[1], i), ty, types.intp) for i, ty in enumerate(shape)
            ]
            # The rows of what a thread sees lie at equal distances, in memory that all share as in its own.
            distance = builder.extract_value(before.strides, array.ndim - 2)
            strides = [builder.extract_value(before.strides, array.ndim - 1)]
            for size in reversed(sizes[1:-1]):
                strides.insert(0, distance)
                distance = builder.mul(distance, size)
            strides.insert(0, distance)
            populate_array(after, before.data, sizes, strides, before.itemsize, None)
            return after._getvalue()

        return result(array, shape), generate


def version() -> str:
    """Return the version of the compiler; that of numba where its simulator stands in for a card."""
    return importlib.metadata.version("numba" if config.ENABLE_CUDASIM else "numba-cuda")


def versions() -> dict[str, str]:
    """Return it by the name of the package."""
    return {"numba-cuda": version()}
