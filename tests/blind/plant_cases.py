"""Every case by name, and the truth that a case and its repeat draw.

A name is ``<vehicle>-<what>``, with ``-small``, ``-medium`` or ``-large`` where there are magnitudes. Random numbers
come from the name and the repeat alone, so a case does not depend on which others there are.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np
from plant_effects import CATALOGUE, MAGNITUDES
from plant_environment import Column, Surroundings
from plant_equations import Car, Semitrailer
from plant_sensors import Channel

VEHICLES: dict[str, type[Semitrailer] | type[Car]] = {"semitrailer": Semitrailer, "car": Car}

SPREAD: dict[str, tuple[str, ...]] = {
    "semitrailer": ("stiffness_peak_11", "stiffness_peak_12", "stiffness_peak_2"),
    "car": ("stiffness_peak_front", "stiffness_peak_rear"),
}
"""Parameters that never are exactly as published: log-normal with 3 %, in every case."""

_STIFFNESS = SPREAD["semitrailer"]
_RELAXATION = ("relaxation_length_11", "relaxation_length_12", "relaxation_length_2")
_SEVERAL = ("trailer_mass", *_STIFFNESS, "steering_ratio", "trailer_inertia_scale", *_RELAXATION)
MISMATCHES: dict[str, dict[str, tuple[tuple[str, ...], float, float]]] = {
    "semitrailer": {
        "trailer_mass": (("trailer_mass",), 0.10, 0.30),
        "tractor_mass": (("tractor_mass",), 0.05, 0.15),
        "tractor_yaw_inertia": (("tractor_yaw_inertia",), 0.15, 0.40),
        "trailer_inertia": (("trailer_inertia_scale",), 0.15, 0.40),
        "trailer_cog": (("trailer_cog_from_rear",), 0.03, 0.08),
        "stiffness": (_STIFFNESS, 0.10, 0.25),
        "stiffness_front": (("stiffness_peak_11",), 0.10, 0.25),
        "friction": (("friction",), 0.10, 0.25),
        "ratio": (("steering_ratio",), 0.03, 0.10),
        "relaxation": (_RELAXATION, 0.30, 0.60),
        "masses": (("tractor_mass", "trailer_mass"), 0.05, 0.20),
        "several": (_SEVERAL, 0.03, 0.10),
    },
    "car": {
        "mass": (("mass",), 0.05, 0.20),
        "yaw_inertia": (("yaw_inertia",), 0.10, 0.25),
        "stiffness": (SPREAD["car"], 0.10, 0.25),
        "ratio": (("steering_ratio",), 0.03, 0.10),
        "several": (("mass", "yaw_inertia", *SPREAD["car"], "steering_ratio"), 0.03, 0.10),
    },
}
"""Parameters that are wrong together, each by a share between two bounds to either side."""

PAIRS: dict[str, tuple[tuple[str, str], ...]] = {
    "semitrailer": (
        ("crosswind", "kingpin_friction"),
        ("crosswind", "steering_ratio_nonlinear"),
        ("friction_change", "sensor_gain_speed"),
        ("kingpin_friction", "steering_lag"),
        ("kingpin_friction", "sensor_lever_arm"),
        ("lifted_axle", "road_bank"),
        ("liquid_slosh", "steering_offset"),
        ("payload_shift", "steering_delay"),
        ("road_bank", "steering_lag"),
        ("self_steering_axle", "sensor_bias"),
        ("tyre_stiffness_drift", "steering_offset"),
        ("yaw_moment_control", "road_bank"),
    ),
    "car": (
        ("crosswind", "tyre_relaxation"),
        ("road_bank", "steering_lag"),
        ("steering_ratio_nonlinear", "sensor_lever_arm"),
        ("tyre_saturation", "steering_offset"),
    ),
}
"""Two effects at once, of those that do not resemble one another."""

KINDS = ("none", "parameters", "effect", "pair", "unlisted")


@dataclass(frozen=True)
class Case:
    """What is to be drawn: effects with their magnitude, or a mismatch of parameters, or nothing."""

    name: str
    vehicle: str
    kind: str
    effects: tuple[str, ...] = ()
    magnitude: str = ""
    mismatch: str = ""
    first_draw: int = 0


@dataclass(frozen=True)
class Drawn:
    """An effect as drawn: its name in the catalogue, the place, and the values in SI units."""

    name: str
    magnitude: str
    place: str
    values: dict[str, float]


@dataclass(frozen=True)
class Truth:
    """What is true in a case: published values but for ``parameters`` and the effects."""

    vehicle: str
    parameters: dict[str, float]
    effects: list[Drawn] = field(default_factory=list)

    def _values(self) -> dict[str, float]:
        return {**self.parameters, **{k: v for e in self.effects for k, v in e.values.items()}}

    def equations(self) -> Semitrailer | Car:
        """Return the parameters of the equations."""
        kind = VEHICLES[self.vehicle]
        return kind(**{k: v for k, v in self._values().items() if k in kind._fields})

    def column(self) -> Column:
        """Return the steering column."""
        return Column(**{k: v for k, v in self._values().items() if k in Column._fields})

    def surroundings(self) -> Surroundings:
        """Return what changes along a drive."""
        return Surroundings(**{k: v for k, v in self._values().items() if k in Surroundings._fields})

    def sensors(self) -> dict[str, Channel]:
        """Return the sensors with something wrong, by channel."""
        wrong: dict[str, dict[str, float]] = {}
        for key, value in self._values().items():
            field_, _, channel = key.partition("@")
            if channel:
                wrong.setdefault(channel, {})[field_] = value
        return {channel: Channel(**fields) for channel, fields in wrong.items()}


def cases() -> dict[str, Case]:
    """Return every case by name."""
    found = []
    for vehicle, catalogue in CATALOGUE.items():
        found.append(Case(f"{vehicle}-none", vehicle, "none"))
        found += [Case(f"{vehicle}-parameters-{m}", vehicle, "parameters", mismatch=m) for m in MISMATCHES[vehicle]]
        for effect in catalogue.values():
            kind = "effect" if effect.in_library else "unlisted"
            found += [
                Case(f"{vehicle}-{effect.name}-{m}", vehicle, kind, (effect.name,), m, first_draw=effect.first_draw)
                for m in MAGNITUDES
            ]
        found += [Case(f"{vehicle}-{'+'.join(p)}", vehicle, "pair", p, "medium") for p in PAIRS[vehicle]]
    return {case.name: case for case in found}


def choose(seed: int) -> Case:
    """Return a case at random: first its kind, each as likely, then one of that kind."""
    rng = np.random.default_rng(seed)
    kind = KINDS[rng.integers(len(KINDS))]
    of_kind = [case for case in cases().values() if case.kind == kind and case.first_draw <= seed]
    return of_kind[rng.integers(len(of_kind))]


def seeds(case: Case, repeat: int) -> list[np.random.SeedSequence]:
    """Return one seed for the truth, one for each of three drives, and one for the measuring system."""
    return np.random.SeedSequence([zlib.crc32(case.name.encode()), repeat]).spawn(5)


def draw(case: Case, rng: np.random.Generator) -> Truth:
    """Return the truth of a case: spread of the tyres, then mismatch or effects."""
    published = VEHICLES[case.vehicle]()
    parameters = {
        name: getattr(published, name) * float(np.exp(0.03 * rng.standard_normal())) for name in SPREAD[case.vehicle]
    }
    if case.mismatch:
        names, least, most = MISMATCHES[case.vehicle][case.mismatch]
        for name in names:
            share = float(rng.choice([-1.0, 1.0]) * rng.uniform(least, most))
            parameters[name] = parameters.get(name, getattr(published, name)) * (1.0 + share)
    drawn = [
        Drawn(name, case.magnitude, *CATALOGUE[case.vehicle][name].draw(case.magnitude, rng)) for name in case.effects
    ]
    return Truth(case.vehicle, parameters, drawn)
