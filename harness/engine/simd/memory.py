"""Views of arrays whose users are not counted, for loops over time.

numba counts the users of every array by an atomic operation for each slice, each array put into a tuple and each array
handed over. A filter step hands over dozens, and an atomic operation takes as long as twenty vector products. A loop
therefore works on ``borrowed`` views of what it owns and keeps the owners until its end by ``retain``, since numba
frees what is not used any more.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic


def _without_owner(context: Any, builder: Any, ty: Any, value: Any) -> Any:
    if isinstance(ty, types.Array):
        model = context.data_model_manager[ty]
        nobody = context.get_constant_null(model.get_type("meminfo"))
        return model.set(builder, value, nobody, "meminfo")
    if isinstance(ty, types.BaseTuple):
        for i, part in enumerate(ty):
            inner = _without_owner(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, inner, i)
    return value


@intrinsic
def borrowed(typingctx: Any, arrays: Any) -> Any:
    """Return the same arrays (in tuples of tuples, with whatever else) as views that keep nothing in memory."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _without_owner(context, builder, arrays, args[0])

    return arrays(arrays), generate


@intrinsic
def retain(typingctx: Any, arrays: Any) -> Any:
    """Keep arrays in memory up to here."""
    return types.none(arrays), lambda context, builder, sig, args: context.get_dummy_value()
