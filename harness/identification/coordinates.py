"""The coordinates in which a fit searches: logarithms of positive quantities, within bounds, with priors.

A coordinate moves one parameter of the model, the process noise of all states that share a unit (by one factor), or
the noise of one output. Logarithms make steps relative, keep signs, and make a normal distribution of the estimate a
better approximation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, overload

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.config.bounds import broken_relations
from harness.config.parameter_set import set_std, stated_std
from harness.identification.candidates import Candidates
from harness.identification.signal_noise import SignalNoise
from harness.models.contracts import Parameter
from harness.models.signals import SIGNALS

Kind = Literal["parameter", "intensity", "process", "measurement"]
"""What a coordinate moves; an intensity is the parameter of a random process, along which a filter whose gains are held
has no slope."""

NOISE_RANGE = 1e8
"""Factor by which a variance may leave its first value, to both sides."""

_LEAST_INTENSITY = 1e-6
"""Share of its upper bound below which no intensity is sought: the process is as good as absent there."""

PROCESS_PRIOR = math.log(100.0)
"""Standard deviation of the logarithm of a process-noise factor before the data: a factor of ten on the deviation."""


@dataclass(frozen=True)
class Coordinate:
    """One number that a fit moves.

    Attributes:
        name: Parameter, ``process_noise <unit>`` or ``measurement_noise <output>``.
        kind: What it moves.
        rows: Rows of the moved quantities in ``Candidates``.
        centre: Stated or first value, as a coordinate.
        lower: Lower bound of the coordinate.
        upper: Upper bound.
        logarithmic: Whether it is the logarithm of the parameter or of the factor on the variances.
        unit: SI unit of the parameter or variance; of a factor none.
        prior: Standard deviation of a normal prior about ``centre``; infinite without one.
        scale: Where it is no logarithm, the parameter is the coordinate times this.
        drives: The only drives in which it acts, by number; empty if it acts in all.
        stated_std: Standard deviation that is stated of it before the recordings; infinite if none is.
        quantisation: Of the variance of an output, the part that the resolution of its signal makes.
        held: Whether it has a prior together with others, as ``Coordinates`` takes it.
    """

    name: str
    kind: Kind
    rows: tuple[int, ...]
    centre: float
    lower: float
    upper: float
    logarithmic: bool
    unit: str
    prior: float = math.inf
    scale: float = 1.0
    drives: tuple[int, ...] = ()
    stated_std: float = math.inf
    quantisation: float = 0.0
    held: bool = False

    def acts_in(self, drive: int) -> bool:
        """Whether it moves anything in a drive."""
        return not self.drives or drive in self.drives

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        return math.log(value) if self.logarithmic else value / self.scale

    @overload
    def value(self, z: float) -> float: ...
    @overload
    def value(self, z: Floats) -> Floats: ...
    def value(self, z: float | Floats) -> float | Floats:
        """Return the parameter, the factor or the variance that belongs to values of the coordinate."""
        if isinstance(z, np.ndarray):
            return np.exp(z) if self.logarithmic else self.scale * z
        return math.exp(z) if self.logarithmic else self.scale * z

    def slope(self, z: float) -> float:
        """Return the derivative of the value to the coordinate."""
        return math.exp(z) if self.logarithmic else self.scale

    def known_to(self, std: float) -> Coordinate:
        """Return the same with a prior by which its value is known to a standard deviation, in the value's unit."""
        return replace(self, prior=std / self.slope(self.centre))


