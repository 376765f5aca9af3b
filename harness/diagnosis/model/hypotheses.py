"""What a model may lack: each effect of the library at each place, and each parameter that was held fixed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.model.augmented_model import Whole
from harness.models.assembly.placement import (
    load_effect,
    parameter_at,
    place_of,
    ports_of,
    split,
    suffix,
)
from harness.models.contracts import Parameter

ALL_PARAMETERS = "parameters"
"""Name of the hypothesis that many parameters are wrong at once, each a little."""

PRIOR = 0.2
"""Standard deviation of the logarithm of a parameter about its stated value, where all are fitted at once."""


@dataclass(frozen=True)
class Hypothesis:
    """Something that a model may lack.

    Attributes:
        name: Effect with its place, or the parameter.
        kind: Whether it is an effect or a parameter of the model that was held fixed.
        amplitudes: Parameters that say how much of it there is; at their neutral value it is absent.
        shapes: Parameters that mean nothing while it is absent.
        moments: Parameters of which every drive has its own.
        output: Column of the only output that it acts on, if it is a fault of one sensor.
    """

    name: str
    kind: Literal["effect", "parameter"]
    amplitudes: tuple[str, ...]
    shapes: tuple[str, ...] = ()
    moments: tuple[str, ...] = ()
    output: int | None = None

    @property
    def shared(self) -> tuple[str, ...]:
        """Parameters that all drives share."""
        return self.amplitudes + self.shapes

    def count(self, drives: int) -> int:
        """Return how many numbers it adds to a fit of several drives."""
        return len(self.shared) + drives * len(self.moments)


def hypotheses(whole: Whole, free: Sequence[str]) -> tuple[Hypothesis, ...]:
    """Return everything to be tried on a model whose ``free`` parameters are fitted anyway.

    An effect that belongs to tyres or bodies is tried at each place and at all of them at once. All parameters at
    once are those that cannot be negative: each moves by a share of its value.
    """
    fixed = [p for p in whole.nominal.parameters if p.name not in free and p.lower < p.upper and not p.numerical]
    found = [Hypothesis(p.name, "parameter", (p.name,)) for p in fixed]
    found.append(Hypothesis(ALL_PARAMETERS, "parameter", tuple(p.name for p in fixed if p.lower > 0)))
    everywhere: dict[str, list[Hypothesis]] = {}
    for name in whole.placements:
        one = _effect(whole, name)
        found.append(one)
        if place_of(load_effect(name)) in ("tyre", "body"):
            everywhere.setdefault(split(name)[0], []).append(one)
    found += [_together(file, parts) for file, parts in everywhere.items() if len(parts) > 1]
    return tuple(found)


def _effect(whole: Whole, name: str) -> Hypothesis:
    place = split(name)[1] or ""
    declared = [parameter_at(p, place) for p in load_effect(name).PARAMETERS]
    known = [p for p in declared if p.name in whole.names]
    return Hypothesis(
        name,
        "effect",
        tuple(p.name for p in known if p.neutral is not None),
        tuple(p.name for p in known if p.neutral is None and not p.per_drive),
        tuple(p.name for p in known if p.per_drive),
        _only_output(whole, name),
    )


def _only_output(whole: Whole, name: str) -> int | None:
    """Return the column of the only output that an effect acts on, if it changes what one sensor reads."""
    effect, place = load_effect(name), split(name)[1] or ""
    if not all(port.startswith("sensor_") for port in ports_of(effect)):
        return None
    read = {port.removeprefix("sensor_").replace("{body}", suffix(place)) for port in ports_of(effect)}
    read = {place} if place_of(effect) == "output" else read
    columns = [i for i, output in enumerate(whole.nominal.outputs) if output in read]
    return columns[0] if len(columns) == 1 else None


def _together(file: str, parts: Sequence[Hypothesis]) -> Hypothesis:
    def union(attribute: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(itertools.chain.from_iterable(getattr(p, attribute) for p in parts)))

    return Hypothesis(file, "effect", union("amplitudes"), union("shapes"), union("moments"))


@dataclass(frozen=True)
class Coordinate:
    """One number that a fit moves.

    Attributes:
        parameter: Of the whole model.
        row: Its row.
        drives: Drives in which it acts: all, or one for a moment.
        logarithmic: Whether the coordinate is the logarithm.
        scale: Otherwise the parameter is the coordinate times this.
        centre: Stated value, as a coordinate.
        prior: Standard deviation of a normal prior about it; infinite without one.
    """

    parameter: Parameter
    row: int
    drives: tuple[int, ...]
    logarithmic: bool
    scale: float
    centre: float
    prior: float = math.inf

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate."""
        return self.coordinate(self.parameter.lower), self.coordinate(self.parameter.upper)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        return math.log(value) if self.logarithmic else value / self.scale

    def value(self, z: float | Floats) -> float | Floats:
        """Return the parameter."""
        return np.exp(z) if self.logarithmic else self.scale * z

    def slope(self, z: float) -> float:
        """Return the derivative of the parameter to the coordinate."""
        return math.exp(z) if self.logarithmic else self.scale


def coordinates(whole: Whole, free: Sequence[str], added: Sequence[Hypothesis], drives: int) -> tuple[Coordinate, ...]:
    """Return what a fit moves: the free parameters of the nominal model and those of the hypotheses added to it."""
    everywhere = tuple(range(drives))
    alone = dict.fromkeys([*free, *(n for h in added if h.name != ALL_PARAMETERS for n in h.shared)])
    many = dict.fromkeys(n for h in added if h.name == ALL_PARAMETERS for n in h.shared if n not in alone)
    moments = dict.fromkeys(n for h in added for n in h.moments)
    return (
        *(_coordinate(whole, name, everywhere) for name in alone),
        *(_coordinate(whole, name, everywhere, PRIOR) for name in many),
        *(_coordinate(whole, name, (i,)) for name in moments for i in everywhere),
    )


def _coordinate(whole: Whole, name: str, drives: tuple[int, ...], prior: float = math.inf) -> Coordinate:
    row = whole.row(name)
    p = whole.model.parameters[row]
    logarithmic = p.lower > 0 and not p.per_drive
    scale = 1.0 if p.per_drive else 0.1 * max(abs(p.lower), abs(p.upper))
    value = whole.spec.values.get(name, p.lower)
    centre = math.log(value) if logarithmic else value / scale
    return Coordinate(p, row, drives, logarithmic, scale, centre, prior)
