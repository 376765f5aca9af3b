"""Hypotheses of what a model lacks: each library effect at each place, and each parameter that was held fixed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.model.augmented_model import AugmentedModel, stays
from harness.identification.coordinates import Coordinate, intensity_coordinate, parameter_coordinate
from harness.models.assembly.placement import (
    load_effect,
    parameter_at,
    place_of,
    ports_of,
    split,
    suffix,
)
from harness.models.quantities import words

ALL_PARAMETERS = "parameters"
"""Name of the hypothesis that many parameters are wrong at once, each a little."""

CHANNEL_DELAYS = "channel_delays"
"""Name of the hypothesis that the channels of the recording have clocks of their own."""

SENSOR_DRIFTS = "sensor_drifts"
"""Name of the hypothesis that the biases of all gyroscopes wander."""

_JOINT = {
    ALL_PARAMETERS: "many parameters at once",
    CHANNEL_DELAYS: "delays of the channels",
    SENSOR_DRIFTS: "drifts of the gyroscopes",
}
"""Names in words of hypotheses that try several things at once."""

OF_ROADS = ("road_bank",)
"""Parameters that are of the road: where they are fitted in any case, every drive has its own."""

_LATE = ("steering_delay", "speed_delay", "sensor_delay")
"""Effects that say so of one channel each."""


def called(name: str, place_after: str = ", ") -> str:
    """Return the name of a hypothesis in words, with the text that stands between an effect and its place."""
    if name in _JOINT:
        return _JOINT[name]
    effect, _, place = name.partition("@")
    return f"{words(effect)}{place_after}{words(place)}" if place else words(effect)


@dataclass(frozen=True)
class Hypothesis:
    """Something that a model may lack.

    Attributes:
        name: Effect with its place, or the parameter.
        kind: Whether it is an effect or a parameter of the model that was held fixed.
        amplitudes: Parameters that say how much of it there is; at their neutral value it is absent.
        shapes: Parameters that mean nothing while it is absent.
        change_times: Parameters of which every drive has its own.
        output: Column of the only output that it acts on, if it is a fault of one sensor.
        random: Whether it is a random process: it has no response to be tested, and no simulation predicts it.
        parts: Hypotheses that it tries at once, which then stand in a model in its place; none of most.
        changed: Whether it is of what changed since earlier drives, whose clocks and drifts are known.
    """

    name: str
    kind: Literal["effect", "parameter"]
    amplitudes: tuple[str, ...]
    shapes: tuple[str, ...] = ()
    change_times: tuple[str, ...] = ()
    output: int | None = None
    parts: tuple[Hypothesis, ...] = ()
    random: bool = False
    changed: bool = False

    @property
    def single(self) -> tuple[Hypothesis, ...]:
        """What a model has that it is added to."""
        return self.parts or (self,)

    @property
    def many(self) -> bool:
        """Whether it is that many things are wrong at once, which predicts a gain whatever is missing."""
        return bool(self.parts) or self.name == ALL_PARAMETERS

    @property
    def clock(self) -> bool:
        """Whether it is that a channel of the recording is late."""
        return split(self.name)[0] in _LATE

    @property
    def of_recording(self) -> bool:
        """Whether it is a fault of a sensor or of a channel's clock, and not a lack of the vehicle's model."""
        return self.output is not None or self.clock

    @property
    def expected(self) -> bool:
        """Whether recordings have it anyway: a clock of a channel's own, or a sensor that drifts."""
        return not self.changed and (self.clock or (self.random and self.of_recording))

    @property
    def shared(self) -> tuple[str, ...]:
        """Parameters that all drives share."""
        return self.amplitudes + self.shapes

    def count(self, drives: int) -> int:
        """Return how many numbers it adds to a fit of several drives."""
        return len(self.shared) + drives * len(self.change_times)


def hypotheses(augmented: AugmentedModel, free: Sequence[str]) -> tuple[Hypothesis, ...]:
    """Return everything to be tried on a model whose ``free`` parameters are fitted anyway.

    An effect that belongs to tyres or bodies is tried at each place and at all of them at once. All parameters at
    once are those of which is known how far they may be off. The delays of all channels are tried at
    once as well: of four clocks that differ none alone explains much, and other effects resemble their sum. Gyroscopes
    of one logger drift together or not at all.
    """
    fixed = [p for p in augmented.nominal.parameters if p.name not in free and p.lower < p.upper and not p.numerical]
    tried = [Hypothesis(p.name, "parameter", (p.name,)) for p in fixed]
    tried.append(
        Hypothesis(
            ALL_PARAMETERS, "parameter", tuple(p.name for p in fixed if math.isfinite(augmented.stated_std(p.name)))
        )
    )
    everywhere: dict[str, list[Hypothesis]] = {}
    for name in augmented.placements:
        effect = _effect(augmented, name)
        tried.append(effect)
        if place_of(load_effect(name)) in ("tyre", "body"):
            everywhere.setdefault(split(name)[0], []).append(effect)
    processes = [replace(_effect(augmented, name), random=True) for name in augmented.processes]
    tried += processes
    tried += [_together(file, parts) for file, parts in everywhere.items() if len(parts) > 1]
    late = [h for h in tried if h.clock]
    if len(late) > 1:
        tried.append(replace(_together(CHANNEL_DELAYS, late), parts=tuple(late)))
    drifts = [h for h in processes if h.of_recording]
    if len(drifts) > 1:
        tried.append(replace(_together(SENSOR_DRIFTS, drifts), parts=tuple(drifts), random=True))
    if not augmented.held.names:
        return tuple(tried)
    return tuple(_changed(h) for h in tried if not h.change_times or stays(h.name))