class Coordinates:
    """The coordinates of a fit, about what is held where none of them moves.

    Args:
        spec: The nominal model.
        names: Parameters in the order of the rows of ``base``.
        coordinates: What moves.
        base: The candidate about which it moves, one for all drives or one for each drive.
        joint: Inverse covariance of a prior of several about ``centre`` ``(n, n)``, besides those of each; none by
            default.

    Attributes:
        centre: First value of each coordinate ``(n,)``.
        lower: Lower bounds ``(n,)``.
        upper: Upper bounds ``(n,)``.
        weight: Inverse variances of the priors ``(n,)``.
    """

    def __init__(
        self,
        spec: ModelSpec,
        names: Sequence[str],
        coordinates: Sequence[Coordinate],
        base: Sequence[Candidates],
        joint: Floats | None = None,
    ) -> None:
        self.joint = joint
        self.spec, self.names, self.coordinates, self._base = spec, tuple(names), tuple(coordinates), tuple(base)
        self.centre, self.lower, self.upper = (
            np.array([getattr(c, name) for c in self.coordinates]) for name in ("centre", "lower", "upper")
        )
        self.weight = np.array([c.prior**-2 for c in self.coordinates])

    @classmethod
    def of(
        cls,
        spec: ModelSpec,
        free: Sequence[str],
        measurement: Floats,
        priors: Mapping[str, float] | None = None,
        process: bool = True,
        signals: SignalNoise | None = None,
        stated: bool = False,
    ) -> Coordinates:
        """Return the coordinates of parameters and noise of a model.

        Args:
            spec: The model; parameters that are not free keep its values, states without process noise stay without.
            free: Names of the free parameters.
            measurement: First variance of each output ``(ny,)``.
            priors: Standard deviation of the prior about the first value by parameter: of its logarithm where the
                parameter is positive, else in its unit.
            process: Whether the process noise moves too.
            signals: What the signals show of their noise, below which no variance falls; not regarded by default.
            stated: Whether other parameters have the prior of ``stated_std``.

        Raises:
            UserError: If a name is unknown or a parameter has no room to move.
        """
        variances = np.asarray(measurement, dtype=float)
        moved = (
            *_parameters(spec, free, priors or {}, stated),
            *(process_coordinates(spec) if process else ()),
            *measurement_coordinates(spec, variances, signals),
        )
        base = replace(Candidates.of(spec), measurement=variances.reshape(-1, 1))
        return cls(spec, spec.model().parameter_names, moved, [base])

    def with_coordinates(self, coordinates: Sequence[Coordinate]) -> Coordinates:
        """Return the same with other coordinates, such as others' priors."""
        return Coordinates(self.spec, self.names, coordinates, self._base)

    def __len__(self) -> int:
        return len(self.coordinates)

    def kind(self, *kinds: Kind) -> Mask:
        """Return which coordinates are of these kinds."""
        return np.array([c.kind in kinds for c in self.coordinates])

    def _of_drive(self, drive: int) -> Candidates:
        return self._base[drive if len(self._base) > 1 else 0]

    def candidates(self, z: Floats, drive: int = 0) -> Candidates:
        """Return what candidates ``z (n,)`` or ``(n, candidates)`` hold in a drive."""
        columns, base = np.atleast_2d(z.T).T, self._of_drive(drive)
        values = np.repeat(base.values, columns.shape[1], axis=1)
        tables = {
            "parameter": values,
            "intensity": values,
            "process": np.repeat(base.process, columns.shape[1], axis=1),
            "measurement": np.repeat(base.measurement, columns.shape[1], axis=1),
        }
        for c, row in zip(self.coordinates, columns, strict=True):
            if c.kind == "process":
                tables[c.kind][list(c.rows)] *= c.value(row)
            elif c.acts_in(drive):
                tables[c.kind][c.rows[0]] = c.value(row)
        return Candidates(tables["parameter"], tables["process"], tables["measurement"])

    def directions(self, z: Floats, chosen: Mask | None = None, drive: int = 0) -> Candidates:
        """Return the derivatives of what is held in a drive by the chosen coordinates (all by default)."""
        at = self.candidates(z, drive)
        tables = {
            "parameter": at.values,
            "intensity": at.values,
            "process": at.process,
            "measurement": at.measurement,
        }
        index = np.arange(len(self)) if chosen is None else np.flatnonzero(chosen)
        slopes = {kind: np.zeros((len(table), len(index))) for kind, table in tables.items()}
        for j, i in enumerate(index):
            c = self.coordinates[i]
            if c.acts_in(drive):
                rows = list(c.rows)
                slopes[c.kind][rows, j] = tables[c.kind][rows, 0] if c.logarithmic else c.scale
        return Candidates(slopes["parameter"] + slopes["intensity"], slopes["process"], slopes["measurement"])

    def penalty(self, z: Floats) -> Floats:
        """Return what the priors take from the log-likelihood of candidates ``z (n,)`` or ``(n, candidates)``."""
        away = (z.T - self.centre).T
        penalty = np.asarray(0.5 * self.weight @ away**2)
        return penalty if self.joint is None else penalty + 0.5 * np.sum(away * (self.joint @ away), axis=0)

    def pull(self, z: Floats) -> Floats:
        """Return the derivative of the penalty at a candidate ``(n,)``."""
        pull = self.weight * (z - self.centre)
        return pull if self.joint is None else pull + self.joint @ (z - self.centre)

    def precision(self, chosen: Mask) -> Floats:
        """Return the second derivative of the penalty to the chosen coordinates."""
        own = np.diag(self.weight[chosen])
        return own if self.joint is None else own + self.joint[np.ix_(chosen, chosen)]

    def possible(self, z: Floats) -> bool:
        """Whether the values of a candidate ``(n,)`` are possible together, as the vehicle file says."""
        held = self.candidates(z).values[:, 0]
        return not broken_relations(self.spec.vehicle, dict(zip(self.names, map(float, held), strict=True)))

    def fitted(self, z: Floats) -> ModelSpec:
        """Return the model with the values and variances of a candidate."""
        model, held = self.spec.model(), self.candidates(z)
        return replace(
            self.spec,
            values=dict(zip(model.parameter_names, map(float, held.values[:, 0]), strict=True)),
            process_noise=dict(zip(model.states, map(float, held.process[:, 0]), strict=True)),
            measurement_noise=dict(zip(model.outputs, map(float, held.measurement[:, 0]), strict=True)),
        )


