"""Models with an effect in force, looked at in one point: what the tests of single effects stand on."""

from __future__ import annotations

from functools import cache

import numpy as np

from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.parameters import althoff_2020, govindarajan_2018, ziaukas_2023
from support.numeric import evaluator

G = 9.81
SENSORS = {"semitrailer": "test_vehicle_inertial", "car": "car_navigation", "car_two_track": "car_inertial"}
VALUES = {"semitrailer": ziaukas_2023.VALUES, "car": govindarajan_2018.VALUES, "car_two_track": althoff_2020.VALUES}


@cache
def built(vehicle: str, effects: tuple[str, ...], tyre: str = "magic_formula") -> StateSpaceModel:
    return assemble(vehicle, tyre, effects, SENSORS[vehicle])


def values(model: StateSpaceModel, vehicle: str, **own: float) -> dict[str, float]:
    neutral = {p.name: p.neutral for p in model.parameters if p.neutral is not None}
    return {**VALUES[vehicle], **neutral, **own}


def point(model: StateSpaceModel, **given: float) -> tuple[np.ndarray, np.ndarray]:
    """Return state and inputs by name; what is not given is zero, the speed 20 m/s."""
    given = {"speed": 20.0, "longitudinal_velocity": 20.0, "friction_coefficient": 1.0, **given}
    return tuple(np.array([given.get(n, 0.0) for n in names]) for names in (model.states, model.inputs))


def look(vehicle: str, effects: tuple[str, ...], quantities: tuple[str, ...], own: dict, tyre="magic_formula", **at):
    """Return named quantities of a model at a point."""
    model = built(vehicle, effects, tyre)
    known = (*model.ports, *model.states, *model.inputs)
    assert all(q in known for q in quantities)
    return evaluator(model, values(model, vehicle, **own), quantities)(*point(model, **at))


def rates(vehicle: str, effects: tuple[str, ...], own: dict, tyre="magic_formula", **at) -> dict[str, float]:
    """Return the derivatives of the states by name at a point."""
    model = built(vehicle, effects, tyre)
    found = evaluator(model, values(model, vehicle, **own))(*point(model, **at))
    return dict(zip(model.states, found, strict=True))
