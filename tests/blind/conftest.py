"""Short drives for the tests of the blind plant."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from plant_drives import RUN_IN, STEP, Drive
from plant_drives import draw as draw_drive

from support.blind_vehicles import NOMINAL


@pytest.fixture(scope="session")
def plans() -> dict[str, Drive]:
    """Return the first 12 s of a drive per vehicle."""
    kept = slice(round(2 * (RUN_IN + 12.0) / STEP) + 1)
    short = {}
    for vehicle in NOMINAL:
        whole = draw_drive(vehicle, np.random.default_rng(3))
        arrays = {f.name: getattr(whole, f.name)[kept] for f in fields(Drive) if f.name != "manoeuvres"}
        short[vehicle] = replace(whole, **arrays)
    return short
