"""Graphics cards of NVIDIA as a device of studies, with the kernels of processors: a lane is a thread there."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from numba import config

from harness.common.errors import UserError


def device() -> ModuleType:
    """Return the device, see ``harness.study.devices``; only here are the packages imported that it takes.

    Raises:
        UserError: If they are not installed.
    """
    if not config.ENABLE_CUDASIM and importlib.util.find_spec("numba_cuda") is None:
        raise UserError("a graphics card takes the package 'numba-cuda': pip install 'robustness-harness[cuda]'")
    return importlib.import_module("harness.cuda.on_card")