def _changed(h: Hypothesis) -> Hypothesis:
    """Return a hypothesis as one of what changed since earlier drives; what happens in a drive happened before."""
    return replace(h, changed=True, change_times=(), parts=tuple(map(_changed, h.parts)))


def random_processes(augmented: AugmentedModel) -> tuple[Hypothesis, ...]:
    """Return the random processes that a vehicle and its recordings have: road, sensors, discrepancy by body."""
    names = (*augmented.processes, *augmented.discrepancy)
    return tuple(replace(_effect(augmented, name), random=True) for name in names)


def still_open(h: Hypothesis, taken: Container[str]) -> Hypothesis | None:
    """Return a hypothesis without the amplitudes that are taken; ``None`` if nothing is left to be tried."""
    rest = tuple(a for a in h.amplitudes if a not in taken)
    parts = tuple(p for p in h.parts if set(p.amplitudes) <= set(rest))
    return replace(h, amplitudes=rest, parts=parts) if rest and (not h.parts or len(parts) > 1) else None


def _effect(augmented: AugmentedModel, name: str) -> Hypothesis:
    place = split(name)[1] or ""
    declared = [parameter_at(p, place) for p in load_effect(name).PARAMETERS]
    parameters = [p for p in declared if p.name in augmented.names]
    return Hypothesis(
        name,
        "effect",
        tuple(p.name for p in parameters if p.neutral is not None),
        tuple(p.name for p in parameters if p.neutral is None and not p.per_drive),
        tuple(p.name for p in parameters if p.per_drive),
        _only_output(augmented, name),
    )


def _only_output(augmented: AugmentedModel, name: str) -> int | None:
    """Return the column of the only output that an effect acts on, if it changes what one sensor reads."""
    effect, place = load_effect(name), split(name)[1] or ""
    if not all(port.startswith("sensor_") for port in ports_of(effect)):
        return None
    read = {port.removeprefix("sensor_").replace("{body}", suffix(place)) for port in ports_of(effect)}
    read = {place} if place_of(effect) == "output" else read
    columns = [i for i, output in enumerate(augmented.nominal.outputs) if output in read]
    return columns[0] if len(columns) == 1 else None


def _together(file: str, parts: Sequence[Hypothesis]) -> Hypothesis:
    def union(attribute: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(itertools.chain.from_iterable(getattr(p, attribute) for p in parts)))

    return Hypothesis(file, "effect", union("amplitudes"), union("shapes"), union("change_times"))


def coordinates(
    model: AugmentedModel,
    free: Sequence[str],
    added: Sequence[Hypothesis],
    drives: int,
    stated: Mapping[str, float] | None = None,
) -> tuple[Coordinate, ...]:
    """Return what a fit moves: the free parameters of the nominal model and those of the hypotheses added to it.

    Args:
        model: The augmented model.
        free: Parameters of the nominal model that are fitted in any case.
        added: What is added to it.
        drives: Number of drives.
        stated: Standard deviation with which a free parameter is known beforehand; those that are absent have no prior.
    """
    plain = [h for h in added if not h.random]
    open_ = {n for h in added for n in h.shared}
    held = [n for n in model.held.names if n not in open_]
    alone = dict.fromkeys([*free, *(n for h in plain if h.name != ALL_PARAMETERS for n in h.shared)])
    stated = stated or {}
    many = dict.fromkeys(n for h in added if h.name == ALL_PARAMETERS for n in h.shared if n not in alone)
    change_times = dict.fromkeys(n for h in added for n in h.change_times)
    roads = [n for n in alone if n in OF_ROADS and n in free]
    return (
        *(replace(_coordinate(model, name), held=True) for name in held),
        *(
            _coordinate(model, name, std=stated.get(name, math.inf) if name in free else math.inf)
            for name in alone
            if name not in roads
        ),
        *(_coordinate(model, name, drives=(i,)) for name in roads for i in range(drives)),
        *(_in_question(model, name) for name in many),
        *(_coordinate(model, name, drives=(i,)) for name in change_times for i in range(drives)),
        *(_intensity(model, n) for h in added if h.random for n in h.amplitudes),
    )


def _intensity(model: AugmentedModel, name: str) -> Coordinate:
    """Return the coordinate of an intensity; one that other drives showed is as alike as those of another day are."""
    row = model.row(name)
    before = float(model.stated()[row])
    c = intensity_coordinate(model.model.parameters[row], row, before)
    return replace(c, prior=PRIORS.intensity) if before > 0.0 else c


def _in_question(model: AugmentedModel, name: str) -> Coordinate:
    c = _coordinate(model, name)
    return replace(c, prior=c.stated_std)


def _coordinate(model: AugmentedModel, name: str, drives: tuple[int, ...] = (), std: float = math.inf) -> Coordinate:
    row = model.row(name)
    p = model.model.parameters[row]
    value, scale = model.spec.values.get(name, p.lower), 0.1 * max(abs(p.lower), abs(p.upper))
    value = float(model.stated()[row]) if name in model.held.names else value
    lower, upper = model.bounds(name)
    c = parameter_coordinate(replace(p, lower=lower, upper=upper), row, value, math.inf, scale, drives)
    prior = c.known_to(model.stated_std(name)).prior
    return replace(c if math.isinf(std) else c.known_to(std), stated_std=prior)
