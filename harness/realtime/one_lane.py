"""Kernels for a single run, as a controller runs them.

Studies compute ``harness.lanes.LANES`` runs at once; a controller has one. The same sources over lanes of width one
are scalar double-precision code of the same operations in the same order.
"""

from __future__ import annotations

import functools
import inspect
import re
from types import ModuleType

from harness import lane_algebra, lane_gather, lane_math, lane_random, lanes
from harness.compile import load_source

_MODULES = {m.__name__: m for m in (lanes, lane_math, lane_algebra, lane_gather, lane_random)}
_IMPORT = re.compile(r"^from (harness\.lane\w*) import", re.MULTILINE)


def in_one_lane(source: str) -> str:
    """Return the source of a kernel module over lanes of width one."""
    return _IMPORT.sub(lambda found: f"from {_narrow(found[1]).__name__} import", source)


@functools.cache
def _narrow(name: str) -> ModuleType:
    """Return one of the modules that kernels take their numbers from, for a single lane."""
    source = in_one_lane(inspect.getsource(_MODULES[name]))
    if name == lanes.__name__:
        source, found = re.subn(r"^LANES = \d+$", "LANES = 1", source, flags=re.MULTILINE)
        assert found == 1
    return load_source(f"one_{name.rpartition('.')[2]}", source)


def narrow_model(kernels: ModuleType) -> ModuleType:
    """Return the kernels of a compiled model for a single lane."""
    return load_source("one_model", in_one_lane(inspect.getsource(kernels)))
