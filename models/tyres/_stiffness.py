"""Cornering stiffness over load, shared by the tyres (Ziaukas 2023, eq. 4.6)."""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import TyreContext
from harness.models.contracts import Parameter

STIFFNESS_PARAMETERS: tuple[Parameter, ...] = (
    Parameter("stiffness_peak", "c_1", "N/rad", 1e-1, 1e9, "largest cornering stiffness over load (table 4.4)"),
    Parameter("stiffness_load", "c_2", "N", 1e-1, 1e9, "vertical load at the largest stiffness (table 4.4)"),
)


def stiffness(t: TyreContext) -> sp.Symbol:
    """Publish and return ``C_F = c_1 sin(2 atan(F_z / c_2))`` in N/rad (4.6)."""
    load = sp.atan(t.vertical_load / t.p("stiffness_load"))
    return t.port("cornering_stiffness", t.p("stiffness_peak") * sp.sin(2 * load))
