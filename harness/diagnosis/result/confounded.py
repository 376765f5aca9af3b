"""Directions in which the drives do not tell parameters apart, though they would know each alone.

The Fisher information of the fitted drives alone, without what is known beforehand, is that of the derivatives ``X`` of
the whitened innovations to everything that the final model moved, to every stated value, and to what may stand in the
place of an addition. Along a null direction of it, in logarithms of what is positive, the drives know products of
powers only: in lateral motion every mass, inertia and stiffness may grow by one factor (Rothenberg 1971: a model is
locally identified where the information is regular).

A null space of several dimensions has no basis of its own. So each parameter in question is regressed on the others:
first on what the fit moved, then on further ones that take most of the rest, and on no more of them than are needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, coordinates, hypotheses
from harness.diagnosis.selection.forward_selection import Trace
from harness.identification.coordinates import Coordinate
from harness.models.quantities import listed, print_unit, words
from harness.reporting import style

_FURTHER = 3
"""Values that were held with which one that was fitted may be confounded, and values that a direction names; a longer
sum names nothing."""

_NAMED = 0.2
"""Share of the largest change, each over what it may be off beforehand, from which another one is named."""

_ALONE = 10.0
"""How many times better than beforehand the drives would know a parameter alone, for it to be in question."""

_INTEGER = 0.1
"""By how much a power may differ from a small integer, or from a half."""

_POWERS = {
    0.0: "{0}",
    1.0: "{0} over {1}",
    -1.0: "{0} times {1}",
    2.0: "{0} over the square of {1}",
    -2.0: "{0} times the square of {1}",
    0.5: "the square of {0} over {1}",
    -0.5: "the square of {0} times {1}",
}
"""What is invariant if the second grows by a factor and the first by this power of it."""


@dataclass(frozen=True)
class Direction:
    """A direction in which the drives tell nothing.

    Attributes:
        parameter: What is in question.
        change: Of it along the direction: of its logarithm where ``logarithmic``, else in its unit.
        changes: Of the others: what of them leaves the drives as they are.
        named: Those of them that change most.
        logarithmic: Of each parameter, whether changes are those of its logarithm.
        units: SI units of the parameters.
    """

    parameter: str
    change: float
    changes: dict[str, float]
    named: tuple[str, ...]
    logarithmic: dict[str, bool]
    units: dict[str, str]

    @property
    def powers(self) -> dict[str, float] | None:
        """By which power of the parameter's factor each other one grows; ``None`` if not all are small integers."""
        if not all(self.logarithmic[n] for n in (self.parameter, *self.named)):
            return None
        ratios = {n: self.changes[n] / self.change for n in self.named}
        powers = np.array([*_POWERS])
        nearest = {n: float(powers[np.argmin(np.abs(powers - ratio))]) for n, ratio in ratios.items()}
        exact = all(abs(p - ratios[n]) < _INTEGER for n, p in nearest.items())
        return {n: p for n, p in nearest.items() if p} or None if exact else None

    def __str__(self) -> str:
        """Return it in words: ``These drives know the yaw inertia over the mass, but neither alone``."""
        own, powers = words(self.parameter), self.powers
        if powers is not None:
            products = [_POWERS[p].format(f"the {words(n)}", f"the {own}") for n, p in powers.items()]
            alone = "neither" if len(products) == 1 else "none of these"
            return f"These drives know {listed(products)}, but {alone} alone."
        others = listed(
            [f"{self._changed(n, -c)} of the {words(n)}" for n, c in self.changes.items() if n in self.named]
        )
        return (
            f"These drives do not tell the {own} from the {listed([words(n) for n in self.named])}: "
            f"{self._changed(self.parameter, self.change)} of the {own} acts as {others}."
        )

    def _changed(self, name: str, change: float) -> str:
        sign = "+" if change > 0 else ""
        if self.logarithmic[name]:
            return f"{sign}{style.number(100.0 * math.expm1(change))} %"
        return sign + style.with_unit(change, print_unit(self.units[name]))


