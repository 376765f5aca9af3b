"""Estimators in C: a shared library with the three functions of ``harness_estimator.h``.

The loop over time is compiled and calls the library by the address of its function, without Python in between.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.engine.compile import load_source
from harness.external.bodies import RunEstimates, Timed

HEADER = Path(__file__).with_name("harness_estimator.h")

SIZES = ("inputs", "measurements", "estimates", "values", "state_bytes")
FUNCTIONS = ("harness_sizes", "harness_reset", "harness_step")


class _Sizes(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in SIZES]


_LOOP = '''"""Loop over time of an estimator in C."""
import numpy as np
from numba import njit
from harness.engine.clock import nanoseconds
from harness.external.calls import call


@njit(nogil=True, cache=True)
def run(function, state, inputs, measurements, step, estimates, variances, nis):
    """Take all samples; return the first that has no estimate, and the status that it ended with."""
    u, y = np.int64(inputs.ctypes.data), np.int64(measurements.ctypes.data)
    x, v, d = np.int64(estimates.ctypes.data), np.int64(variances.ctypes.data), np.int64(nis.ctypes.data)
    nu, ny, nx = 8 * inputs.shape[1], 8 * measurements.shape[1], 8 * estimates.shape[1]
    for k in range(inputs.shape[0]):
        dt = 0.0 if k == 0 else step
        status = call(function, (state, u + k * nu, y + k * ny, dt, x + k * nx, v + k * nx, d + 8 * k))
        if status != 0:
            return k, status
    return inputs.shape[0], 0


@njit(nogil=True, cache=True)
def timed(function, state, inputs, measurements, step, estimates, variances, nis, begins, ticks):
    """Take all samples into one row of estimates, each between two readings of the clock (samples, 2)."""
    u, y = np.int64(inputs.ctypes.data), np.int64(measurements.ctypes.data)
    x, v, d = np.int64(estimates.ctypes.data), np.int64(variances.ctypes.data), np.int64(nis.ctypes.data)
    nu, ny = 8 * inputs.shape[1], 8 * measurements.shape[1]
    for k in range(inputs.shape[0]):
        dt = 0.0 if begins and k == 0 else step
        ticks[k, 0] = nanoseconds()
        call(function, (state, u + k * nu, y + k * ny, dt, x, v, d))
        ticks[k, 1] = nanoseconds()
'''


class LibraryEstimator:
    """A shared library as an estimator.

    Args:
        file: Its path.
        gives: Whether it gives variances and the NIS.

    Raises:
        UserError: If it cannot be loaded, lacks a function, or states a size below zero.
    """

    def __init__(self, file: str, gives: tuple[bool, bool] = (True, True)) -> None:
        try:
            library = ctypes.CDLL(file)
        except OSError as error:
            raise UserError(f"{Path(file).name}: cannot be loaded: {' '.join(str(error).split())}") from None
        try:
            sizes_of, self._reset, step = (getattr(library, name) for name in FUNCTIONS)
        except AttributeError:
            missing = [name for name in FUNCTIONS if not hasattr(library, name)]
            raise UserError(
                f"{Path(file).name}: has no function {', '.join(missing)}; 'harness new estimator NAME "
                "--kind library' writes the header that declares them"
            ) from None
        self._reset.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double]
        self._reset.restype = ctypes.c_int
        self._step = ctypes.cast(step, ctypes.c_void_p).value
        sizes = _Sizes()
        sizes_of(ctypes.byref(sizes))
        self._sizes = {name: getattr(sizes, name) for name in SIZES}
        if wrong := [f"{name} = {size}" for name, size in self._sizes.items() if size < 0]:
            raise UserError(f"{Path(file).name}: harness_sizes gives {', '.join(wrong)}")
        self._gives = gives
        self._loops = load_source("library_loop", _LOOP)

    def declared(self) -> dict[str, Any]:
        """Return the sizes."""
        return {"sizes": {name: size for name, size in self._sizes.items() if name != "state_bytes"}}

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured, see ``harness.external.bodies.EstimatorBody``."""
        samples, count = len(inputs), self._sizes["estimates"]
        state = np.zeros(1 + self._sizes["state_bytes"] // 8)
        inputs, measurements, values = (np.ascontiguousarray(a, dtype=float) for a in (inputs, measurements, values))
        estimates, variances = np.full((2, samples, count), math.nan)
        nis = np.full(samples, math.nan)
        if status := self._reset(state.ctypes.data, values.ctypes.data, step):
            return RunEstimates(estimates, None, None, 0, f"harness_reset returned {status}")
        given = inputs, measurements, step, estimates, variances, nis
        reached, status = self._loops.run(self._step, state.ctypes.data, *given)
        reason = f"harness_step returned {status}" if status else ""
        has_variances, has_nis = self._gives
        return RunEstimates(estimates, variances if has_variances else None, nis if has_nis else None, reached, reason)

    def timed(self, step: float, inputs: Floats, measurements: Floats, values: Floats, begins: bool) -> Timed:
        """Take samples, of a new run if it begins, see ``harness.external.bodies.EstimatorBody``."""
        if begins:
            self._timed = np.zeros(1 + self._sizes["state_bytes"] // 8)
            self._reset(self._timed.ctypes.data, values.ctypes.data, step)
        ticks = np.zeros((len(inputs), 2), dtype=np.int64)
        estimates, variances = np.full((2, self._sizes["estimates"]), math.nan)
        given = inputs, measurements, step, estimates, variances, np.full(1, math.nan), begins, ticks
        self._loops.timed(self._step, self._timed.ctypes.data, *given)
        return (ticks[:, 1] - ticks[:, 0]).astype(float), 0.0, estimates  # the clock's own time is that of kernels


def load(loader: Mapping[str, Any]) -> LibraryEstimator:
    """Return the estimator that a loader makes, see ``harness.external.bodies.load``.

    Args:
        loader: ``file`` is the path of the library.

    Raises:
        UserError: If it cannot be loaded.
    """
    variances, nis = bool(loader["variances"]), bool(loader["nis"])
    return LibraryEstimator(loader["file"], (variances or nis, nis))
