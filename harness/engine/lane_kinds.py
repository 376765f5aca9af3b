"""The same kernels over lanes of another kind than ``harness.engine.simd.lanes``, by their sources.

A controller has one run: over lanes of width one the sources are scalar double-precision code of the same operations in
the same order. Derivatives need seven digits: of single-precision numbers one register holds twice as many.
"""

from __future__ import annotations

import functools
import inspect
import re

from harness.engine import kernel_names
from harness.engine.compile import Exchange, load_source, written_over
from harness.engine.simd import lanes

SINGLES = 2 * lanes.LANES
"""Single-precision numbers in a lane of ``over_singles``."""


def in_one_lane(source: str) -> str:
    """Return the source of a kernel module over lanes of width one, and of everything it is written over."""
    return written_over(source, _exchange("one_lane", 1, "float64"))


def over_singles(source: str) -> str:
    """Return the source of a kernel module over ``SINGLES`` single-precision numbers in every lane.

    Its arrays of lanes are of ``float32``, and of functions there is what ``lanes`` has but those of exponents.
    """
    return written_over(source, _exchange("singles", SINGLES, "float32"))


@functools.cache
def _exchange(name: str, width: int, number: str) -> Exchange:
    source = inspect.getsource(lanes)
    for line, other in ((r"LANES = \d+", f"LANES = {width}"), (r"NUMBER = types\.\w+", f"NUMBER = types.{number}")):
        source, count = re.subn(rf"^{line}$", other, source, flags=re.MULTILINE)
        assert count == 1
    return Exchange({lanes: load_source(name, source), kernel_names: kernel_names}, any_code=True)