def confounded(trace: Trace, rivals: Sequence[Hypothesis]) -> tuple[Direction, ...]:
    """Return the directions in which the drives do not tell apart what was added or refitted, what was added first.

    Args:
        trace: What was found.
        rivals: What may be there in the place of additions.
    """
    augmented, drives = trace.fitting.augmented, len(trace.fitting.drives)
    moved = [c for c in trace.final.coordinates if c.kind == "parameter"]
    names = {c.name for c in moved}
    values = [h for h in hypotheses(augmented, trace.free) if h.kind == "parameter" and h.name != ALL_PARAMETERS]
    plain = [h for h in (*values, *rivals) if not h.random and not h.change_times and h.name != ALL_PARAMETERS]
    further = [c for c in coordinates(augmented, (), plain, drives) if c.name not in names]
    added = [n for h in trace.added if not h.random and h.name != ALL_PARAMETERS for n in h.amplitudes]
    every = [*moved, *further]
    columns = np.vstack(trace.fitting.columns(every, trace.final.point))
    finite = np.isfinite(columns).all(axis=1)
    R = np.asarray(np.linalg.qr(columns[finite], mode="r"), dtype=float)
    widths = np.array([_width(c, trace.final.point.value(c)) for c in every])
    seen = np.linalg.norm(R, axis=0)
    directions: list[Direction] = []
    for name in dict.fromkeys([*added, *trace.free]):
        at = next((i for i, c in enumerate(every) if c.name == name and not c.drives), None)
        if at is None or not math.isfinite(widths[at]) or seen[at] * widths[at] < _ALONE:
            continue
        usable = [i for i in range(len(every)) if i != at and seen[i] > 0 and not seen[i] * widths[i] < _ALONE]
        first = [i for i in usable if i < len(moved)]
        held, width = [i for i in usable if i >= len(moved)], float(widths[at])
        if name not in added:  # it is refitted in the place of what alone does the same, as the load of the tyre
            held = [i for i in held if not null_direction(R, at, [*first, i], (), width)]
        found = null_direction(R, at, first, held, width)
        if not found or any(abs(d) > PRIORS.implausible * widths[i] for i, d in found.items()):
            continue
        named = most(found, widths)
        direction = _direction(every, (at, width), found, named)
        sets = [{d.parameter, *d.named} for d in directions]
        if len(named) <= _FURTHER and {direction.parameter, *direction.named} not in sets:
            directions.append(direction)
    return tuple(directions)


def most(found: Mapping[int, float], widths: Floats) -> list[int]:
    """Return which changes are the largest by what they may be off beforehand; an effect that is absent is always one.

    Args:
        found: Changes by number.
        widths: How far each may be off ``(n,)``.
    """
    shares = {i: abs(d) / widths[i] for i, d in found.items() if math.isfinite(widths[i])}
    return [i for i in found if i not in shares or shares[i] >= _NAMED * max(shares.values())]


def null_direction(R: Floats, at: int, first: Sequence[int], further: Sequence[int], width: float) -> dict[int, float]:
    """Return what of others undoes a change of one parameter, as far as the drives show; empty if nothing does.

    What remains of its column is less than they would show of a change of one width.

    Args:
        R: Triangular factor of the derivatives of the whitened innovations ``(n, n)``.
        at: The parameter.
        first: Those on which it is regressed in any case.
        further: Those of which as many are taken as needed, ``_FURTHER`` at most.
        width: Change of the parameter.
    """
    scale = np.linalg.norm(R, axis=0)
    unit = R / np.where(scale > 0, scale, 1.0)

    def fit(chosen: Sequence[int]) -> tuple[float, Floats]:
        weights = np.linalg.lstsq(unit[:, chosen], R[:, at] * width, rcond=1e-10)[0]
        rest = R[:, at] * width - unit[:, chosen] @ weights
        return float(rest @ rest), np.asarray(weights, dtype=float)

    chosen = list(first)
    remaining = [*further]
    while fit(chosen)[0] >= 1.0 and remaining and len(chosen) < len(first) + _FURTHER:
        best = min(remaining, key=lambda i: fit([*chosen, i])[0])
        chosen.append(best)
        remaining.remove(best)
    if fit(chosen)[0] >= 1.0:
        return {}
    for i in sorted(chosen, key=lambda i: fit([k for k in chosen if k != i])[0]):
        fewer = [k for k in chosen if k != i]
        if fit(fewer)[0] < 1.0:
            chosen = fewer
    return {i: -float(w) / float(scale[i]) for i, w in zip(chosen, fit(chosen)[1], strict=True)}


def _width(c: Coordinate, value: float) -> float:
    """Return how far a coordinate may be off beforehand; an amplitude by itself, one that is absent without limit."""
    if math.isfinite(c.stated_std):
        return c.stated_std
    return abs(value) / c.scale if value != 0.0 else math.inf


def _direction(
    every: Sequence[Coordinate], own: tuple[int, float], found: dict[int, float], named: Sequence[int]
) -> Direction:
    chosen = [every[own[0]], *(every[i] for i in found)]
    steps = zip(chosen, (own[1], *found.values()), strict=True)
    scaled = [step if c.logarithmic else step * c.scale for c, step in steps]
    return Direction(
        chosen[0].name,
        scaled[0],
        {c.name: change for c, change in zip(chosen[1:], scaled[1:], strict=True)},
        tuple(every[i].name for i in named),
        {c.name: c.logarithmic for c in chosen},
        {c.name: c.unit for c in chosen},
    )
