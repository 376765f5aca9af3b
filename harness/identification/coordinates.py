"""The coordinates in which a fit searches: logarithms of positive quantities, within bounds, with priors.

A coordinate moves one parameter of the model, the process noise of all states that share a unit (by one factor), or
the noise of one output. Logarithms make steps relative, keep signs, and make a normal distribution of the estimate a
better approximation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.config.bounds import broken_relations
from harness.identification.innovations import Held, hold
from harness.models.signals import SIGNALS

Kind = Literal["parameter", "process", "measurement"]

NOISE_RANGE = 1e8
"""Factor by which a variance may leave its first value, to both sides."""

PROCESS_PRIOR = math.log(100.0)
"""Standard deviation of the logarithm of a process-noise factor before the data: a factor of ten on the deviation."""


@dataclass(frozen=True)
class Coordinate:
    """One coordinate of a search.

    Attributes:
        name: Parameter, ``process_noise <unit>`` or ``measurement_noise <output>``.
        kind: What it moves.
        rows: Rows of the moved quantities in ``Held``.
        start: First value of the coordinate.
        lower: Its lower bound.
        upper: Its upper bound.
        logarithmic: Whether it is the logarithm of the parameter or of the factor on the variances.
        unit: SI unit of the parameter or variance; of a factor none.
        spread: Standard deviation of a normal prior about ``start``; infinite without one.
    """

    name: str
    kind: Kind
    rows: tuple[int, ...]
    start: float
    lower: float
    upper: float
    logarithmic: bool
    unit: str
    spread: float = math.inf

    def value(self, z: float) -> float:
        """Return the parameter, the factor or the variance that belongs to a value of the coordinate."""
        return math.exp(z) if self.logarithmic else z

    def error(self, z: float, spread: float) -> float:
        """Return the standard error of the value that belongs to one of the coordinate."""
        return spread * math.exp(z) if self.logarithmic else spread


class Space:
    """The coordinates of a fit around a model.

    Args:
        spec: The model; parameters that are not free keep its values, states without process noise stay without.
        free: Names of the free parameters.
        measurement: First variance of each output ``(ny,)``.
        priors: Standard deviation of the prior about the first value by parameter: of its logarithm where the
            parameter is positive, else in its unit.
        process: Whether the process noise moves too.

    Raises:
        UserError: If a name is unknown or a parameter has no room to move.
    """

    def __init__(
        self,
        spec: ModelSpec,
        free: Sequence[str],
        measurement: Floats,
        priors: Mapping[str, float] | None = None,
        process: bool = True,
    ) -> None:
        self.spec = spec
        self._held = hold(spec)
        self._held = replace(self._held, measurement=np.asarray(measurement, dtype=float).reshape(-1, 1))
        self.coordinates = (
            *_parameters(spec, free, priors or {}),
            *(_process(spec) if process else ()),
            *_measurement(spec, self._held.measurement[:, 0]),
        )
        self.start = np.array([c.start for c in self.coordinates])
        self.lower = np.array([c.lower for c in self.coordinates])
        self.upper = np.array([c.upper for c in self.coordinates])
        self.weight = np.array([c.spread**-2 for c in self.coordinates])

    def __len__(self) -> int:
        return len(self.coordinates)

    def kind(self, *kinds: Kind) -> NDArray[np.bool_]:
        """Return which coordinates are of these kinds."""
        return np.array([c.kind in kinds for c in self.coordinates])

    def held(self, z: Floats) -> Held:
        """Return what candidates ``z (n,)`` or ``(n, candidates)`` hold."""
        columns = np.atleast_2d(z.T).T
        tables = {
            "parameter": np.repeat(self._held.values, columns.shape[1], axis=1),
            "process": np.repeat(self._held.process, columns.shape[1], axis=1),
            "measurement": np.repeat(self._held.measurement, columns.shape[1], axis=1),
        }
        for c, row in zip(self.coordinates, columns, strict=True):
            moved = np.exp(row) if c.logarithmic else row
            if c.kind == "process":
                tables[c.kind][list(c.rows)] *= moved
            else:
                tables[c.kind][c.rows[0]] = moved
        return Held(tables["parameter"], tables["process"], tables["measurement"])

    def directions(self, z: Floats, chosen: NDArray[np.bool_] | None = None) -> Held:
        """Return the derivatives of what is held by the chosen coordinates (all by default)."""
        at = self.held(z)
        tables = {"parameter": at.values, "process": at.process, "measurement": at.measurement}
        index = np.arange(len(self)) if chosen is None else np.flatnonzero(chosen)
        slopes = {kind: np.zeros((len(table), len(index))) for kind, table in tables.items()}
        for j, i in enumerate(index):
            c = self.coordinates[i]
            rows = list(c.rows)
            slopes[c.kind][rows, j] = tables[c.kind][rows, 0] if c.logarithmic else 1.0
        return Held(slopes["parameter"], slopes["process"], slopes["measurement"])

    def possible(self, z: Floats) -> bool:
        """Whether the values of a candidate ``(n,)`` are possible together, as the vehicle file says."""
        held = self.held(z).values[:, 0]
        values = dict(zip(self.spec.model().parameter_names, map(float, held), strict=True))
        return not broken_relations(self.spec.vehicle, values)

    def fitted(self, z: Floats) -> ModelSpec:
        """Return the model with the values and variances of a candidate."""
        model, held = self.spec.model(), self.held(z)
        return replace(
            self.spec,
            values=dict(zip(model.parameter_names, map(float, held.values[:, 0]), strict=True)),
            process_noise=dict(zip(model.states, map(float, held.process[:, 0]), strict=True)),
            measurement_noise=dict(zip(model.outputs, map(float, held.measurement[:, 0]), strict=True)),
        )


def _parameters(spec: ModelSpec, free: Sequence[str], priors: Mapping[str, float]) -> list[Coordinate]:
    model = spec.model()
    names, found = model.parameter_names, []
    for name in (*free, *priors):
        if name not in names:
            raise UserError(f"free: the model has no parameter '{name}'{closest(name, names)}")
    for name in dict.fromkeys(free):
        row = names.index(name)
        p, value = model.parameters[row], spec.values[name]
        if not p.lower < p.upper:
            raise UserError(f"free: '{name}' has no room between its bounds {p.lower:g} and {p.upper:g} {p.unit}")
        logarithmic = p.lower > 0
        scale = math.log if logarithmic else float
        bounds = scale(p.lower), scale(p.upper)
        prior = priors.get(name, math.inf)
        found.append(Coordinate(name, "parameter", (row,), scale(value), *bounds, logarithmic, p.unit, prior))
    return found


def _process(spec: ModelSpec) -> list[Coordinate]:
    """Return a coordinate per unit of the noisy states: velocities, angles, forces each share a factor.

    A random effect states its noise itself; how much of it there is, is a parameter.
    """
    groups: dict[str, list[int]] = {}
    model = spec.model()
    for i, state in enumerate(model.states):
        if spec.process_noise[state] > 0 and state not in model.noise:
            groups.setdefault(SIGNALS[state].unit if state in SIGNALS else state, []).append(i)
    bound = math.log(NOISE_RANGE)
    return [
        Coordinate(f"process_noise {unit}", "process", tuple(rows), 0.0, -bound, bound, True, "", PROCESS_PRIOR)
        for unit, rows in groups.items()
    ]


def _measurement(spec: ModelSpec, variances: Floats) -> list[Coordinate]:
    bound, found = math.log(NOISE_RANGE), []
    for a, (output, variance) in enumerate(zip(spec.model().outputs, variances, strict=True)):
        start = math.log(variance)
        unit = f"({SIGNALS[output].unit})^2" if output in SIGNALS else ""
        name = f"measurement_noise {output}"
        found.append(Coordinate(name, "measurement", (a,), start, start - bound, start + bound, True, unit))
    return found
