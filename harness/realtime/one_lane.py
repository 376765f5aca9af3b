"""Kernels for a single run, as a controller runs them.

Studies compute ``harness.engine.simd.lanes.LANES`` runs at once; a controller has one. The same sources over lanes of
width one are scalar double-precision code of the same operations in the same order.
"""

from __future__ import annotations

import functools
import inspect
import re

from harness.engine import kernel_names
from harness.engine.compile import Exchange, load_source, written_over
from harness.engine.simd import lanes


def in_one_lane(source: str) -> str:
    """Return the source of a kernel module over lanes of width one, and of everything it is written over."""
    return written_over(source, _narrow())


@functools.cache
def _narrow() -> Exchange:
    source, found = re.subn(r"^LANES = \d+$", "LANES = 1", inspect.getsource(lanes), flags=re.MULTILINE)
    assert found == 1
    return Exchange({lanes: load_source("one_lane", source), kernel_names: kernel_names}, any_code=True)
