"""What holds for every tyre, on a rig that sets slip and load."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.contracts import Parameter
from harness.models.roles import PARAMETERS, TYRES
from harness.testing.dimensions import assemble_with_units, check_dimensions, check_parameters
from harness.testing.parts import evaluate, load, named, require

FORCE, STIFFNESS, CAPACITY = (
    f"{kind}_axle_11" for kind in ("steady_lateral_force", "cornering_stiffness", "lateral_force_capacity")
)
LOADS = (0.05, 0.5, 1.0, 2.0)
"""Axle loads over the usual one: a model car is no truck."""

USUAL_LOAD = 2e4
"""N, of an axle whose parameters say nothing about it."""

SLIPS = np.concatenate([np.geomspace(1e-6, 0.2, 12), [0.5, 1.0, 1.4]])


def check_tyre(
    tyre: str | types.ModuleType, values: Mapping[str, float] | None = None, axle_load: float = USUAL_LOAD
) -> None:
    """Check a tyre: units, an odd force to its own side, the published stiffness its slope, the capacity its limit.

    Args:
        tyre: Its name, or a module that keeps the contract (``harness/models/contracts.py``).
        values: Its parameters in SI units, by the names in the file; by default those of every parameter set that has
            all of them.
        axle_load: Usual load of an axle in N, for parameters that do not say one (``stiffness_load``).

    Raises:
        AssertionError: If something does not hold; the message says what.
    """
    with named(TYRES, tyre) as name:
        file = load("tyres", name)
        require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        check_parameters(file.PARAMETERS)
        require(check_dimensions(assemble_with_units(rig(), file)) >= 4, f"{name}: an equation has no unit")
        tables_tried = tables(name) if values is None else [{f"{n}_11": v for n, v in values.items()}]
        require(tables_tried, f"{name}: no parameter set has values for it; give check_tyre(..., values={{...}})")
        built = assemble(rig(), name)
        for table in tables_tried:
            for load_ in loads(table, axle_load):
                _check_force(name, built, table, load_)
                if STIFFNESS in built.ports:
                    _check_slope(name, built, table, load_)
                if CAPACITY in built.ports:
                    _check_capacity(name, built, table, load_)


def _check_force(name: str, built: StateSpaceModel, table: Mapping[str, float], load_: float) -> None:
    require(force(built, table, 0.0, load_) == 0.0, f"{name}: a force without slip at {load_:g} N")
    for slip in SLIPS:
        there, right = force(built, table, slip, load_)[0], force(built, table, -slip, load_)[0]
        require(np.isclose(there, -right, rtol=1e-12, atol=0), f"{name}: {there} to the left, {right} to the right")
        require(there > 0, f"{name}: the force at slip {slip:g} is {there:g}, not to its own side")


def _check_slope(name: str, built: StateSpaceModel, table: Mapping[str, float], load_: float) -> None:
    stiffness = force(built, table, 0.0, load_, wanted=[STIFFNESS])[0]
    slope = force(built, table, 1e-8, load_)[0] / 1e-8  # a brush bends from the first slip on
    require(stiffness > 0, f"{name}: publishes a cornering stiffness of {stiffness:g}")
    same = np.isclose(slope, stiffness, rtol=1e-6, atol=0)
    require(same, f"{name}: publishes a cornering stiffness of {stiffness:g}, its slope is {slope:g}")


def _check_capacity(name: str, built: StateSpaceModel, table: Mapping[str, float], load_: float) -> None:
    on_dry = force(built, table, 0.0, load_, 1.0, [CAPACITY])[0]
    for friction in (0.2, 0.9):
        reached, limit = np.array([force(built, table, s, load_, friction, [FORCE, CAPACITY]) for s in SLIPS]).T
        require(np.allclose(limit, friction * on_dry), f"{name}: its capacity is not in proportion to the friction")
        require((np.abs(reached) <= limit * (1 + 1e-12)).all(), f"{name}: the force exceeds its capacity")
        require(reached.max() > 0.5 * limit[0], f"{name}: the force never comes near its capacity")


def rig() -> Any:
    """Return a vehicle of one axle whose slip angle, load and friction are given."""
    module: Any = types.ModuleType("rig")
    module.STATES, module.INPUTS = ("lateral_force_axle_11",), ("road_wheel_angle", "speed")
    module.AXLES, module.VALID = {"11": "11"}, {}
    module.PARAMETERS = (
        Parameter("axle_load", "F_z", "N", 1e2, 1e6, "load"),
        Parameter("friction", r"\mu", "dimensionless", 0.01, 2.0, "friction"),
        Parameter("relaxation_length", r"\ell", "m", 0.01, 2.0, "lag"),
    )

    def equations(v):
        steady = v.tyre("11", v.input("road_wheel_angle"), v.p("axle_load"), v.p("friction"))
        rate = v.input("speed") / v.p("relaxation_length") * (steady - v.state("lateral_force_axle_11"))
        v.derivative("lateral_force_axle_11", rate)

    module.equations = equations
    return module


def tables(tyre: str) -> list[dict[str, float]]:
    """Return the tyre's parameters of every axle group of every parameter set, renamed to the rig's axle."""
    on_rig = assemble(rig(), tyre).parameter_names
    names = [p.name for p in load("tyres", tyre).PARAMETERS if f"{p.name}_11" in on_rig]

    def found() -> Iterator[dict[str, float]]:
        for file in PARAMETERS.names():
            module = load("parameters", file)
            for group in sorted(set(load("vehicles", module.VEHICLE).AXLES.values())):
                if all(f"{n}_{group}" in module.VALUES for n in names):
                    yield {f"{n}_11": module.VALUES[f"{n}_{group}"] for n in names}

    return list(found())


def loads(table: Mapping[str, float], usual: float = USUAL_LOAD) -> list[float]:
    """Return axle loads in N that suit a tyre."""
    return [share * table.get("stiffness_load_11", usual) for share in LOADS]


def force(
    built: StateSpaceModel,
    table: Mapping[str, float],
    slip: float,
    load_: float,
    friction: float = 0.9,
    wanted: Sequence[str] = (FORCE,),
) -> np.ndarray:
    """Return quantities of the tyre at a slip angle in rad and a load in N."""
    point = {"lateral_force_axle_11": 0.0, "speed": 10.0, "road_wheel_angle": slip, "axle_load": load_}
    point |= {"friction": friction, "relaxation_length": 0.4, **table}
    return evaluate(built, [built.resolve(name) for name in wanted], point)
