"""What a study may run on beside the processor; imported only where it does, as it takes packages that few have."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from numba import config

from harness.common.errors import UserError


def on_card() -> ModuleType:
    """Return what runs studies on a graphics card, ``harness.study.on_card``.

    Raises:
        UserError: If the packages for it are not installed.
    """
    if not config.ENABLE_CUDASIM and importlib.util.find_spec("numba_cuda") is None:
        raise UserError("a graphics card takes the package 'numba-cuda': pip install 'robustness-harness[cuda]'")
    return importlib.import_module("harness.study.on_card")


def compiler_of_card() -> str:
    """Return the version of what compiles for a card."""
    version: str = importlib.import_module("harness.engine.cuda.compiling").version()
    return version
