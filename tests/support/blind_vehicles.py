"""The vehicles of the blind plant with nothing undeclared in them, and what one does on a short drive."""

from __future__ import annotations

import numpy as np
from plant_cases import Truth
from plant_drives import STEP, Drive
from plant_environment import Changes, inputs
from plant_simulation import solve

NOMINAL = {vehicle: Truth(vehicle, {}) for vehicle in ("semitrailer", "car")}
EARLY = Changes(gust_begin=3.0, gust_end=9.0, friction=4.0, payload=4.0)


def respond(truth: Truth, plan: Drive) -> np.ndarray:
    """Return the outputs over a short drive with all changes early."""
    return solve(truth, inputs(plan, truth.column(), truth.surroundings(), EARLY, np.random.default_rng(5)), STEP)
