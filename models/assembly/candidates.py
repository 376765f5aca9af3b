"""Effects of the library that a vehicle can have, one place at a time: the candidates for additions to a model."""

from __future__ import annotations

import functools

from harness.common.components import remembered
from harness.common.errors import ModelError
from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.assembly.placement import Layout, place_of, sites
from harness.models.roles import EFFECTS, VEHICLES


@remembered
@functools.lru_cache(maxsize=256)
def assembled(vehicle: str, tyre: str | None, effects: tuple[str, ...], sensors: str | None) -> StateSpaceModel:
    """Return what ``assemble`` does, remembered: a search asks for the same models several times."""
    return assemble(vehicle, tyre, effects, sensors)


@remembered
@functools.lru_cache(maxsize=64)
def placements(vehicle: str, tyre: str | None, sensors: str | None) -> tuple[str, ...]:
    """Return the name of every effect at every place where it fits, ``crosswind@trailer`` or ``steering_lag``.

    Args:
        vehicle: File in ``models/vehicles``.
        tyre: File in ``models/tyres``; ``None`` for a vehicle without tyres.
        sensors: File in ``models/sensors``; ``None`` leaves out the errors of sensors.

    Raises:
        ModelError: If these parts make no model.
    """
    ports = assembled(vehicle, tyre, (), sensors).ports
    layout = Layout.of(VEHICLES.load(vehicle))
    effects: list[str] = []
    for file in EFFECTS.names():
        effect = EFFECTS.load(file)
        places = dict.fromkeys(site.place for port in ports for site in sites(effect, port, layout))
        for place in places:
            name = f"{file}@{place}" if place_of(effect) and place else file
            try:
                assembled(vehicle, tyre, (name,), sensors)
            except ModelError:
                continue
            effects.append(name)
    return tuple(effects)
