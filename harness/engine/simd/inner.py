"""How functions of lanes compile: only kernels can call them."""

from __future__ import annotations

from numba import njit

from harness.engine.simd.light_compilation import compile_lightly

compile_lightly()

inner = njit(error_model="numpy", cache=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Without wrappers for callers outside, which take as long to compile as a function of lanes; Python has no lanes."""
