"""Something that numba does while it compiles for a card and that takes nearly all of its time, done in one pass.

For each variable it looks through all statements of its block for assignments. A loop that is written out is one block
of thousands of statements. Machine code is the same.
"""

from __future__ import annotations

import functools
from collections import Counter
from typing import Any

from numba import config


@functools.cache
def compile_lightly() -> None:
    """Count assignments once whenever this process compiles for a card."""
    if config.ENABLE_CUDASIM:
        return
    from numba.cuda.core import ir
    from numba.cuda.core.analysis import compute_use_defs, must_use_alloca
    from numba.cuda.lowering import Lower

    def find_singly_assigned_variables(lower: Any) -> None:
        """Find variables that are assigned once and used where they are defined only."""
        found, blocks = set(), lower.func_ir.blocks
        if not lower.func_ir.func_id.is_generator:
            use_defs, kept = compute_use_defs(blocks), must_use_alloca(blocks)
            places = Counter(name for names in use_defs.defmap.values() for name in names)
            used = {name for names in use_defs.usemap.values() for name in names}
            times = Counter(
                each.target.name for block in lower.blocks.values() for each in block.find_insts(ir.assign_types)
            )
            once = (n for n, count in places.items() if count == 1 and times[n] == 1)
            found = {name for name in once if name not in kept and name not in used}
        lower._singly_assigned_vars = found
        lower._blk_local_varmap = {}

    Lower._find_singly_assigned_variable = find_singly_assigned_variables