def parameter_coordinate(
    p: Parameter, row: int, value: float, prior: float = math.inf, scale: float = 1.0, drives: tuple[int, ...] = ()
) -> Coordinate:
    """Return the coordinate of a parameter: its logarithm where it is positive and no time of change.

    Args:
        p: The parameter.
        row: Its row.
        value: Stated or first value.
        prior: Standard deviation of the coordinate before the data.
        scale: Of a coordinate that is no logarithm.
        drives: The only drives in which it acts.
    """
    logarithmic = p.lower > 0 and not p.per_drive
    scale = 1.0 if logarithmic or p.per_drive else scale
    centre, lower, upper = (math.log(v) if logarithmic else v / scale for v in (value, p.lower, p.upper))
    return Coordinate(p.name, "parameter", (row,), centre, lower, upper, logarithmic, p.unit, prior, scale, drives)


def intensity_coordinate(p: Parameter, row: int, value: float) -> Coordinate:
    """Return the logarithm of the intensity of a random process as a coordinate, also of one that may be zero.

    Args:
        p: The parameter.
        row: Its row.
        value: First value.
    """
    least = max(p.lower, _LEAST_INTENSITY * p.upper)
    coordinate = parameter_coordinate(replace(p, lower=least), row, max(value, least))
    return replace(coordinate, kind="intensity")


def process_coordinates(spec: ModelSpec) -> list[Coordinate]:
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


def measurement_coordinates(spec: ModelSpec, variances: Floats, signals: SignalNoise | None = None) -> list[Coordinate]:
    """Return a coordinate per output, about its first variance.

    Args:
        spec: The model.
        variances: First variances ``(ny,)``.
        signals: What the signals show of their noise, below which no variance falls; not regarded by default.
    """
    bound, coordinates = math.log(NOISE_RANGE), []
    nothing = np.zeros(len(variances))
    steps, least = (nothing, nothing) if signals is None else (signals.quantisation, signals.least)
    for a, (output, variance) in enumerate(zip(spec.model().outputs, variances, strict=True)):
        start = math.log(max(variance, least[a]))
        lower = max(start - bound, math.log(least[a])) if least[a] > 0 else start - bound
        unit = f"({SIGNALS[output].unit})^2" if output in SIGNALS else ""
        name, step = f"measurement_noise {output}", float(steps[a])
        coordinates.append(
            Coordinate(name, "measurement", (a,), start, lower, start + bound, True, unit, quantisation=step)
        )
    return coordinates


def _parameters(spec: ModelSpec, free: Sequence[str], priors: Mapping[str, float], stated: bool) -> list[Coordinate]:
    model, std = spec.model(), stated_std(spec) if stated else set_std(spec)
    names, coordinates = model.parameter_names, []
    for name in (*free, *priors):
        if name not in names:
            raise UserError(f"free: the model has no parameter '{name}'{closest(name, names)}")
    for name in dict.fromkeys(free):
        row = names.index(name)
        p = model.parameters[row]
        if not p.lower < p.upper:
            raise UserError(f"free: '{name}' has no room between its bounds {p.lower:g} and {p.upper:g} {p.unit}")
        c = parameter_coordinate(p, row, spec.values[name], priors.get(name, math.inf))
        prior = c.known_to(std[name]).prior if name in std else math.inf
        coordinates.append(
            replace(c, stated_std=min(prior, c.prior), prior=prior if stated and name not in priors else c.prior)
        )
    return coordinates
